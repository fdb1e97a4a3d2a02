"""The model's node group in both engines against the same tables on the CPU."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from small_btf import make_model as small_model

from addon.datasets.directions import spherical_to_unit
from addon.errors import NacreError
from addon.models.clustered_tucker import ClusteredTucker
from addon.nodes import atlas
from addon.nodes.coordinates import stored_coordinates
from addon.nodes.material import (
    MODEL_NODE,
    group_of,
    groups_of,
    is_nacre_material,
    material_from_tables,
    set_coordinates,
    set_final_tables,
    set_lights,
    set_tables,
)
from addon.nodes.packed_tables import pack, unpack
from addon.render.engines import NODE_ENGINES, render_pixels, set_engine
from addon.render.pictures import flat_scene
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene, unit
from addon.tables.evaluate import evaluate_patch, evaluate_points
from addon.tables.tables import Tables, build_tables

PAIRS = (((0.0, 0.0), (0.0, 0.0)), ((30.0, 60.0), (60.0, 90.0)), ((71.0, 13.0), (47.0, 251.0)))


def _check_flat(tables: Tables, engine: str, size: tuple[int, int]) -> None:
    material = material_from_tables(tables, "Test")
    with flat_scene(material, size, engine) as flat:
        for light, view in PAIRS:
            flat.aim(light, view)
            seen = render_pixels(flat.scene)
            expected = evaluate_patch(tables, unit(light)[None], unit(view)[None])[0, 0]
            assert expected.mean() > 0.01
            assert np.abs(seen - expected).mean() < 0.01 * expected.mean(), (light, view)


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_flat_patch_is_the_tables(engine: str, tables: Tables) -> None:
    """Odd shapes throughout: ranks that fill no quad, two mixtures, a patch that is no square."""
    _check_flat(tables, engine, (10, 12))


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_nsvd_is_one_cluster(engine: str, make_model: Callable[..., ClusteredTucker]) -> None:
    model = make_model(clusters=1, mixtures=1, ranks=(5, 9, 5, 4))
    _check_flat(build_tables(model, size=64), engine, (10, 12))


def test_paper_sized_model_fits_cycles_stack(
    make_model: Callable[..., ClusteredTucker],
) -> None:
    """K-CTA at Corduroy's ranks and N-SVD at as many: Cycles keeps at most 255 live values."""
    for settings in ({"clusters": 8, "mixtures": 3}, {"clusters": 1, "mixtures": 1}):
        rank_view = 4 if settings["clusters"] > 1 else 32
        model = make_model(**settings, ranks=(20, rank_view, 5, 4))
        _check_flat(build_tables(model, size=64), "cycles", (10, 12))


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_oblique_camera_sees_points(engine: str, tables: Tables) -> None:
    """The whole path: camera, tangent frame, sun and repeated texture, pixel by pixel."""
    light, view = (40.0, 200.0), (50.0, 320.0)
    material = material_from_tables(tables, "Test")
    with new_scene((64, 64)) as scene:
        plane = add_mesh(scene, "plane", material)
        for corner in plane.data.uv_layers.active.uv:
            corner.vector = [3.0 * value - 1.0 for value in corner.vector]
        camera = add_camera(scene, view, 0.5)
        add_sun(scene, light)
        set_lights(material, scene)
        set_engine(scene, engine, 1)
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        seen = render_pixels(scene)
        # Each pixel's ray meets the plane z = 0.
        steps = (np.arange(64) + 0.5) / 64 - 0.5
        right, up, towards = np.array(camera.matrix_world.to_3x3()).T
        origin = 0.5 * (steps[None, :, None] * right + steps[:, None, None] * up)
        hit = origin - towards * (origin[..., 2:] / towards[2])
    uv = 3.0 * (hit[..., :2] + 0.5) - 1.0
    count = uv[..., 0].size
    expected = evaluate_points(
        tables,
        np.repeat(unit(light)[None], count, 0),
        np.repeat(unit(view)[None], count, 0),
        uv.reshape(-1, 2),
    ).reshape(seen.shape)
    assert np.abs(seen - expected).mean() < 0.01 * expected.mean()


