"""UTIA's BRDFs: exact values of the table, interpolation between them, damaged files."""

import numpy as np
import pytest
from brdf_files import anisotropic, lambert, utia_directions, utia_file

from addon.datasets import utia_brdf
from addon.datasets.direction_sets import direction_set
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.datasets.options import Options
from addon.errors import NacreError


@pytest.fixture
def write(tmp_path):
    def write(data, name="m001_a.bin"):
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return write


def samples(path, **options):
    """(light, view, channel)."""
    source = utia_brdf.open_source(path, Options(**options))
    return np.concatenate(list(source.blocks())).reshape(*source.shape)[:, :, 0, 0]


@pytest.fixture
def every_direction(tmp_path):
    """A CSV file of the 288 directions of the table."""
    path = tmp_path / "all.csv"
    rows = [f"{15 * t},{7.5 * p}" for t in range(6) for p in range(48)]
    path.write_text("\n".join(["theta,phi", *rows]))
    return path


def test_measured_directions_are_exact(write, every_direction):
    directions = utia_directions()
    values = samples(write(utia_file(anisotropic)), directions=every_direction)
    truth = np.pi * anisotropic(directions[:, None], directions[None]) * directions[:, None, 2:]
    assert np.allclose(values, truth, rtol=1e-5)


def test_a_single_cell_is_where_the_format_says(write, every_direction):
    """Plane, light and view, theta before phi."""
    stored = np.zeros((3, 6, 48, 6, 48))
    stored[1, 4, 10, 2, 47] = 1.0
    values = samples(write(stored.tobytes()), directions=every_direction)
    (light, view, channel), *others = np.argwhere(values > 1e-9)  # but for rounding
    assert not others
    assert (light, view, channel) == (4 * 48 + 10, 2 * 48 + 47, 1)
    assert np.isclose(values[light, view, channel], np.pi * np.cos(np.radians(60)))


def test_between_them_values_are_interpolated_and_wrap(write):
    light, view = direction_set("uniform:31"), direction_set("uniform:47")
    values = samples(write(utia_file(anisotropic)), lights="uniform:31", views="uniform:47")
    truth = np.pi * anisotropic(light[:, None], view[None]) * light[:, None, 2:]
    inside = (light[:, 2] > 0.26)[:, None] & (view[:, 2] > 0.26)[None]
    difference = np.abs(values - truth)[inside]
    assert inside.mean() > 0.7
    assert difference.max() < 0.12 * truth.max()
    assert difference.mean() < 0.01 * truth.max()


def test_lower_directions_take_the_lowest_measured_ones(write, tmp_path):
    (tmp_path / "a.csv").write_text("theta,phi\n75,33\n80,33\n89.9,33\n90,33\n")
    path = write(utia_file(anisotropic))
    values = samples(path, directions=tmp_path / "a.csv")
    cosines = np.cos(np.radians([75, 80, 89.9]))
    assert np.allclose(values[:3] / cosines[:, None, None], values[0, 0] / cosines[0], rtol=1e-4)
    assert (values[3] == 0).all()


def test_gamma_and_white_override_what_the_file_leaves_open(write):
    data = utia_file(lambert)
    path = write(data)
    assert np.allclose(samples(path)[0, 0], [0.2, 0.5, 0.8], rtol=1e-5)
    stored = np.frombuffer(data, "<f8").reshape(3, -1)[:, 0]
    assert np.allclose(samples(path, gamma=1.0, white=1.0)[0, 0], stored, rtol=1e-6)
    assert np.allclose(samples(path, gamma=2.2, white=0.5)[0, 0], 2 * stored**2.2, rtol=1e-6)
    conversions = describe_source(path, gamma=2.2, white=0.5)["conversions"]
    assert conversions[0] == "values decoded from gamma 2.2, as asked"
    assert conversions[1].startswith("0.5 taken as a white diffuser, as asked")
    assert describe_source(path)["conversions"][0] == "values decoded from sRGB"


def test_negative_values_are_0_and_counted(write):
    stored = np.frombuffer(utia_file(lambert), "<f8").copy()
    stored[: stored.size // 3] = -0.5
    path = write(stored.tobytes())
    values = samples(path)
    assert (values[..., 0] == 0).all()
    assert (values[..., 1] > 0).all()
    counted = f"{stored.size // 3} of {stored.size} values are negative: taken as 0"
    assert counted in describe_source(path)["conversions"]


def test_importing(write, tmp_path):
    path = write(utia_file(lambert), "m001_a.BIN")
    assert detect_format(path) == "utia-brdf"
    dataset = import_dataset(path, tmp_path / "a.nacre", patch_width=0.05)
    assert dataset.shape == (81, 81, 1, 1, 3)
    assert dataset.patch_size == (0.05, 0.05)


def test_only_what_looks_like_one_is_one(write):
    data = utia_file(lambert)
    assert utia_brdf.matches(write(data))
    assert not utia_brdf.matches(write(data, "a.data"))
    assert not utia_brdf.matches(write(data[:-8]))
    for value in (np.nan, np.inf, 1e30):
        stored = np.frombuffer(data, "<f8").copy()
        stored[77] = value
        path = write(stored.tobytes())
        assert not utia_brdf.matches(path)
        with pytest.raises(NacreError, match="m001_a.bin is not a UTIA BRDF: it holds values"):
            describe_source(path)


def test_another_size_is_refused(write):
    with pytest.raises(NacreError, match="m001_a.bin has 9 bytes; a UTIA BRDF is of 1990656"):
        describe_source(write(bytes(9)))
