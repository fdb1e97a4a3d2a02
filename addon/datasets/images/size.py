"""What an image file may claim to hold, before any memory is taken for it."""

from ...errors import NacreError

MAX_SIDE = 8192
"""Pixels; beyond any measured image."""

# Bytes as floats. Nobody minds this much; beyond, a file must have bytes for what it claims:
# deflate, at its best, makes 1032 of one, and 8 bits become a float.
_UNSUSPICIOUS = 2**26
_RATIO = 4 * 1100


def check_claim(name: str, width: int, height: int, channels: int, file_bytes: int) -> None:
    """NacreError for an image that claims no pixels, too many, or more than its file can hold."""
    if min(width, height) < 1:
        raise NacreError(f"{name} has no pixels")
    if max(width, height) > MAX_SIDE:
        raise NacreError(
            f"{name} claims {width} x {height} pixels; at most {MAX_SIDE} a side are read"
        )
    if 4 * width * height * channels > max(_UNSUSPICIOUS, _RATIO * file_bytes):
        raise NacreError(f"{name} claims {width} x {height} pixels, but has {file_bytes} bytes")