KINDS = {
    "kcta": {"ranks": (6, 3, 3, 3), "clusters": {"view": 4}, "mixtures": {"view": 3}},
    "cta of local lights": {"ranks": (5, 3, 3, 3), "clusters": {"view": 3}, "shared": ()},
    "clusters of lights": {
        "ranks": (3, 6, 3, 3),
        "clusters": {"light": 3},
        "mixtures": {"light": 2},
        "shared": ("view",),
    },
    "mkcta": {
        "ranks": (3, 5, 3, 3),
        "clusters": {"light": 6, "view": 3},
        "mixtures": {"light": 5, "view": 2},
        "shared": ("y", "x"),
    },
}


@pytest.mark.parametrize("engine", NODE_ENGINES)
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_several_lights_add_up(engine: str, kind: dict) -> None:
    """Each clamped for itself, whatever is clustered."""
    tables = build_tables(small_model((12, 14, 10, 12, 3), **{"shared": ("light",), **kind}), 32)
    material = material_from_tables(tables, "Test")
    lights, view = ((20.0, 30.0), (60.0, 140.0), (45.0, 260.0)), (35.0, 80.0)
    with flat_scene(material, (12, 10), engine) as flat:
        for count in (3, 0, 1):  # more, none and one are written differently
            for item in [item for item in flat.scene.objects if item.type == "LIGHT"]:
                bpy.data.objects.remove(item)
            for light in lights[:count]:
                add_sun(flat.scene, light)
            set_lights(material, flat.scene)
            flat.view.default_value = unit(view)
            seen = render_pixels(flat.scene)
            alone = [
                evaluate_patch(tables, unit(light)[None], unit(view)[None])[0, 0]
                for light in lights[:count]
            ]
            expected = np.sum(alone, 0) if alone else np.zeros_like(seen)
            assert np.abs(seen - expected).mean() <= 0.005 * expected.mean(), count
    kept = {tree.name for tree in bpy.data.node_groups}
    assert len(kept) <= 6, kept  # what was written for other lights is gone


def test_mkcta_of_the_paper_fits_cycles_stack() -> None:
    """MK-CTA at Hole's setting, under four lights."""
    model = small_model(
        (12, 14, 10, 12, 3),
        (4, 4, 3, 3),
        clusters={"light": 4, "view": 5},
        mixtures={"light": 3, "view": 3},
        shared=("y", "x"),
    )
    tables = build_tables(model, 32)
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (12, 10), "cycles") as flat:
        for turn in range(4):
            add_sun(flat.scene, (40.0, 90.0 * turn))
        set_lights(material, flat.scene)
        assert render_pixels(flat.scene).mean() > 0.0


def test_other_tables_in_place(tables: Tables) -> None:
    """The material's links stay, and nothing of the first tables does."""
    material = material_from_tables(tables, "Test")
    links = len(material.node_tree.links)

    def kept() -> tuple[int, int]:
        images = [image for image in bpy.data.images if image.type == "IMAGE"]
        return len(images), len(bpy.data.node_groups)

    other = build_tables(small_model((12, 14, 10, 12, 3), (4, 5, 3, 3)), 32)
    with flat_scene(material, (12, 10), "cycles") as flat:
        flat.aim((30.0, 60.0), (60.0, 90.0))
        before = kept()
        set_tables(material, other)
        flat.aim((30.0, 60.0), (60.0, 90.0))
        seen = render_pixels(flat.scene)
        assert kept() == before
    expected = evaluate_patch(other, unit((30.0, 60.0))[None], unit((60.0, 90.0))[None])[0, 0]
    assert np.abs(seen - expected).mean() < 0.005 * expected.mean()
    assert len(material.node_tree.links) == links - 1  # flat pictures take the view away


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_a_map_of_coordinates_lays_the_patch_anew(engine: str, tables: Tables) -> None:
    """Any texel may follow any other; without the map the patch is as it was."""
    rng = np.random.default_rng(5)
    coordinates = np.stack([rng.integers(0, 12, (24, 16)), rng.integers(0, 10, (24, 16))], -1)
    material = material_from_tables(tables, "Test")
    light, view = (30.0, 60.0), (60.0, 90.0)
    patch = evaluate_patch(tables, unit(light)[None], unit(view)[None])[0, 0]
    # A UV unit is one patch of 10 x 12 texels, of which the picture has one for each pixel.
    for laid in (coordinates, None):
        set_coordinates(material, laid)
        with flat_scene(material, (10, 12), engine) as flat:
            flat.aim(light, view)
            seen = render_pixels(flat.scene)
        y, x = np.indices((12, 10)) if laid is None else np.moveaxis(laid[:12, :10], -1, 0)
        expected = patch[y, x]
        assert np.abs(seen - expected).mean() < 0.01 * expected.mean()
    assert len([image for image in bpy.data.images if image.type == "IMAGE"]) == 4


