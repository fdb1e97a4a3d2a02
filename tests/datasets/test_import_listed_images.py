"""Images with a CSV file of their directions."""

import os

import numpy as np
import pytest
from image_zips import LIGHTS, VIEWS, encode, random_images, samples_of, write_zip

from addon.datasets.colour import srgb_to_linear
from addon.datasets.directions import spherical_to_unit
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.errors import NacreError

HEADER = "file,light_theta,light_phi,view_theta,view_phi"


def files():
    """The images by the numbers of their light and view, and the lines of the list."""
    images = random_images()
    names = {
        (light, view): f"pictures/l{LIGHTS.index(light)} v{VIEWS.index(view)}.bmp"
        for light, view in images
    }
    lines = [
        f"{names[light, view]},{light[0]},{light[1]},{view[0]},{view[1]}" for light, view in images
    ]
    return {names[pair]: encode(pixels, "BMP") for pair, pixels in images.items()}, lines


def write_set(folder, header=HEADER, change=lambda lines: lines):
    """A folder with a list and images in it; returns the list."""
    pictures, lines = files()
    for name, data in pictures.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    (folder / "list.csv").write_text("\n".join([header, *change(lines), ""]))
    return folder / "list.csv"


def check(dataset):
    expected = srgb_to_linear(samples_of(random_images()) / 255.0)
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(dataset.light, spherical_to_unit([0, 15, 15], [0, 0, 180]))
    np.testing.assert_allclose(dataset.view, spherical_to_unit([0, 30], [0, 90]))
    assert dataset.source["format"] == "images"


def test_the_list_itself_is_opened(tmp_path):
    path = write_set(tmp_path)
    assert detect_format(path) == "images"
    dataset = import_dataset(path, tmp_path / "a.nacre")
    check(dataset)
    assert dataset.source["file"] == "list.csv"
    assert "8-bit values decoded as sRGB" in dataset.source["conversions"]
    assert describe_source(path)["bytes"] == sum(map(len, files()[0].values()))


def test_a_folder_and_a_list(tmp_path):
    path = write_set(tmp_path / "set")
    moved = path.rename(tmp_path / "elsewhere.csv")
    check(import_dataset(tmp_path / "set", tmp_path / "a.nacre", directions=moved))


def test_a_zip_and_a_list(tmp_path):
    pictures, lines = files()
    path = write_zip(tmp_path / "set.zip", pictures)
    (tmp_path / "list.csv").write_text("\n".join([HEADER, *lines]))
    check(import_dataset(path, tmp_path / "a.nacre", directions=tmp_path / "list.csv"))


def test_a_list_of_views_still_means_masks(tmp_path):
    write_set(tmp_path / "set")
    (tmp_path / "views.csv").write_text("theta,phi\n0,0\n")
    with pytest.raises(NacreError, match="set holds no PNG images"):
        describe_source(tmp_path / "set", directions=tmp_path / "views.csv")


def test_columns_in_any_order_beside_others(tmp_path):
    def shuffle(lines):
        cells = [line.split(",") for line in lines]
        return [f'"a, b", {c[4]} ,{c[1]},{c[0]},{c[3]},{c[2]}' for c in reversed(cells)]

    header = "Note,View_Phi,light_theta, File,view_theta,light_phi"
    check(import_dataset(write_set(tmp_path, header, shuffle), tmp_path / "a.nacre"))


def test_angles_computed_twice_are_one(tmp_path):
    def computed(lines):
        return [line.replace(",15,0,", ",15.00000001,360,") for line in lines[:3]] + [
            line.replace(",30,90", ",29.99999999,-270") for line in lines[3:]
        ]

    check(import_dataset(write_set(tmp_path, change=computed), tmp_path / "a.nacre"))


def test_backslashes_and_a_byte_order_mark(tmp_path):
    path = write_set(tmp_path, "\ufeff" + HEADER, lambda ls: [li.replace("/", "\\") for li in ls])
    check(import_dataset(path, tmp_path / "a.nacre"))


def replaced(number, line):
    def change(lines):
        return [*lines[:number], line, *lines[number + 1 :]]

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (replaced(1, "a.png,0,0,0"), "list.csv, line 3: 4 cells, but the header has 5"),
        (replaced(1, "a.png,0,0,x,0"), "list.csv, line 3: view_theta is 'x'; expected degrees"),
        (replaced(0, "a.png,0,nan,0,0"), "list.csv, line 2: the angles must be finite"),
        (replaced(5, "a.png,95,0,0,0"), "list.csv, line 7: theta 95 points below the surface"),
        (replaced(2, "a.png,40,0,0,0"), "list.csv, line 4: cannot read a.png: No such file"),
        (replaced(2, "../a.png,40,0,0,0"), "line 4: '../a.png' is outside of the folder"),
        (replaced(2, "..\\a.png,40,0,0,0"), "line 4: '../a.png' is outside of the folder"),
        (replaced(2, "/a.png,40,0,0,0"), "line 4: '/a.png' is outside of the folder"),
        (replaced(2, "pictures,40,0,0,0"), "line 4: 'pictures' is no file"),
        (replaced(2, '"a\nb",40,0,0,0'), r"line 5: 'a\\nb' is no file"),
        (replaced(2, ",40,0,0,0"), "line 4: '' is no file"),
        (replaced(2, "pictures/l0 v0.bmp,0,0,0,360"), "line 4: the same directions as in line 2"),
        (lambda lines: [], "list.csv lists no images"),
        (
            lambda lines: lines[:-1],
            "list.csv lacks the image for tl 15 pl 180 tv 30 pv 90: 3 lights by 2 views are "
            "needed, and 5 images are there",
        ),
        (
            lambda lines: [lines[0], lines[3], "pictures/l0 v0.bmp,70,0,70,0"],
            r"lacks the image for tl 0 pl 0 tv 30 pv 90; tl 0 pl 0 tv 70 pv 0; .* \(and 3 more\)",
        ),
    ],
)
def test_a_list_that_cannot_be_read_is_one_clear_error(tmp_path, change, says):
    path = write_set(tmp_path / "set", change=change)
    with pytest.raises(NacreError, match=says) as caught:
        import_dataset(path, tmp_path / "a.nacre")
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["set"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file,light_theta,view_theta\n", "line 1: expected the columns .* there is no light_phi"),
        ("", "line 1: expected the columns"),
        ("theta,phi\n0,0\n", "line 1: expected the columns"),
        ("\0" * 10, "line 1: expected the columns|not a CSV text file"),
        (HEADER + '\n"unclosed,0,0,0,0\n', "line 2: 1 cells|line 3: 1 cells"),
    ],
)
def test_another_csv_is_one_clear_error(tmp_path, text, says):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(NacreError, match=says):
        describe_source(tmp_path / "list.csv")


def test_a_csv_that_is_no_text(tmp_path):
    (tmp_path / "list.csv").write_bytes(b"\xff\xfe" + HEADER.encode("utf-16-le"))
    with pytest.raises(NacreError, match="list.csv is not a CSV text file"):
        describe_source(tmp_path / "list.csv")


def test_a_list_like_curets_is_no_grid_and_says_so_at_once(tmp_path):
    """Each image with directions of its own; a million pairs would be missing."""
    lines = "".join(f"pictures/l0 v0.bmp,{i * 0.05:.3f},0,{i * 0.05:.3f},90\n" for i in range(1000))
    path = write_set(tmp_path)
    path.write_text(f"{HEADER}\n{lines}")
    with pytest.raises(NacreError, match=r"\(and 998997 more\): 1000 lights by 1000 views"):
        describe_source(path)
