"""sparse.glsl against the same tables on the CPU."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest

pytest.importorskip("nacre_native")

from small_sparse import model_of

import addon
from addon.datasets.directions import spherical_to_unit
from addon.errors import NacreError
from addon.models.sparse.files import save_sparse
from addon.nodes.material import material_from_tables, set_blended
from addon.preview import textures
from addon.preview.appearance import Appearance, appearance_of, tables_of
from addon.preview.flat import FlatEvaluator
from addon.preview.picture import camera_picture
from addon.preview.shader import constants
from addon.preview.textures import laid_out
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.tables.sparse_evaluate import evaluate_sparse_patch, evaluate_sparse_points
from addon.tables.sparse_tables import SparseTables, build_sparse_tables
from benchmarks._glsl import Screen
from benchmarks._image_space import ImageSpace
from benchmarks._sparse_tables import random_sparse_tables

pytestmark = pytest.mark.usefixtures("need_gpu")

PAIRS = [((0, 0), (0, 0)), ((31, 47), (12, 250)), ((63, 201), (45, 300)), ((81, 5), (70, 100))]
SHAPES = {
    "plain": {},
    "rows of one quad": {"rows": (1, 2, 3)},
    "patches over the edges": {"texels": (10, 13), "patch": (4, 4)},
    "more rows than layers": {"rows": (3, 8300, 8300), "counts": (90, 2, 2), "size": 8},
}


@pytest.fixture(params=SHAPES, ids=SHAPES)
def tables(request) -> SparseTables:
    return random_sparse_tables(**SHAPES[request.param])


def directions(pair):
    return tuple(spherical_to_unit([theta], [phi]) for theta, phi in pair)


def relative(seen, expected):
    return np.abs(seen - expected).mean() / np.abs(expected).mean()


def test_patch_is_that_of_the_cpu(tables):
    evaluator = FlatEvaluator(tables)
    for pair in PAIRS:
        light, view = directions(pair)
        expected = evaluate_sparse_patch(tables, light, view)[0]
        assert expected.std() > 0.1 * expected.mean()
        assert relative(evaluator.picture(light[0], view[0]), expected) < 5e-3


def test_magnified_and_across_the_seam():
    """The nearest texel, from outside the material."""
    tables = random_sparse_tables()
    width, height, offset = 37, 41, (-1.313, 0.2071)
    y, x = np.mgrid[:height, :width]
    uv = np.stack([(x + 0.5) / width + offset[0], (y + 0.5) / height + offset[1]], -1)
    light, view = directions(PAIRS[1])
    seen = FlatEvaluator(tables).picture(light[0], view[0], (width, height), offset=offset)
    lights, views = (np.repeat(own, width * height, 0) for own in (light, view))
    expected = evaluate_sparse_points(tables, lights, views, uv.reshape(-1, 2))
    assert relative(seen, expected.reshape(seen.shape)) < 5e-3


def test_four_taps_by_hand_are_the_hardware_filter(monkeypatch):
    tables = random_sparse_tables()
    light, view = directions(PAIRS[2])
    for module in ("textures", "shader"):
        monkeypatch.setattr(f"addon.preview.{module}.can_filter", lambda: False)
    seen = FlatEvaluator(tables).picture(light[0], view[0])
    assert relative(seen, evaluate_sparse_patch(tables, light, view)[0]) < 5e-3


def test_light_fades_below_the_lowest_measured_one():
    tables = random_sparse_tables()
    evaluator = FlatEvaluator(tables)
    (light, view), low = directions(PAIRS[0]), spherical_to_unit([85.0], [30.0])
    expected = evaluate_sparse_patch(tables, low, view)[0]
    assert relative(evaluator.picture(low[0], view[0]), expected) < 5e-3
    below = evaluator.picture(np.array([0.8, 0.0, -0.6]), view[0])
    np.testing.assert_array_equal(below, 0.0)
    assert evaluator.picture(light[0], view[0]).min() >= 0.0


def test_models_of_about_one_size_share_a_shader():
    shapes = [constants(laid_out(random_sparse_tables(rows=(9, 4, 9), seed=n))) for n in (0, 1)]
    assert shapes[0] == shapes[1]
    assert shapes[0] != constants(laid_out(random_sparse_tables(texels=(16, 20))))


@pytest.mark.parametrize("suns", [1, 3])
def test_fetches_are_those_of_coefficients_and_listed_quads(suns):
    """Fewer than reading every coefficient's rows, for one light and more so for several."""
    tables = random_sparse_tables(counts=(80, 20, 20))
    layout = laid_out(tables)
    heads = layout.lists[0, 0, :6]
    coefficients, quads = heads[::2, 1].sum(), heads[1::2, :3].sum(0)  # of texels, light, view
    # Heads, each quad's number, and quads; those of light rows for each light.
    once, each = 6 + coefficients + 2 * (quads[0] + quads[2]) + quads[1], quads[1]
    images = sum(layout.images[0])
    screen = Screen(layout, (8, 8), suns)
    counted = screen.pixels(screen.counted())
    expected = once + images + suns * (each + images)
    assert counted.min() == counted.max() == expected
    assert expected < suns * sum(tables.fetches.values())


