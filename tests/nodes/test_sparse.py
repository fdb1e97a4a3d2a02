"""Sparse models in node groups against the same tables on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from small_sparse import model_of

from addon import live
from addon.errors import NacreError
from addon.nodes.material import (
    MODEL_NODE,
    group_of,
    is_nacre_material,
    material_from_tables,
    needs_osl,
    set_blended,
    set_coordinates,
    set_coverage,
    set_final_tables,
    set_lights,
    set_tables,
    swap_final,
)
from addon.nodes.node_tables import build_node_tables
from addon.nodes.packed_tables import is_sparse, stored, unpack
from addon.render.engines import render_pixels, set_engine
from addon.render.pictures import flat_scene
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene, unit
from addon.tables.parabolic import texel_directions
from addon.tables.sparse_evaluate import evaluate_sparse_patch, evaluate_sparse_points
from addon.tables.sparse_tables import Part, Product, SparseTables
from addon.tables.tables import Tables, build_tables

ENGINES = pytest.mark.parametrize(
    "engine", ["cycles", "eevee"] if bpy.app.version >= (5, 0) else ["cycles"]
)
"""Those that evaluate the tables themselves: EEVEE loops since Blender 5.0."""

PAIRS = (((0.0, 0.0), (0.0, 0.0)), ((30.0, 60.0), (60.0, 90.0)), ((82.0, 13.0), (47.0, 251.0)))
SIZE = 16


def sparse_tables(seed: int = 0, offset: float = 0.01) -> SparseTables:
    """10 x 9 texels in patches of 4 x 5, which do not fill them; parts of different counts and
    rows, maps that change slowly."""
    random = np.random.default_rng(seed)
    x, y, z = np.moveaxis(texel_directions(SIZE), -1, 0)
    basis = np.stack([np.ones_like(x), x, y, z, x * y, x * z])

    def maps(rows: int) -> np.ndarray:
        mixed = np.einsum("rb,byx->ryx", random.normal(0, 0.7, (rows, len(basis))), basis)
        return mixed.astype(np.float32)

    def product(level: float) -> Product:
        light, view = (0.2 * maps(8).reshape(2, 4, SIZE, SIZE) for _ in range(2))
        light[0, 0], view[0, 0] = level, 1.0
        return Product(*(np.moveaxis(own, 1, -1).copy() for own in (light, view)))

    parts = {}
    for key, (count, texels, lights, views) in {
        "Y": (7, 5, 3, 4),
        "U": (3, 2, 2, 1),
        "V": (2, 1, 4, 2),
    }.items():
        coefficients = np.empty((count, 3, 2, 4), np.float32)
        coefficients[..., 0] = random.normal(0, 0.6, (count, 3, 2))
        for column, rows in enumerate((texels, lights, views), 1):
            coefficients[..., column] = random.integers(0, rows, (count, 3, 2))
        parts[key] = Part(
            coefficients=coefficients,
            texels=random.normal(0, 1, (texels, 4, 5)).astype(np.float32),
            light=maps(lights),
            view=maps(views),
        )
    parts["Y"] = brightened(parts["Y"], 7.0)
    return SparseTables(
        parts, product(-0.4), product(0.5), lowest=0.3, offset=offset, height=10, width=9
    )


def brightened(part: Part, constant: float) -> Part:
    """A part with a coefficient more, of the same value everywhere: what keeps colours above 0."""
    first = np.empty_like(part.coefficients[:1])
    first[:] = (constant, len(part.texels), len(part.light), len(part.view))

    def with_ones(rows: np.ndarray) -> np.ndarray:
        return np.concatenate([rows, np.ones_like(rows[:1])])

    return Part(
        np.concatenate([first, part.coefficients]),
        *(with_ones(rows) for rows in (part.texels, part.light, part.view)),
    )


def check(tables: SparseTables, seen: np.ndarray, light: tuple, view: tuple) -> None:
    expected = evaluate_sparse_patch(tables, unit(light)[None], unit(view)[None])[0]
    assert expected.mean() > 0.01
    assert np.abs(seen - expected).mean() < 0.002 * expected.mean(), (light, view)


def test_packed_tables_come_out_again() -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    assert is_nacre_material(material) and is_sparse(group_of(material))
    again = unpack(stored(group_of(material)))
    assert list(again.parts) == ["Y", "U", "V"]
    pairs = [(again.parts[key], part) for key, part in tables.parts.items()]
    pairs += [(again.mean, tables.mean), (again.deviation, tables.deviation)]
    for found, expected in pairs:
        for name, array in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, name), array, err_msg=name)
    for name in ("lowest", "offset", "height", "width"):
        assert getattr(again, name) == getattr(tables, name)


@ENGINES
def test_flat_patch_is_the_tables(engine: str) -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (9, 10), engine) as flat:
        for light, view in PAIRS:
            flat.aim(light, view)
            check(tables, render_pixels(flat.scene), light, view)


@ENGINES
def test_several_lights_add_up_as_colours(engine: str) -> None:
    """Not as logarithms; and none below the horizon."""
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    lights, view = ((20.0, 30.0), (60.0, 140.0), (120.0, 20.0)), (35.0, 80.0)
    with flat_scene(material, (9, 10), engine) as flat:
        for light in lights:
            add_sun(flat.scene, light)
        set_lights(material, flat.scene)
        flat.view.default_value = unit(view)
        seen = render_pixels(flat.scene)
        expected = [
            evaluate_sparse_patch(tables, unit(light)[None], unit(view)[None])[0]
            for light in lights
        ]
        assert not expected[2].any()
        assert np.abs(seen - np.sum(expected, 0)).mean() < 0.002 * np.sum(expected, 0).mean()
        for item in [item for item in flat.scene.objects if item.type == "LIGHT"]:
            bpy.data.objects.remove(item)
        set_lights(material, flat.scene)
        assert not render_pixels(flat.scene).any()


@ENGINES
def test_oblique_camera_sees_points(engine: str) -> None:
    """The whole path: camera, tangent frame, sun and repeated texture, pixel by pixel."""
    tables = sparse_tables()
    light, view = (40.0, 200.0), (50.0, 320.0)
    material = material_from_tables(tables, "Test")
    with new_scene((48, 48)) as scene:
        plane = add_mesh(scene, "plane", material)
        for corner in plane.data.uv_layers.active.uv:
            corner.vector = [3.0 * value - 1.0 for value in corner.vector]
        camera = add_camera(scene, view, 0.5)
        add_sun(scene, light)
        set_lights(material, scene)
        set_engine(scene, engine, 1)
        scene.cycles.shading_system = True
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        seen = render_pixels(scene)
        steps = (np.arange(48) + 0.5) / 48 - 0.5
        right, up, towards = np.array(camera.matrix_world.to_3x3()).T
        origin = 0.5 * (steps[None, :, None] * right + steps[:, None, None] * up)
        hit = origin - towards * (origin[..., 2:] / towards[2])
    uv = (3.0 * (hit[..., :2] + 0.5) - 1.0).reshape(-1, 2)
    directions = [np.repeat(unit(own)[None], len(uv), 0) for own in (light, view)]
    expected = evaluate_sparse_points(tables, *directions, uv).reshape(seen.shape)
    # Pixels on the border of two texels may be of either.
    alike = np.abs(seen - expected).max(-1) < 0.01 * expected.mean()
    assert alike.mean() > 0.98


@ENGINES
def test_a_map_of_coordinates_lays_the_patch_anew(engine: str) -> None:
    tables = sparse_tables()
    random = np.random.default_rng(5)
    coordinates = np.stack([random.integers(0, 10, (20, 18)), random.integers(0, 9, (20, 18))], -1)
    material = material_from_tables(tables, "Test")
    set_coordinates(material, coordinates)
    light, view = PAIRS[1]
    patch = evaluate_sparse_patch(tables, unit(light)[None], unit(view)[None])[0]
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(light, view)
        y, x = np.moveaxis(coordinates[:10, :9], -1, 0)
        assert np.abs(render_pixels(flat.scene) - patch[y, x]).mean() < 0.002 * patch.mean()


def kept() -> tuple[int, int]:
    """Images, and groups of this material."""
    images = [own for own in bpy.data.images if own.type == "IMAGE"]
    return len(images), len([own for own in bpy.data.node_groups if "Test" in own.name])


@ENGINES
def test_other_tables_in_place(engine: str, tables: Tables) -> None:
    """Of another method, and back; the links of the material stay, and nothing else."""
    first, second = sparse_tables(), sparse_tables(1)
    material = material_from_tables(first, "Test")
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(*PAIRS[1])
        before, links = kept(), len(material.node_tree.links)
        set_tables(material, tables)
        assert not is_sparse(group_of(material))
        set_tables(material, second)
        assert kept() == before and len(material.node_tree.links) == links
        flat.aim(*PAIRS[1])
        check(second, render_pixels(flat.scene), *PAIRS[1])


@ENGINES
def test_final_render_shows_other_tables(engine: str) -> None:
    first, second = sparse_tables(), sparse_tables(1)
    material = material_from_tables(first, "Test")
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(*PAIRS[1])
        before = kept()
        set_final_tables(material, second)
        swap_final(material)
        flat.view = material.node_tree.nodes["Nacre Model"].inputs["View"]
        flat.aim(*PAIRS[1])
        check(second, render_pixels(flat.scene), *PAIRS[1])
        swap_final(material)
        set_final_tables(material, None)
        assert kept() == before


@ENGINES
def test_material_survives_saving(engine: str, tmp_path) -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    path = tmp_path / "material.blend"
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(*PAIRS[1])
    bpy.data.libraries.write(str(path), {material}, fake_user=True)
    for file in Path(bpy.app.tempdir).glob("nacre-*"):
        file.unlink()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (source, target):
        target.materials = source.materials
    (material,) = target.materials
    assert is_nacre_material(material)
    live.follow_files()
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(*PAIRS[1])
        check(tables, render_pixels(flat.scene), *PAIRS[1])


def test_cycles_without_scripts_shows_the_average_colour() -> None:
    """Neither pink nor white."""
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    assert needs_osl(material)
    with flat_scene(material, (4, 4), "cycles") as flat:
        flat.aim((45.0, 45.0), (0.0, 0.0))
        flat.scene.cycles.shading_system = False
        seen = render_pixels(flat.scene)
    light, view = (unit(own)[None] for own in ((45.0, 45.0), (0.0, 0.0)))
    average = evaluate_sparse_patch(tables, light, view)[0].mean((0, 1))
    np.testing.assert_allclose(seen, np.broadcast_to(average, seen.shape), rtol=1e-3)


def test_many_lights_take_several_scripts() -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    lights, view = [(20.0 + 9 * number, 50.0 * number) for number in range(6)], (35.0, 80.0)
    with flat_scene(material, (9, 10), "cycles") as flat:
        for light in lights:
            add_sun(flat.scene, light)
        set_lights(material, flat.scene)
        flat.view.default_value = unit(view)
        seen = render_pixels(flat.scene)
    views = np.repeat(unit(view)[None], 6, 0)
    expected = evaluate_sparse_patch(tables, np.array([unit(own) for own in lights]), views).sum(0)
    assert np.abs(seen - expected).mean() < 0.002 * expected.mean()


@pytest.mark.parametrize("later", [False, True])
def test_holes_are_in_both_outputs(later: bool, make_model: Callable) -> None:
    """Also where the sparse model comes after the holes; and they go again."""
    tensor = build_tables(make_model(texels=(12, 10)), size=32)
    holes = replace(tensor, light=None, core=tensor.core[:, :, :1] * 0.0)
    material = material_from_tables(tensor if later else sparse_tables(), "Test")
    set_coverage(material, holes)
    if later:
        set_tables(material, sparse_tables())
    with flat_scene(material, (4, 4), "cycles") as flat:
        flat.scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
        flat.aim(*PAIRS[1])
        assert not render_pixels(flat.scene).any()
        set_coverage(material, None)
        assert render_pixels(flat.scene).mean() > 0.01
    outputs = [node for node in material.node_tree.nodes if node.type == "OUTPUT_MATERIAL"]
    assert {output.target for output in outputs} == {"EEVEE", "CYCLES"}


def mixed(one: SparseTables, other: SparseTables, light: tuple, view: tuple, mix) -> np.ndarray:
    """The patch of mixed logarithms (Eq. 7)."""
    logarithms = [
        np.log(
            evaluate_sparse_patch(replace(own, lowest=0.01), unit(light)[None], unit(view)[None])[0]
            + own.offset
        )
        for own in (one, other)
    ]
    colour = np.exp(logarithms[0] * (1 - mix) + logarithms[1] * mix) - one.offset
    return np.maximum(colour, 0.0) * min(unit(light)[2] / one.lowest, 1.0)


@ENGINES
def test_two_models_mix_as_logarithms(engine: str) -> None:
    """By a number and by a mask; also in what takes their place for a final render."""
    one, other = sparse_tables(), sparse_tables(1)
    material = material_from_tables(one, "Test")
    before = kept()
    set_blended(material, other)
    node = material.node_tree.nodes[MODEL_NODE]
    light, view = PAIRS[1]
    with flat_scene(material, (9, 10), engine) as flat:
        flat.aim(light, view)
        for mix in (0.0, 0.3, 1.0):
            node.inputs["Mix"].default_value = mix
            seen, expected = render_pixels(flat.scene), mixed(one, other, light, view, mix)
            assert np.abs(seen - expected).mean() < 0.002 * expected.mean(), mix
        separate = material.node_tree.nodes.new("ShaderNodeSeparateXYZ")
        material.node_tree.links.new(node.inputs["UV"].links[0].from_socket, separate.inputs[0])
        material.node_tree.links.new(separate.outputs[0], node.inputs["Mix"])
        mask = (np.arange(9) + 0.5)[:, None] / 9
        expected = mixed(one, other, light, view, mask)
        assert np.abs(render_pixels(flat.scene) - expected).mean() < 0.002 * expected.mean()
        set_final_tables(material, sparse_tables(2))
        swap_final(material)
        expected = mixed(sparse_tables(2), other, light, view, mask)
        flat.view = node.inputs["View"]
        flat.aim(light, view)
        assert np.abs(render_pixels(flat.scene) - expected).mean() < 0.002 * expected.mean()
        swap_final(material)
        set_final_tables(material, None)
        set_blended(material, None)
        assert "Mix" not in node.inputs and kept() == before


def test_what_cannot_be_mixed(tables: Tables) -> None:
    for shown in (tables, sparse_tables(offset=1e-5)):
        material = material_from_tables(shown, "Test")
        before = kept()
        with pytest.raises(NacreError, match="same offset"):
            set_blended(material, sparse_tables())
        assert kept() == before
    material = material_from_tables(sparse_tables(), "Test")
    set_blended(material, sparse_tables(1))
    set_tables(material, tables)
    assert "Mix" not in material.node_tree.nodes[MODEL_NODE].inputs


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="EEVEE loops here")
def test_a_fit_stands_in_where_eevee_cannot_loop() -> None:
    """It is much nearer than the average colour is."""
    model = model_of()
    tables = build_node_tables(model)
    assert tables.stand_in is not None
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (9, 10), "eevee") as flat:
        for light, view in PAIRS[:2]:
            flat.aim(light, view)
            seen = render_pixels(flat.scene)
            expected = evaluate_sparse_patch(tables, unit(light)[None], unit(view)[None])[0]
            spread = np.abs(expected - expected.mean((0, 1))).mean()
            assert np.abs(seen - expected).mean() < 0.75 * spread