def test_a_map_of_coordinates_stays_where_it_fits(tables: Tables) -> None:
    """With as many texels; other tables repeat, shown or final."""
    material = material_from_tables(tables, "Test")
    set_coordinates(material, np.zeros((24, 16, 2), np.int32))
    laid = stored_coordinates(group_of(material))
    smaller = build_tables(small_model((12, 14, 9, 8, 3), (4, 5, 3, 3)), 32)
    set_final_tables(material, tables)
    assert [stored_coordinates(group) for group in groups_of(material)] == [laid, laid]
    set_final_tables(material, smaller)
    set_tables(material, tables)
    assert [stored_coordinates(group) for group in groups_of(material)] == [laid, None]
    set_tables(material, smaller)
    assert [stored_coordinates(group) for group in groups_of(material)] == [None, None]
    assert not [image for image in bpy.data.images if "Coordinates" in image.name]


def test_packed_tables_come_out_again() -> None:
    model = small_model((12, 14, 10, 12, 3), **{"shared": ("light",), **KINDS["mkcta"]})
    tables = build_tables(model, 32)
    packed = pack("Test", tables)
    again = unpack(packed)
    for name in ("core", "light", "view", "light_index", "view_index"):
        np.testing.assert_array_equal(getattr(again, name), getattr(tables, name))


def test_no_light_below_the_horizon(tables: Tables) -> None:
    below = evaluate_points(
        tables,
        spherical_to_unit([120.0], [30.0]),
        spherical_to_unit([10.0], [0.0]),
        np.array([[0.3, 0.4]]),
    )
    assert (below == 0.0).all()
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (8, 8), "cycles") as flat:
        flat.aim((120.0, 30.0), (10.0, 0.0))
        assert render_pixels(flat.scene).max() == 0.0


def test_material_survives_saving(tables: Tables, tmp_path) -> None:
    """Images are packed with all their bits: a reopened file renders the same."""
    material = material_from_tables(tables, "Test")
    with flat_scene(material, (10, 12), "cycles") as flat:
        flat.aim((30.0, 60.0), (60.0, 90.0))
        before = render_pixels(flat.scene)
    path = tmp_path / "material.blend"
    bpy.data.libraries.write(str(path), {material}, fake_user=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (source, target):
        target.materials = source.materials
    (material,) = target.materials
    assert is_nacre_material(material)
    with flat_scene(material, (10, 12), "cycles") as flat:
        flat.aim((30.0, 60.0), (60.0, 90.0))
        np.testing.assert_array_equal(render_pixels(flat.scene), before)


def test_too_large_for_a_texture(tables: Tables, monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit that this model passes stands for the real one: the error names both, no image is
    left."""
    monkeypatch.setattr(atlas, "LARGEST", 32)
    with pytest.raises(NacreError, match="is the limit") as caught:
        material_from_tables(tables, "Test")
    assert "\n" not in str(caught.value)
    assert not bpy.data.materials and not bpy.data.images and not bpy.data.node_groups


def test_artist_facing_names(tables: Tables) -> None:
    """Inputs carry tooltips, nodes can be found, and nothing of the graph is left over."""
    material = material_from_tables(tables, "Wool")
    group = material.node_tree.nodes[MODEL_NODE].node_tree
    sockets = [item for item in group.interface.items_tree if item.item_type == "SOCKET"]
    assert [socket.name for socket in sockets] == [
        "Value",
        "Cycles",
        "UV",
        "View",
        "Tangent",
        "Bitangent",
        "Normal",
    ]
    assert all(socket.description for socket in sockets)
    assert material.node_tree.nodes["Repeat"]
    assert len(bpy.data.images) == 4
