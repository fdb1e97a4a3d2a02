"""Makes small zips of images named by their angles."""

import io
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image

LIGHTS = ((0, 0), (15, 0), (15, 180))
VIEWS = ((0, 0), (30, 90))


def encode(pixels: np.ndarray, kind: str = "PNG") -> bytes:
    """An image file of pixels (row, column, channel) uint8, top row first."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind)
    return buffer.getvalue()


def random_images(size: tuple[int, int] = (3, 4)) -> dict[tuple, np.ndarray]:
    """Pixels (row, column, channel) for each (light, view)."""
    rng = np.random.default_rng(3)
    return {
        (light, view): rng.integers(0, 256, (*size, 3), dtype=np.uint8)
        for light in LIGHTS
        for view in VIEWS
    }


def random_floats(seed: int = 5, size=(3, 8), bands: int = 3) -> dict[tuple, np.ndarray]:
    """Pixels (row, column, band) float32 for each (light, view)."""
    rng = np.random.default_rng(seed)
    return {
        (light, view): rng.lognormal(-1, 1, (*size, bands)).astype(np.float32)
        for light in LIGHTS
        for view in VIEWS
    }


def samples_of(images: dict[tuple, np.ndarray]) -> np.ndarray:
    """Images as samples (light, view, y, x, band): bottom row first."""
    return np.array([[images[light, view][::-1] for view in VIEWS] for light in LIGHTS])


def usual_name(light: tuple, view: tuple, suffix: str = ".png") -> str:
    (tl, pl), (tv, pv) = light, view
    return f"tv{tv:03}_pv{pv:03}/00000 tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}{suffix}"


def usual_files(suffix: str = ".png") -> dict[str, bytes]:
    kind = "PNG" if suffix == ".png" else "JPEG"
    return {
        usual_name(light, view, suffix): encode(pixels, kind)
        for (light, view), pixels in random_images().items()
    }


def zip_of(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            # No time of day: the same files make the same zip.
            archive.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()


def write_zip(path: Path, files: dict[str, bytes]) -> Path:
    path.write_bytes(zip_of(files))
    return path
