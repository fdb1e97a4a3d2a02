"""`.btf` files of the University of Bonn, as in its database of 2014: DFMF, FMF, PVF and BDI.

`bonn/` reads the layouts; here their values become Nacre's: channels to RGB, the light's cosine,
the patch's size. Row 0 of an image is its bottom row, so storage order is Nacre's order. Local
frames and the RGB scale factors of the header are not applied, as btflib does not.
"""

import math
from collections.abc import Generator
from contextlib import closing
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np

from ..errors import NacreError
from .bonn import bdi, dfmf, fmf, pvf
from .bonn.channels import ToRgb, rgb_of
from .bonn.contents import Contents
from .bonn.cursor import Cursor
from .bonn.header import LONGEST_SIGNATURE, Header, Meta
from .options import Options
from .source import BLOCK_BYTES, DEFAULT_PATCH_WIDTH, Source, assumed_patch_size

FORMAT = "btf"
EXTENSIONS = (".btf",)
OPTIONS = frozenset({"cosine", "patch_width"})

_LAYOUTS: dict[bytes, ModuleType] = {
    signature: layout for layout in (dfmf, fmf, pvf, bdi) for signature in layout.SIGNATURES
}


def matches(path: Path) -> bool:
    """Whether the file starts with any of Bonn's signatures."""
    try:
        with path.open("rb") as file:
            return _signature(file.read(LONGEST_SIGNATURE)) is not None
    except OSError:
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read everything but the values, and check every size against the file's.

    Raises NacreError, one line, for anything that is not a whole and consistent file.
    """
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            start = file.read(LONGEST_SIGNATURE)
            signature = _signature(start)
            if signature is None:
                found = start.decode("ascii", "replace")
                raise NacreError(
                    f"{path.name} is not a .btf file of Bonn's: it starts with {found!r}, not "
                    "!DFMF08FCR or another of its signatures"
                )
            file.seek(len(signature))
            contents = _LAYOUTS[signature].read(Cursor(file, size, path.name), signature)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    header, meta = contents.header, contents.header.meta
    to_rgb, conversions = _rgb(contents, path.name)
    scaled, recorded = _cosine(meta, options.cosine, path.name)
    patch_size, assumed = _patch_size(header, options.patch_width)
    conversions += recorded
    if header.rotated:
        conversions.append("rotations of local frames left out")
    if meta.rgb_scale != (1.0, 1.0, 1.0):
        factors = ", ".join(f"{factor:g}" for factor in meta.rgb_scale)
        conversions.append(f"RGB scale factors {factors} of the header left out")
    shape = (len(header.light), len(header.view), header.height, header.width, 3)
    details = {"layout": contents.layout, "cosine_flag": meta.cosine_flag, **contents.details}
    return Source(
        path=path,
        format=FORMAT,
        light=header.light,
        view=header.view,
        shape=shape,
        # Half floats stay half: the samples are no more precise than the factors.
        dtype=np.dtype("<f2" if contents.half else "<f4"),
        patch_size=patch_size,
        conversions=conversions + assumed,
        details=details,
        bytes=size,
        blocks=partial(_blocks, path, contents, to_rgb, scaled),
        by_texel=contents.by_texel,
        memory=contents.memory + 4 * min(BLOCK_BYTES, 4 * math.prod(shape)),
    )


def _signature(start: bytes) -> bytes | None:
    known = [signature for signature in _LAYOUTS if start.startswith(signature)]
    return max(known, key=len, default=None)


def _rgb(contents: Contents, name: str) -> tuple[ToRgb, list[str]]:
    """How the decoded channels become RGB, and what to record of it and of the layout."""
    if not contents.named:
        return (lambda planes: planes), list(contents.conversions)
    to_rgb, recorded = rgb_of(contents.header.meta.channels, name)
    return to_rgb, contents.conversions + recorded


def _cosine(meta: Meta, override: int | None, name: str) -> tuple[bool, list[str]]:
    """Whether to multiply by cos(theta_light), and what to record of it."""
    if override == 0:
        return True, ["multiplied by cos(theta_light), as asked"]
    if override == 1:
        return False, ["values taken to include cos(theta_light), as asked"]
    if meta.cosine_flag is None:
        return False, [
            f"no cosine flag in a version {meta.version} header: values taken to include "
            "cos(theta_light)"
        ]
    if meta.cosine_flag == 0:
        return True, ["multiplied by cos(theta_light), left out by the file's cosine flag 0"]
    if meta.cosine_flag == 1:
        return False, []
    raise NacreError(
        f"{name} has the unknown cosine flag {meta.cosine_flag}: say whether its values include "
        "cos(theta_light) by giving cosine 0 or 1"
    )


def _patch_size(header: Header, asked_width: float | None) -> tuple[tuple[float, float], list[str]]:
    """Width and height in metres, and what to record of them."""
    if asked_width is not None:
        size = asked_width, asked_width * header.height / header.width
        return size, [f"patch taken as {asked_width:g} m wide, as asked"]
    scale = header.meta.pixels_per_mm
    size = (0.0, 0.0)
    if math.isfinite(scale) and scale > 0:
        size = header.width / scale * 1e-3, header.height / scale * 1e-3
    if not (min(size) > 0 and math.isfinite(max(size))):
        assumed = f"no scale in the file: patch taken as {DEFAULT_PATCH_WIDTH} m wide"
        return assumed_patch_size(header.width, header.height), [assumed]
    return size, []


def _blocks(path: Path, contents: Contents, to_rgb: ToRgb, scaled: bool) -> Generator[np.ndarray]:
    """Samples (light, view, texel, channel)."""
    cosines = contents.header.light[:, 2].astype(np.float32)
    with closing(contents.pieces(path)) as pieces:
        while True:
            # Overflow is let through to the writer, which knows the sample's place.
            with np.errstate(over="ignore", invalid="ignore"):
                lights, planes = next(pieces, (None, None))
                if planes is None:
                    return
                block = np.ascontiguousarray(np.moveaxis(to_rgb(planes), 0, -1))
                if scaled:
                    factors = cosines[lights, None, None, None]
                    np.multiply(block, factors, out=block, casting="same_kind")
            yield block
