"""Sparse models in node groups against the same tables on the CPU."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.nodes.material import (
    group_of,
    is_nacre_material,
    material_from_tables,
    set_coordinates,
    set_final_tables,
    set_lights,
    set_tables,
    swap_final,
)
from addon.nodes.packed_tables import is_sparse, stored, unpack
from addon.render.engines import render_pixels
from addon.render.pictures import flat_scene
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene, unit
from addon.tables.parabolic import texel_directions
from addon.tables.sparse_evaluate import evaluate_sparse_patch, evaluate_sparse_points
from addon.tables.sparse_tables import Part, Product, SparseTables
from addon.tables.tables import Tables

LOOPS = pytest.mark.skipif(bpy.app.version < (5, 0), reason="EEVEE loops since Blender 5.0")
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
    return SparseTables(
        parts, product(-1.2), product(0.5), lowest=0.3, offset=offset, height=10, width=9
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


@LOOPS
def test_flat_patch_is_the_tables() -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (9, 10), "eevee") as flat:
        for light, view in PAIRS:
            flat.aim(light, view)
            check(tables, render_pixels(flat.scene), light, view)


@LOOPS
def test_several_lights_add_up_as_colours() -> None:
    """Not as logarithms; and none below the horizon."""
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    lights, view = ((20.0, 30.0), (60.0, 140.0), (120.0, 20.0)), (35.0, 80.0)
    with flat_scene(material, (9, 10), "eevee") as flat:
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


@LOOPS
def test_oblique_camera_sees_points() -> None:
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
        scene.eevee.taa_render_samples = 1
        scene.render.engine = "BLENDER_EEVEE"
        scene.render.filter_size = 0.0
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


@LOOPS
def test_a_map_of_coordinates_lays_the_patch_anew() -> None:
    tables = sparse_tables()
    random = np.random.default_rng(5)
    coordinates = np.stack([random.integers(0, 10, (20, 18)), random.integers(0, 9, (20, 18))], -1)
    material = material_from_tables(tables, "Test")
    set_coordinates(material, coordinates)
    light, view = PAIRS[1]
    patch = evaluate_sparse_patch(tables, unit(light)[None], unit(view)[None])[0]
    with flat_scene(material, (9, 10), "eevee") as flat:
        flat.aim(light, view)
        y, x = np.moveaxis(coordinates[:10, :9], -1, 0)
        assert np.abs(render_pixels(flat.scene) - patch[y, x]).mean() < 0.002 * patch.mean()


def kept() -> tuple[int, int]:
    """Images, and groups of this material."""
    images = [own for own in bpy.data.images if own.type == "IMAGE"]
    return len(images), len([own for own in bpy.data.node_groups if "Test" in own.name])


@LOOPS
def test_other_tables_in_place(tables: Tables) -> None:
    """Of another method, and back; the links of the material stay, and nothing else."""
    first, second = sparse_tables(), sparse_tables(1)
    material = material_from_tables(first, "Test")
    with flat_scene(material, (9, 10), "eevee") as flat:
        flat.aim(*PAIRS[1])
        before, links = kept(), len(material.node_tree.links)
        set_tables(material, tables)
        assert not is_sparse(group_of(material))
        set_tables(material, second)
        assert kept() == before and len(material.node_tree.links) == links
        flat.aim(*PAIRS[1])
        check(second, render_pixels(flat.scene), *PAIRS[1])


@LOOPS
def test_final_render_shows_other_tables() -> None:
    first, second = sparse_tables(), sparse_tables(1)
    material = material_from_tables(first, "Test")
    with flat_scene(material, (9, 10), "eevee") as flat:
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


@LOOPS
def test_material_survives_saving(tmp_path) -> None:
    tables = sparse_tables()
    material = material_from_tables(tables, "Test")
    path = tmp_path / "material.blend"
    bpy.data.libraries.write(str(path), {material}, fake_user=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (source, target):
        target.materials = source.materials
    (material,) = target.materials
    assert is_nacre_material(material)
    with flat_scene(material, (9, 10), "eevee") as flat:
        flat.aim(*PAIRS[1])
        check(tables, render_pixels(flat.scene), *PAIRS[1])
