"""The instrument reads what is known: cosines, places, shadows, reciprocity."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.datasets.direction_sets import ubo_81
from addon.datasets.directions import spherical_to_unit
from addon.errors import Cancelled, NacreError
from addon.measure.btf import measure_btf
from addon.measure.settings import Settings

WHITE, RED, GREEN = (1, 1, 1), (1, 0, 0), (0, 1, 0)
WHOLE = ((-0.5, -0.5), (0.5, 0.5))
UP = np.array([[0.0, 0.0, 1.0]])


def _everything() -> set[str]:
    kinds = ("scenes", "objects", "meshes", "lights", "cameras", "worlds", "images", "texts")
    found = {f"{kind}/{item.name}" for kind in kinds for item in getattr(bpy.data, kind)}
    return found - {"images/Render Result"}  # Blender keeps one for all scenes


def test_white_reads_the_cosine(tmp_path, make_patch):
    light = ubo_81()[[0, 5, 33, 80]]
    dataset = measure_btf(
        make_patch((*WHOLE, 0, WHITE)), tmp_path / "a.nacre", light, ubo_81(), Settings(4, 2)
    )
    assert dataset.samples.dtype == np.float16
    expected = np.broadcast_to(light[:, 2].reshape(-1, 1, 1, 1, 1), (4, 81, 4, 4, 3))
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-3)
    np.testing.assert_array_equal(dataset.light, light)
    assert dataset.patch_size == (1.0, 1.0) and dataset.periodic


def test_nothing_is_flipped_or_turned(tmp_path, make_patch):
    """On the reference plane each texel stays in its place in every view: x = +u, y up = +v."""
    patch = make_patch(((-0.5, -0.5), (-0.25, 0), 0, RED), ((0.25, 0), (0.5, 0.5), 0, GREEN))
    dataset = measure_btf(patch, tmp_path / "a.nacre", UP, ubo_81(), Settings(4, 1))
    expected = np.zeros((4, 4, 3))
    expected[:2, 0] = RED
    expected[2:, 3] = GREEN
    np.testing.assert_allclose(
        dataset.samples[0], np.broadcast_to(expected, (81, 4, 4, 3)), atol=1e-3
    )


@pytest.mark.parametrize(("phi", "moved"), [(0, (0, -1)), (90, (-1, 0)), (180, (0, 1))])
def test_parallax_is_the_view_s(tmp_path, make_patch, phi, moved):
    """What lies a texel above the plane is seen a texel away from the viewer at 45 degrees."""
    patch = make_patch(((0, 0), (0.25, 0.25), 0.25, GREEN))
    view = spherical_to_unit([0, 45], [0, phi])
    dataset = measure_btf(patch, tmp_path / "a.nacre", UP, view, Settings(4, 1))
    above, slanted = dataset.samples[0, ..., 1] > 0.5
    assert np.argwhere(above).tolist() == [[2, 2]]
    assert np.argwhere(slanted).tolist() == [[2 + moved[0], 2 + moved[1]]]


def test_shadows_fall_away_from_the_light_and_come_back_round_the_edge(tmp_path, make_patch):
    patch = make_patch((*WHOLE, 0, WHITE), ((0.25, 0), (0.5, 0.25), 0.25, GREEN))
    light = spherical_to_unit([45, 45], [180, 90])
    dataset = measure_btf(patch, tmp_path / "a.nacre", light, UP, Settings(4, 1, bounces=0))
    lit = dataset.samples[:, 0, ..., 0] > 0.1  # green is dark in red
    raised = [2, 3]
    assert np.argwhere(~lit[0]).tolist() == [[2, 0], raised]
    assert np.argwhere(~lit[1]).tolist() == [[1, 3], raised]


def test_glossy_plane_is_reciprocal(tmp_path, make_patch):
    both = ubo_81()[[0, 3, 12, 30, 50]]
    patch = make_patch((*WHOLE, 0, (0.8, 0.5, 0.2)), shader="ShaderNodeBsdfGlossy", Roughness=0.6)
    # Cycles' multiple scattering only scales the lobe, and not by the same for both directions.
    for item in bpy.data.materials:
        item.node_tree.nodes["Glossy BSDF"].distribution = "GGX"
    dataset = measure_btf(patch, tmp_path / "a.nacre", both, both, Settings(2, 1))
    brdf = dataset.samples[:, :, 0, 0].astype(float) / both[:, None, 2:]
    assert brdf.max() > 2 * brdf.min()
    np.testing.assert_allclose(brdf, brdf.swapaxes(0, 1), rtol=3e-3)


def test_noise_floor_is_what_other_seeds_differ_by(tmp_path, make_patch):
    patch = make_patch((*WHOLE, 0, WHITE), ((-0.3, -0.2), (0.33, 0.27), 0.4, GREEN))
    light = ubo_81()[::8]
    found = [
        measure_btf(patch, tmp_path / "a.nacre", light, light, Settings(8, 2, seed=seed))
        for seed in (0, 1000, 0)
    ]
    first, other, again = (dataset.samples.astype(float) for dataset in found)
    np.testing.assert_array_equal(first, again)
    measured = 10 * np.log10((first**2).sum() / ((first - other) ** 2).sum() * 2)
    assert abs(found[0].noise_floor_db - measured) < 1.5


def test_nothing_but_finished_pictures_is_left_behind(tmp_path, make_patch):
    patch = make_patch((*WHOLE, 0, WHITE))
    before = _everything()
    with pytest.raises(Cancelled):
        measure_btf(
            patch, tmp_path / "a.nacre", ubo_81()[:4], UP, Settings(1, 1),
            progress=lambda fraction, _: fraction < 0.5,
        )  # fmt: skip
    assert _everything() == before
    assert [path.name for path in tmp_path.iterdir()] == [".a.nacre.measuring"]
    measure_btf(patch, tmp_path / "a.nacre", UP, UP, Settings(1, 1), restart=True)
    assert _everything() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.nacre"]


def test_mistakes(tmp_path, make_patch):
    with pytest.raises(NacreError, match="holds nothing that renders"):
        measure_btf(make_patch(), tmp_path / "a.nacre", UP, UP, Settings(1))
    below = spherical_to_unit([90], [0])
    with pytest.raises(NacreError, match="light direction lies at or below the horizon"):
        measure_btf(make_patch((*WHOLE, 0, WHITE)), tmp_path / "a.nacre", below, UP, Settings(1))
    assert not list(tmp_path.iterdir())
