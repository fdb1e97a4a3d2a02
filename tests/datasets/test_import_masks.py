"""Masks that users bring: folders of PNG images and .npy arrays."""

import os

import numpy as np
import pytest
from fibres import fibre_masks, views
from PIL import Image

from addon.datasets.directions import unit_to_spherical
from addon.datasets.importing import describe_source, import_dataset
from addon.errors import NacreError

VIEWS = views((0, 30, 60), 5)
MASKS = fibre_masks(VIEWS, 16)[:, :12]


@pytest.fixture
def directions(tmp_path):
    """A CSV file of the views."""
    angles = np.stack(unit_to_spherical(VIEWS), -1)
    path = tmp_path / "views.csv"
    path.write_text("theta,phi\n" + "".join(f"{theta},{phi}\n" for theta, phi in angles))
    return path


def as_image(mask, mode):
    """A picture of a mask, its top row the mask's last."""
    pixels = mask[::-1].astype(np.uint8) * 255
    if mode == "I;16":
        return Image.fromarray(pixels.astype(np.uint16) * 257)
    if mode == "RGBA":  # black, as a renderer leaves an object with a transparent background
        return Image.fromarray(np.stack([0 * pixels] * 3 + [pixels], -1))
    return Image.fromarray(pixels).convert(mode)


def write_images(folder, masks=MASKS, mode="L"):
    folder.mkdir()
    for number, mask in enumerate(masks):
        as_image(mask, mode).save(folder / f"view_{number}.png")
    return folder


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "P", "RGB", "RGBA"])
def test_images_of_any_sort_are_masks(mode, directions, tmp_path):
    folder = write_images(tmp_path / "masks", mode=mode)
    (folder / ".hidden.png").touch()
    (folder / "notes.txt").touch()
    dataset = import_dataset(folder, tmp_path / "a.nacre", directions=directions)
    assert (dataset.kind, dataset.value) == ("occlusion", "mask")
    assert dataset.samples.dtype == np.float16
    np.testing.assert_array_equal(dataset.samples, MASKS)  # also view_10 after view_9
    np.testing.assert_allclose(dataset.view, VIEWS, atol=1e-12)
    assert dataset.periodic is True
    assert dataset.patch_size == pytest.approx((0.01, 0.0075))
    assert dataset.source["format"] == "masks"
    assert dataset.source["file"] == "masks"


def test_half_covered_is_covered(directions, tmp_path):
    folder = write_images(tmp_path / "masks")
    Image.fromarray(np.full((12, 16), 127, np.uint8)).save(folder / "view_3.png")
    Image.fromarray(np.full((12, 16), 128, np.uint8)).save(folder / "view_4.png")
    dataset = import_dataset(folder, tmp_path / "a.nacre", directions=directions)
    assert dataset.samples[3].max() == 0.0
    assert dataset.samples[4].min() == 1.0


@pytest.mark.parametrize(
    "array",
    [
        MASKS,
        MASKS.astype(np.uint8),
        MASKS.astype(np.uint8) * 255,
        MASKS.astype(np.int64),
        MASKS * 0.4 + 0.3,
        np.asfortranarray(MASKS.astype(">f4")),
    ],
    ids=["bool", "0 to 1", "0 to 255", "int64", "coverage", "Fortran"],
)
def test_arrays_of_any_sort_are_masks(array, directions, tmp_path):
    np.save(tmp_path / "masks.npy", array)
    dataset = import_dataset(tmp_path / "masks.npy", tmp_path / "a.nacre", directions=directions)
    assert (dataset.kind, dataset.value) == ("occlusion", "mask")
    np.testing.assert_array_equal(dataset.samples, MASKS)
    assert dataset.source["file"] == "masks.npy"


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (MASKS[0], "expected an array of masks"),
        (MASKS[:0], "expected an array of masks"),
        (MASKS.astype(complex), "complex128; expected numbers"),
        (MASKS * 2.0, "from 0 to 2; expected masks"),
        (MASKS.astype(np.int16) * 256, "from 0 to 256"),
        (MASKS.astype(np.int8) - 1, "from -1 to 0"),
        (np.where(MASKS, np.nan, 0.0), "from nan"),
        (MASKS[1:], "holds 10 masks, but views.csv lists 11 directions"),
        (MASKS.astype(object), "cannot be read as a .npy file"),
    ],
    ids=str,
)
def test_arrays_that_are_no_masks_are_refused(array, says, directions, tmp_path):
    np.save(tmp_path / "masks.npy", array)
    with pytest.raises(NacreError, match=says) as error:
        import_dataset(tmp_path / "masks.npy", tmp_path / "a.nacre", directions=directions)
    assert "\n" not in str(error.value)
    assert sorted(os.listdir(tmp_path)) == ["masks.npy", "views.csv"]


def test_folders_that_hold_no_masks_are_refused(directions, tmp_path):
    def refused(says):
        with pytest.raises(NacreError, match=says) as error:
            import_dataset(tmp_path / "masks", tmp_path / "a.nacre", directions=directions)
        assert "\n" not in str(error.value)
        assert not (tmp_path / "a.nacre").exists()

    (tmp_path / "masks").mkdir()
    refused("masks holds no PNG images")
    (tmp_path / "masks").rmdir()
    folder = write_images(tmp_path / "masks")
    as_image(MASKS[0], "L").resize((9, 9)).save(folder / "view_7.png")
    refused("view_7.png has 9 x 9 pixels, but view_0.png has 16 x 12")
    data = (folder / "view_6.png").read_bytes()
    (folder / "view_6.png").write_bytes(data[: len(data) // 2])
    refused("view_6.png cannot be read as a PNG image")
    (folder / "view_10.png").unlink()
    refused("masks holds 10 masks, but views.csv lists 11")


def test_masks_need_directions_and_nothing_else_takes_them(directions, tmp_path):
    np.save(tmp_path / "masks.npy", MASKS)
    for look in (describe_source, lambda path: import_dataset(path, tmp_path / "a.nacre")):
        with pytest.raises(NacreError, match="give --directions"):
            look(tmp_path / "masks.npy")
    with pytest.raises(NacreError, match="read as masks, which takes no --cosine"):
        import_dataset(
            tmp_path / "masks.npy", tmp_path / "a.nacre", directions=directions, cosine=1
        )
    with pytest.raises(NacreError, match="read as btf, which takes no --directions"):
        import_dataset(
            tmp_path / "masks.npy", tmp_path / "a.nacre", directions=directions, format="btf"
        )
