"""evaluate.glsl against the same tables on the CPU, for every way that modes may be clustered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.preview import textures
from addon.preview.flat import FlatEvaluator
from addon.preview.shader import constants
from addon.tables.evaluate import evaluate_occlusion, evaluate_patch, evaluate_points

pytestmark = pytest.mark.usefixtures("need_gpu")

PAIRS = [((0, 0), (0, 0)), ((30, 40), (12, 250)), ((63, 201), (45, 300)), ((84, 5), (88, 100))]
SHAPES = {
    "N-SVD": {"rank": 9, "view_quads": 3},
    "K-CTA": {"clusters": (1, 5), "mixtures": (1, 3)},
    "K-CTA, light rows of clusters": {
        "clusters": (1, 5),
        "mixtures": (1, 3),
        "owners": (5, 1),
    },
    "MK-CTA": {
        "clusters": (4, 7),
        "mixtures": (3, 5),
        "owners": (7, 4),
        "rank": 4,
        "view_quads": 1,
    },
    "lights clustered": {"clusters": (6, 1), "mixtures": (5, 1), "owners": (1, 6)},
    "more blocks than layers": {
        "clusters": (1, 30),
        "mixtures": (1, 2),
        "rank": 40,
        "texels": (4, 3),
    },
}


@pytest.fixture(params=SHAPES, ids=SHAPES)
def tables(request, random_tables):
    return random_tables(**SHAPES[request.param])


def directions(pair):
    return tuple(spherical_to_unit([theta], [phi]) for theta, phi in pair)


def relative(seen, expected):
    return np.abs(seen - expected).mean() / np.abs(expected).mean()


def test_patch_is_that_of_the_cpu(tables):
    evaluator = FlatEvaluator(tables)
    for pair in PAIRS:
        light, view = directions(pair)
        seen = evaluator.picture(light[0], view[0])
        assert relative(seen, evaluate_patch(tables, light, view)[0, 0]) < 1e-3


def test_between_texels_and_across_the_seam(tables):
    """Magnified, from outside the patch: bilinear, repeating with it."""
    evaluator = FlatEvaluator(tables)
    width, height, offset = 40, 36, (-1.3, 0.2)
    y, x = np.mgrid[:height, :width]
    uv = np.stack([(x + 0.5) / width + offset[0], (y + 0.5) / height + offset[1]], -1).reshape(
        -1, 2
    )
    light, view = directions(PAIRS[1])
    seen = evaluator.picture(light[0], view[0], (width, height), offset=offset)
    lights, views = (np.repeat(direction, len(uv), 0) for direction in (light, view))
    expected = evaluate_points(tables, lights, views, uv).reshape(height, width, 3)
    assert relative(seen, expected) < 2e-3


def test_four_taps_by_hand_are_the_hardware_filter(tables, monkeypatch):
    """Where textures cannot be told to filter, as in 4.5."""
    light, view = directions(PAIRS[2])
    hardware = FlatEvaluator(tables).picture(light[0], view[0], (33, 29))
    for module in ("textures", "shader"):
        monkeypatch.setattr(f"addon.preview.{module}.can_filter", lambda: False)
    assert relative(FlatEvaluator(tables).picture(light[0], view[0], (33, 29)), hardware) < 2e-3


def test_light_below_the_horizon_is_black(tables):
    seen = FlatEvaluator(tables).picture(np.array([0.8, 0.0, -0.6]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_array_equal(seen, 0.0)


def test_occlusion(random_tables):
    tables = random_tables(clusters=(1, 5), mixtures=(1, 2), rank=1, occlusion=True)
    evaluator = FlatEvaluator(tables)
    for _, pair in PAIRS:
        _, view = directions((pair, pair))
        seen = evaluator.picture(np.array([0.0, 0.0, 1.0]), view[0])
        expected = np.repeat(evaluate_occlusion(tables, view)[0][..., None], 3, -1)
        assert relative(seen, expected) < 1e-3


def test_far_away_every_pixel_is_the_mean_of_the_patch(random_tables):
    """Four patches to a pixel: the coarsest level, whatever the offset. Values stay above 0, as the
    filter averages the core and not what is clamped."""
    tables = random_tables(clusters=(1, 5), mixtures=(1, 3))
    tables = replace(
        tables, core=np.abs(tables.core), light=np.abs(tables.light), view=np.abs(tables.view)
    )
    light, view = directions(PAIRS[1])
    mean = evaluate_patch(tables, light, view)[0, 0].mean((0, 1))
    evaluator = FlatEvaluator(tables)
    for offset in ((0.0, 0.0), (0.37, -0.21)):
        seen = evaluator.picture(light[0], view[0], (8, 8), patches=8 * 16.0, offset=offset)
        np.testing.assert_allclose(seen, np.broadcast_to(mean, seen.shape), rtol=3e-3)


def test_levels_are_mixed_without_a_jump(random_tables):
    """From texel size to the whole patch, the contrast falls step by step."""
    tables = random_tables(texels=(32, 32))
    light, view = directions(PAIRS[1])
    evaluator = FlatEvaluator(tables)

    def contrast(patches: float) -> float:
        return evaluator.picture(light[0], view[0], (64, 64), patches=patches).std()

    # 64 pixels and 32 texels: 2 patches are the finest level alone, 4 the next.
    for whole in (2.0, 4.0, 8.0):
        assert contrast(1.003 * whole) == pytest.approx(contrast(0.997 * whole), rel=0.1)
    falling = [contrast(patches) for patches in (2.01, 5.0, 12.0, 24.0, 64.0)]
    assert all(later < earlier for earlier, later in zip(falling, falling[1:], strict=False))
    assert falling[-1] < 0.1 * falling[0]


LAID = {"magnified": 1.7, "texel for texel": 3.0, "small": 8.6, "far": 80.0}


@pytest.mark.parametrize("name", LAID)
def test_a_map_that_only_repeats_changes_nothing(name, smooth_tables):
    """At any size, and where coordinates jump from the patch's end to its beginning: levels come
    from the unwrapped UVs."""
    tables = smooth_tables((2, 2), apart=True, texels=(32, 16))
    light, view = directions(PAIRS[1])
    repeats = np.indices((64, 64)).transpose(1, 2, 0) % (32, 16)
    plain, laid = (
        FlatEvaluator(tables, coordinates=coordinates).picture(
            light[0], view[0], (48, 96), LAID[name]
        )
        for coordinates in (None, repeats)
    )
    assert plain.std() > 1e-3 * plain.mean()
    np.testing.assert_allclose(laid, plain, rtol=1e-3)


def test_a_map_of_coordinates_in_the_distance_is_what_its_texels_average_to(smooth_tables):
    """Squares of the patch laid at random: against pixels of the finest level, averaged."""
    tables = smooth_tables((1, 2), texels=(32, 32))
    light, view = directions(PAIRS[1])
    size, square = 128, 16
    rng = np.random.default_rng(2)
    moves = rng.integers(0, 32, (size // square, size // square, 2))
    moves = moves.repeat(square, 0).repeat(square, 1)
    coordinates = (np.indices((size, size)).transpose(1, 2, 0) + moves) % 32
    evaluator = FlatEvaluator(tables, coordinates=coordinates)

    def seen(pixels: int) -> np.ndarray:
        return evaluator.picture(light[0], view[0], (pixels, pixels), size / 32)

    finest = seen(size)
    for step in (2, 4, 8, 32):
        boxes = finest.reshape(size // step, step, size // step, step, 3)
        average, single = boxes.mean((1, 3)), boxes[:, step // 2, :, step // 2]
        found = np.abs(seen(size // step) - average).mean()
        # Linear filters blur over a box's edge; single texels sparkle.
        assert found < (0.75 if step == 2 else 0.5) * np.abs(single - average).mean()


def test_tables_of_one_shape_share_a_shader(random_tables):
    first, second = random_tables(rank=7), random_tables(rank=7)
    assert constants(first) == constants(replace(second, core=second.core * 2))
    assert constants(first) != constants(random_tables(rank=6))


def test_bytes_are_those_of_half_floats(random_tables):
    tables = random_tables(clusters=(1, 5), mixtures=(1, 3), texels=(1, 1), rank=4, view_quads=1)
    maps = 32 * 32 * (3 + 3 + 1)  # light channels, view mixtures, one quad of clusters
    core = 5 * 4 * 3 * 3  # one texel and its border
    assert textures.upload(tables).bytes == 8 * (maps + core)


def test_too_large_tables_say_so():
    with pytest.raises(textures.NacreError, match="lower ranks or fewer clusters"):
        textures.texture_array(np.zeros((textures.LAYERS + 1, 1, 1, 4), np.float32))
