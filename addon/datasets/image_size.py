"""What an image file may claim to hold, before any memory is taken for it."""

from ..errors import NacreError

MAX_SIDE = 8192
"""Pixels; beyond any measured image."""

# Nobody minds this much. Beyond, a file must have bytes for what it claims: deflate, at its best,
# makes 1032 bytes of one.
_UNSUSPICIOUS = 2**25
_RATIO = 1100


def check_claim(name: str, width: int, height: int, pixel_bytes: int, file_bytes: int) -> None:
    """NacreError for an image that claims to be empty, or too large for itself or for its file."""
    if min(width, height) < 1:
        raise NacreError(f"{name} has no pixels")
    if max(width, height) > MAX_SIDE:
        raise NacreError(
            f"{name} claims {width} x {height} pixels; at most {MAX_SIDE} a side are read"
        )
    if width * height * pixel_bytes > max(_UNSUSPICIOUS, _RATIO * file_bytes):
        raise NacreError(f"{name} claims {width} x {height} pixels, but has {file_bytes} bytes")