def test_image_space_takes_nine_times_the_coefficients():
    """What the benchmark compares with: colours close by, and every neighbour's fetches."""
    model = model_of()
    screens = [
        Screen(laid_out(build_sparse_tables(model, 32)), (24, 16), 2),
        ImageSpace(model, (24, 16), 2, maps=32),
        ImageSpace(model, (24, 16), 2, shared=True, maps=32),
    ]
    ours, whole, shared = (screen.pixels(screen.engine())[..., :3] for screen in screens)
    np.testing.assert_allclose(shared, whole, rtol=1e-4, atol=1e-5)
    assert 1e-4 < relative(whole, ours) < 0.08
    counts = [screen.pixels(screen.counted()).max() for screen in screens]
    assert counts[1] > 18 * 36 and counts[2] < counts[1] / 2


def test_bytes_are_those_of_the_textures():
    layout = laid_out(random_sparse_tables())
    halves = (layout.coefficients, layout.texels, layout.light, layout.view)
    expected = 2 * sum(own.size for own in halves) + 4 * layout.lists.size
    assert textures.upload(layout).bytes == expected


@pytest.mark.parametrize("patches", [(1, 1), (2, 2), (3, 5)])
def test_far_away_every_pixel_is_the_mean_of_the_logarithms(patches):
    """Of all patches, whatever the offset, and also where the material repeats: as exact as the
    coefficients have room for all products of light and view rows."""
    texels = tuple(8 * count for count in patches)
    tables = random_sparse_tables((40, 30, 30), (6, 3, 4), patch=(8, 8), texels=texels)
    light, view = directions(PAIRS[1])
    whole = evaluate_sparse_patch(tables, light, view)[0]
    assert whole.min() > 0.0
    logarithms = np.log1p(whole / tables.offset)
    blocks = logarithms.reshape(patches[0], 8, patches[1], 8, 3).mean((1, 3))
    expected = np.expm1(blocks.mean((0, 1))) * tables.offset
    evaluator = FlatEvaluator(tables)
    for offset in ((0.0, 0.0), (0.37, -0.21)):
        seen = evaluator.picture(light[0], view[0], (8, 8), 96.0, offset)
        np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), rtol=1e-2)


def test_pixels_larger_than_patches_show_their_means():
    """Of 2 x 2 patches each, in their places."""
    tables = random_sparse_tables((40, 30, 30), (6, 3, 4), patch=(4, 4), texels=(16, 32))
    light, view = directions(PAIRS[1])
    logarithms = np.log1p(evaluate_sparse_patch(tables, light, view)[0] / tables.offset)
    expected = np.expm1(logarithms.reshape(2, 8, 4, 8, 3).mean((1, 3))) * tables.offset
    seen = FlatEvaluator(tables).picture(light[0], view[0], (4, 2))
    assert relative(seen, expected) < 5e-3


