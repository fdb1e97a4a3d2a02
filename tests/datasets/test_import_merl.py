"""MERL's BRDFs: analytic ones back from their table, exact cells, damaged files."""

import struct

import numpy as np
import pytest
from brdf_files import MERL_SCALE, blinn_phong, from_half_difference, lambert, merl_cells, merl_file

from addon.datasets import merl
from addon.datasets.direction_sets import direction_set
from addon.datasets.directions import unit_to_spherical
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.datasets.options import Options
from addon.errors import NacreError


def not_reciprocal(light, view):
    """As Phong's model: the reflected light's angle, and more for lights along +x."""
    shape = np.broadcast_shapes(light.shape, view.shape)
    return np.broadcast_to(0.2 + 0.1 * light[..., 2:] + 0.05 * view[..., 2:] ** 2, shape) * [
        1.0, 0.5, 0.25,
    ]  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("merl")
    kinds = {
        "lambert": (lambert, 180),
        "blinn_phong": (blinn_phong, 180),
        "not_reciprocal": (not_reciprocal, 360),
    }
    paths = {}
    for name, (brdf, phis) in kinds.items():
        paths[name] = folder / f"{name}.binary"
        paths[name].write_bytes(merl_file(brdf, phis))
    return paths


def samples(path, **options):
    """(light, view, channel)."""
    source = merl.open_source(path, Options(**options))
    return np.concatenate(list(source.blocks())).reshape(*source.shape)[:, :, 0, 0]


def test_lambert_comes_back(files):
    values = samples(files["lambert"], lights="ubo81", views="ubo151")
    cosine = direction_set("ubo81")[:, 2]
    assert np.allclose(values, np.pi * lambert(np.ones((1, 3)), np.ones(3)) * cosine[:, None, None])


@pytest.mark.parametrize(
    ("name", "brdf", "error"),
    [("blinn_phong", blinn_phong, 0.03), ("not_reciprocal", not_reciprocal, 0.01)],
)
def test_analytic_brdfs_come_back_within_the_cells(files, name, brdf, error):
    light, view = direction_set("uniform:37"), direction_set("uniform:40")
    values = samples(files[name], lights="uniform:37", views="uniform:40")
    truth = np.pi * brdf(light[:, None], view[None, :]) * light[:, None, 2:]
    assert np.abs(values - truth).max() < error * truth.max()


def test_light_and_view_are_not_exchanged(files):
    light, view = direction_set("uniform:20"), direction_set("uniform:25")
    values = samples(files["not_reciprocal"], lights="uniform:20", views="uniform:25")
    exchanged = np.pi * not_reciprocal(view[None, :], light[:, None]) * light[:, None, 2:]
    assert np.abs(values - exchanged).max() > 0.05


def test_the_middle_of_a_cell_is_that_cell(tmp_path):
    rng = np.random.default_rng(3)
    table = rng.uniform(0.1, 1.0, (3, 90, 90, 180))
    path = tmp_path / "a.binary"
    path.write_bytes(struct.pack("<3i", 90, 90, 180) + table.tobytes())
    theta_h, theta_d, phi_d = merl_cells()
    light, view = from_half_difference(theta_h, theta_d, phi_d)
    seen = np.argwhere((light[..., 2] > 0.01) & (view[..., 2] > 0.01))
    for number, cell in enumerate(seen[rng.choice(len(seen), 40, replace=False)]):
        angles = []
        for name, vectors in (("l.csv", light), ("v.csv", view)):
            theta, phi = unit_to_spherical(vectors[tuple(cell)][None])
            (tmp_path / name).write_text(f"theta,phi\n{float(theta[0])!r},{float(phi[0])!r}\n")
            angles.append(str(tmp_path / name))
        value = samples(path, lights=angles[0], views=angles[1])[0, 0]
        expected = table[(slice(None), *cell)] * MERL_SCALE * np.pi * light[tuple(cell)][2]
        assert np.allclose(value, expected, rtol=1e-6), (number, cell)


