"""What every user of the OpenEXR library needs: silence."""

import contextlib
import io
import os
import threading
from collections.abc import Iterator

_lock = threading.Lock()


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what the OpenEXR library prints about damaged files from the user, who gets one line of
    ours: it writes to sys.stdout and past sys.stderr to the process's standard error."""
    with _lock, contextlib.redirect_stdout(io.StringIO()), contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # a program without a console has no standard error
            kept = os.dup(2)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, 2)
            with open(os.devnull, "wb") as nothing:
                os.dup2(nothing.fileno(), 2)
        yield