def test_levels_are_mixed_without_a_jump():
    """From texel size to the whole patch, the contrast falls step by step."""
    tables = random_sparse_tables(texels=(16, 16), patch=(16, 16), counts=(60, 20, 20))
    light, view = directions(PAIRS[1])
    evaluator = FlatEvaluator(tables)

    def contrast(repeats: float) -> float:
        seen = evaluator.picture(light[0], view[0], (64, 64), repeats, (0.013, 0.021))
        return np.log1p(seen / tables.offset).std((0, 1)).mean()

    for whole in (4.0, 8.0, 16.0):  # 64 pixels and 16 texels: 4 repeats are the finest level
        assert contrast(1.003 * whole) == pytest.approx(contrast(0.997 * whole), rel=0.1)
    falling = [contrast(repeats) for repeats in (4.02, 9.0, 20.0, 33.0, 70.0)]
    assert all(later < earlier for earlier, later in zip(falling, falling[1:], strict=False))


def test_a_map_that_only_repeats_changes_nothing():
    tables = random_sparse_tables()
    light, view = directions(PAIRS[1])
    repeats = np.indices((24, 40)).transpose(1, 2, 0) % (12, 20)
    plain, laid = (
        FlatEvaluator(tables, coordinates=coordinates).picture(light[0], view[0], (40, 24), patches)
        for coordinates, patches in ((None, 2.0), (repeats, 2.0))
    )
    np.testing.assert_allclose(laid, plain, rtol=1e-3)


def logarithm(tables, pair):
    light, view = directions(pair)
    return np.log1p(evaluate_sparse_patch(tables, light, view)[0] / tables.offset)


def test_a_blend_is_the_sum_of_logarithms_by_weight():
    """Two and three materials of other rows, means and deviations; weights change live."""
    materials = [
        random_sparse_tables(rows=rows, seed=seed)
        for seed, rows in enumerate([(11, 9, 14), (7, 13, 5), (20, 4, 9)])
    ]
    for several in (materials[:2], materials):
        evaluator = FlatEvaluator(*several)
        for weights in ((1.0, 0.0, 0.0), (0.3, 0.7, 0.0), (0.5, 0.25, 0.25))[: len(several)]:
            evaluator.weights = weights[: len(several)]
            mixed = sum(
                w * logarithm(one, PAIRS[1]) for w, one in zip(weights, several, strict=False)
            )
            light, view = directions(PAIRS[1])
            seen = evaluator.picture(light[0], view[0])
            assert relative(seen, np.expm1(mixed) * several[0].offset) < 5e-3


def test_a_mask_has_weights_for_every_texel():
    materials = [random_sparse_tables(seed=seed) for seed in (0, 1)]
    mask = np.random.default_rng(2).random((12, 20))
    masks = np.stack([mask, 1.0 - mask])
    evaluator = FlatEvaluator(*materials, weights=(1.0, 1.0), masks=masks)
    light, view = directions(PAIRS[1])
    mixed = sum(
        own[..., None] * logarithm(one, PAIRS[1]) for own, one in zip(masks, materials, strict=True)
    )
    expected = np.expm1(mixed) * materials[0].offset
    assert relative(evaluator.picture(light[0], view[0]), expected) < 5e-3
    with pytest.raises(NacreError, match="20 x 12 for 2"):
        FlatEvaluator(*materials, weights=(1.0, 1.0), masks=masks[:, :-1])
    far = evaluator.picture(light[0], view[0], (4, 4), 400.0)
    alone = [FlatEvaluator(one).picture(light[0], view[0], (4, 4), 400.0) for one in materials]
    half = np.exp(sum(0.5 * np.log(own) for own in alone))  # the mask's mean is about a half
    assert relative(far, half) < 0.1