def test_turning_the_surface_changes_nothing(files):
    """Rounding decides nothing where a direction lies on the border of two cells."""
    values = samples(files["blinn_phong"])  # lights and views on the same rings
    light = direction_set("ubo81")
    rings = np.degrees(np.arccos(light[:, 2])).round()
    for ring in (15, 30, 45, 60, 75):
        there = np.flatnonzero(rings == ring)
        normal = values[there, 0]
        assert np.array_equal(normal, np.broadcast_to(normal[0], normal.shape))
        mirrored = values[there[: len(there) // 2], there[len(there) // 2 :]]
        assert np.array_equal(mirrored, np.broadcast_to(mirrored[0], mirrored.shape))


def test_invalid_values_are_0_and_counted(files, tmp_path):
    data = bytearray(files["lambert"].read_bytes())
    table = np.frombuffer(data, "<f8", offset=12).reshape(3, -1)
    negative = int((table < 0).sum())
    table[1] = -0.5
    table[2, 0] = np.nan
    path = tmp_path / "a.binary"
    path.write_bytes(data)
    values = samples(path)
    assert (values[..., 1] == 0).all()
    assert (values[..., 0] > 0).all()
    counted = int((~(table >= 0)).sum())
    assert counted > negative
    assert (
        f"{counted} of 4374000 values are negative, that is invalid: taken as 0"
        in describe_source(path)["conversions"]
    )


def test_importing(files, tmp_path):
    assert detect_format(files["lambert"]) == "merl"
    dataset = import_dataset(files["lambert"], tmp_path / "a.nacre")
    assert dataset.shape == (81, 81, 1, 1, 3)
    assert dataset.samples.dtype == np.float32
    assert np.allclose(dataset.samples[0, 0, 0, 0], [0.2, 0.5, 0.8])
    summary = describe_source(files["not_reciprocal"])
    assert (summary["cells"], summary["reciprocal"]) == ([90, 90, 360], False)


def test_lights_at_the_horizon_are_dark(files, tmp_path):
    (tmp_path / "a.csv").write_text("theta,phi\n90,0\n89.9,40\n0,0\n90.01,10\n")
    values = samples(files["blinn_phong"], directions=tmp_path / "a.csv")
    assert np.isfinite(values).all()
    assert (values[[0, 3]] == 0).all()
    assert (values[1, [1, 2]] > 0).all()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "its header is cut short; expected 90 x 90 x 180 or 90 x 90 x 360"),
        (struct.pack("<3i", 90, 90, 90), "its header claims 90 x 90 x 90 cells"),
        (struct.pack("<3i", -90, -90, 180), "its header claims -90 x -90 x 180 cells"),
        (struct.pack("<3i", 90, 90, 180), "cut short: .* cells take 34992012 bytes, it has 12"),
        (struct.pack("<3i", 90, 90, 360), "cut short: .* cells take 69984012 bytes, it has 12"),
    ],
)
def test_damaged_files_are_refused_in_one_line(data, message, tmp_path):
    path = tmp_path / "a.binary"
    path.write_bytes(data)
    assert not merl.matches(path)
    with pytest.raises(NacreError, match=message) as caught:
        describe_source(path)
    assert str(caught.value).startswith("a.binary is ")


def test_a_byte_too_many(files, tmp_path):
    path = tmp_path / "a.binary"
    path.write_bytes(files["lambert"].read_bytes() + b"x")
    with pytest.raises(NacreError, match="a.binary is damaged: .* it has 34992013"):
        describe_source(path)


def test_what_a_float_cannot_hold_is_refused(files, tmp_path):
    data = bytearray(files["lambert"].read_bytes())
    np.frombuffer(data, "<f8", offset=12)[:] = 1e300
    path = tmp_path / "a.binary"
    path.write_bytes(data)
    with pytest.raises(NacreError, match="the value at light 0, view 0, .* is not a finite number"):
        import_dataset(path, tmp_path / "a.nacre")
