"""The sources in shaders/."""

from pathlib import Path

_PACKAGE = Path(__file__).parent


def shader_text(name: str) -> str:
    """The text of shaders/NAME, which lies inside the installed extension and beside the package
    in a checkout."""
    for folder in (_PACKAGE / "shaders", _PACKAGE.parent / "shaders"):
        if (folder / name).is_file():
            return (folder / name).read_text(encoding="utf-8")
    raise FileNotFoundError(f"shaders/{name} is not part of this installation")
