"""What every test needs before its module is imported."""

import atexit
import os
import shutil
import tempfile

# `import bpy` reads the user's preferences and puts the user's extensions on the path: keep both
# out, here and in every Blender that a test starts.
_user = tempfile.mkdtemp(prefix="nacre-blender-user-")
atexit.register(shutil.rmtree, _user, ignore_errors=True)
os.environ["BLENDER_USER_RESOURCES"] = _user
os.environ["BLENDER_USER_EXTENSIONS"] = os.path.join(_user, "extensions")