def test_a_material_shows_what_its_nodes_hold():
    addon.register()
    try:
        tables = random_sparse_tables(size=16)
        material = material_from_tables(tables, "Sparse")
        shown, expected = appearance_of(material).btf, laid_out(tables)
        assert appearance_of(material).btf is shown
    finally:
        addon.unregister()
    assert constants(shown) == constants(expected)
    for name in ("coefficients", "lists", "texels", "light", "view"):
        np.testing.assert_allclose(
            getattr(shown, name), getattr(expected, name), rtol=1e-3, atol=1e-3
        )


def test_a_material_shows_the_blend_that_its_nodes_hold():
    """By its input Mix, which is live; what cannot be mixed here is told."""
    tables, second = (random_sparse_tables(size=16, seed=seed) for seed in (0, 1))
    addon.register()
    try:
        material = material_from_tables(tables, "Sparse")
        set_blended(material, second)
        node = next(n for n in material.node_tree.nodes if "Mix" in n.inputs)
        node.inputs["Mix"].default_value = 0.25
        before = appearance_of(material)
        node.inputs["Mix"].default_value = 1.0
        after = appearance_of(material)
        value = material.node_tree.nodes.new("ShaderNodeValue")
        material.node_tree.links.new(value.outputs[0], node.inputs["Mix"])
        linked = appearance_of(material)
        set_blended(material, random_sparse_tables(size=16, texels=(16, 20)))
        unlike = appearance_of(material)
    finally:
        addon.unregister()
    assert (before.weights, after.weights) == ((0.75, 0.25), (0.0, 1.0))
    assert before.btf is after.btf and not after.message
    assert linked.weights == after.weights
    assert (
        not linked.message and linked.note == "Sparse: mixed by 1 all over, not by what is linked"
    )
    assert constants(before.btf) == constants(laid_out(tables, second))
    assert unlike.weights == () and constants(unlike.btf) == constants(laid_out(tables))
    assert "Sparse: shown unmixed" in unlike.message and "height 16, not 12" in unlike.message


def test_a_model_file_is_shown(tmp_path):
    """What the nodes' images need not hold: the engine reads the file."""
    model = model_of()
    save_sparse(model, tmp_path / "model.exr")
    shown, message = tables_of(str(tmp_path / "model.exr"))
    assert not message
    expected = laid_out(build_sparse_tables(model))
    assert (shown.patches, shown.levels) == (expected.patches, expected.levels)
    assert shown.offset == expected.offset


def test_what_does_not_go_together_is_refused():
    one, other = random_sparse_tables(), random_sparse_tables(texels=(16, 20))
    with pytest.raises(NacreError, match="material 2 .* height 16, not 12"):
        laid_out(one, other)
    with pytest.raises(NacreError, match="4 at most"):
        laid_out(*[one] * 5)


def test_a_scene_shows_the_value_times_the_light():
    """The engine's own surfaces, looked at and lit straight on and aslant."""
    whole = random_sparse_tables()
    flat = {key: replace(p, texels=np.ones_like(p.texels)) for key, p in whole.parts.items()}
    patch = {key: replace(p, coefficients=p.coefficients[:, :1, :1]) for key, p in flat.items()}
    tables = replace(whole, parts=patch, height=4, width=5)
    shown = laid_out(tables)
    light, view = (25.0, 40.0), (35.0, 200.0)
    material = bpy.data.materials.new("Sparse")
    looks = [Appearance(btf=shown), Appearance(btf=laid_out(tables, tables), weights=(0.4, 0.6))]
    with new_scene((48, 48)) as scene:
        add_mesh(scene, "plane", material)
        add_camera(scene, view, 0.5)
        add_sun(scene, light)
        layer = scene.view_layers[0]
        layer.update()
        pictures = [
            camera_picture(layer.depsgraph, (48, 48), 4, lambda _material, own=own: own)
            for own in looks
        ]
    units = [spherical_to_unit([theta], [phi]) for theta, phi in (light, view)]
    expected = evaluate_sparse_patch(tables, *units)[0, 0, 0]
    for pixels, messages in pictures:
        assert not messages
        np.testing.assert_allclose(
            pixels[..., :3], np.broadcast_to(expected, (48, 48, 3)), rtol=5e-3, atol=1e-4
        )
