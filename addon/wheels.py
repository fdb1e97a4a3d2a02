"""The compiled packages the extension brings along as wheels: are they there?"""

import importlib
import re
import sys
import tomllib
from functools import cache
from pathlib import Path

PACKAGES = ("nacre_native", "OpenEXR", "PIL")
MANIFEST = Path(__file__).with_name("blender_manifest.toml")


@cache
def missing() -> str | None:
    """One line on the first package that cannot be imported and on whom there are wheels for.

    None when all are there. A package that arrives later is seen after a restart.
    """
    for package in PACKAGES:
        try:
            importlib.import_module(package)
        except ImportError as error:
            return _explain(package, error)
    return None


def _explain(package: str, error: ImportError) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name == package:
        text = f"The package {package} is missing"
    else:
        reason = str(error).splitlines()[0]
        text = f"The package {package} cannot be loaded ({reason})"
    here = f"Python {sys.version_info[0]}.{sys.version_info[1]} on {sys.platform}"
    supported = wheel_targets(MANIFEST)
    if not supported:
        return f"{text}: install it for {here}, or install the extension's zip"
    return f"{text}: this zip has wheels for {supported}, and this is {here}"


def wheel_targets(manifest: Path) -> str:
    """Systems and Pythons a manifest lists wheels of the compiled helper for; empty when none.

    As "linux x86_64 (Python 3.11, 3.13)".
    """
    try:
        wheels = tomllib.loads(manifest.read_text(encoding="utf-8")).get("wheels", [])
    except (OSError, ValueError):
        return ""
    targets: dict[str, set[tuple[int, int]]] = {}
    for wheel in wheels:
        match = re.search(r"/nacre_native-.*-cp(\d)(\d+)-cp\d+-(\w+)", wheel)
        if match:
            system = re.sub(r"^(manylinux|macosx)(?:_?\d+)*_", _system, match[3])
            targets.setdefault(system, set()).add((int(match[1]), int(match[2])))
    return "; ".join(
        f"{system} (Python {', '.join(f'{major}.{minor}' for major, minor in sorted(pythons))})"
        for system, pythons in sorted(targets.items())
    )


def _system(match: re.Match) -> str:
    return {"manylinux": "Linux ", "macosx": "macOS "}[match[1]]
