"""Shaders in the Open Shading Language.

They are compiled here, and not by Blender's operators, which ask oslquery for a shader's
parameters: the bpy wheel cannot import that module, and we know them.
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

from .errors import NacreError
from .shader_files import shader_text


def has_osl() -> bool:
    """Whether this Blender was built with the Open Shading Language; not every one is."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(getattr(_cycles, "with_osl", False))


def compile_osl(shader: str, header_name: str, header: str) -> tuple[str, str]:
    """Bytecode of a shader in shaders/, which includes a header, and the hash that Blender tells
    one from another by. Raises NacreError when it cannot be compiled."""
    import _cycles

    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / shader, Path(folder) / "shader.oso"
        source.write_text(shader_text(shader), encoding="utf-8")
        (Path(folder) / header_name).write_text(header, encoding="utf-8")
        if not _cycles.osl_compile(str(source), str(target)):
            raise NacreError(f"this Blender cannot compile {shader}")
        bytecode = target.read_text(encoding="utf-8")
    return bytecode, hashlib.md5(bytecode.encode(), usedforsecurity=False).hexdigest()
