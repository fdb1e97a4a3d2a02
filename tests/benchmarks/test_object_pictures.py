"""What pictures of objects are compared with: the bent geometry, the lights, the smooth mesh."""

import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector

from addon.datasets.dataset import open_dataset
from addon.datasets.direction_sets import ubo_81
from addon.measure.cycles import set_up_cycles
from addon.render.stage import new_scene, unit
from addon.tables.evaluate import evaluate_points
from addon.tables.tables import build_tables
from benchmarks._lights import Lights, equirectangular, lights, median_cut
from benchmarks._object_pictures import (
    Shot,
    View,
    look_at,
    of_dataset,
    of_tables,
    take,
    three_views,
)
from benchmarks._real_geometry import Object, add_real_geometry, grid_quads, mesh_of
from benchmarks.turntable import changes, follow, shots

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "models"))
from small_btf import hemisphere, make_model, write_dataset  # noqa: E402

SIZE = (0.02, 0.01)


@pytest.fixture(autouse=True)
def empty_file():
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    write_dataset(tmp_path_factory.mktemp("small") / "small.nacre", patch_size=[0.02, 0.02])
    return open_dataset(next(tmp_path_factory.getbasetemp().glob("small*/small.nacre")))


def flat_view(uv, view):
    """Points of a flat patch, seen from directions (n, 3)."""
    uv, count = np.asarray(uv, float), len(uv)
    shape = Object(lambda u, v: (u, v, 0 * u), (1, 1), (1.0, 1.0), 1.0)
    frames = np.broadcast_to(np.eye(3), (count, 3, 3))
    return View(shape, np.arange(count), uv, uv, frames, np.asarray(view), (count, 1))


@pytest.mark.parametrize("kind", ["sphere", "cloth"])
def test_patches_lie_on_the_object_and_have_their_own_size(kind):
    shape = Object.of(kind, 4, (0.02, 0.02))
    corners = np.array([(-0.01, 0, 0), (0.01, 0, 0), (0, 0, 0), (0, 0, 0.003)])
    middle = shape.repeat[1] // 2
    edge, other, centre, above = shape.bend(corners, 3, middle)
    next_edge = shape.bend(corners, 4, middle)[0]
    assert other == pytest.approx(next_edge, abs=1e-9)
    # On a sphere shorter away from its equator; a cloth is stretched by its slope.
    assert 0.0175 < np.linalg.norm(other - edge) < 0.024
    assert np.linalg.norm(above - centre) == pytest.approx(0.003)
    if kind == "sphere":
        outward = centre / np.linalg.norm(centre)
        assert above == pytest.approx(centre + 0.003 * outward, abs=1e-6)
    frame = shape.frame(np.array([0.3]), np.array([0.6]))[0]
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_copies_of_a_mesh_are_welded():
    steps = np.linspace(-0.5, 0.5, 6)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    points = np.stack([0.02 * x, 0.02 * y, 0.001 * np.cos(2 * np.pi * x)], -1)
    item = bpy.data.objects.new("Patch", mesh_of(points, grid_quads(5)))
    shape = Object.of("cloth", 3, (0.02, 0.02))
    with new_scene((8, 8)) as scene:
        add_real_geometry(scene, item, shape, np.array((0.0, 0.0, 1.0)))
        meshes = {one.data.name: one.data for one in scene.objects}
        (bent,) = [m for name, m in meshes.items() if "Bent" in name and len(m.polygons) == 225]
        assert len(bent.vertices) == 16 * 16
        edges = np.zeros(len(bent.edges), int)
        for face in bent.polygons:
            for key in face.edge_keys:
                edges[bent.edge_keys.index(key)] += 1
        assert sorted(set(edges)) == [1, 2] and (edges == 1).sum() == 60  # the cloth's own edge


def test_strands_are_bent_with_their_radius():
    curves = bpy.data.hair_curves.new("Strands")
    curves.add_curves([3])
    curves.attributes["position"].data.foreach_set("vector", [0, 0, 0, 0.005, 0, 0.001, 0.01, 0, 0])
    curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", [1e-4, 2e-4, 3e-4])
    collection = bpy.data.collections.new("Cloth")
    collection.objects.link(bpy.data.objects.new("Strands", curves))
    shape = Object.of("sphere", 3, (0.02, 0.02))
    with new_scene((8, 8)) as scene:
        add_real_geometry(scene, collection, shape, np.array((0.0, 0.0, 1.0)))
        (bent,) = [one.data for one in scene.objects if one.type == "CURVES"]
        count = len(bent.curves)
        assert 8 <= count < 18  # not those on the other side
        points = np.array([p.vector for p in bent.attributes["position"].data]).reshape(-1, 3, 3)
        high = np.linalg.norm(points, axis=-1) - shape.unit
        assert high == pytest.approx(np.tile([0, 0.001, 0], (count, 1)), abs=1e-6)
        radii = [p.value for p in bent.attributes["radius"].data]
        assert radii == pytest.approx([1e-4, 2e-4, 3e-4] * count)


def test_a_world_as_lights_lights_alike():
    radiance = np.random.default_rng(1).random((24, 48, 3)) ** 4
    radiance[18, 30] = 40.0
    directions, angle = equirectangular((24, 48))
    assert angle.sum() == pytest.approx(4 * np.pi, rel=0.01)
    found = median_cut(radiance, 300)
    assert len(found.directions) == 300
    for normal in (*np.eye(3), (-0.6, 0.0, 0.8)):
        cosine = np.maximum(directions @ normal, 0.0) * angle
        expected = np.tensordot(cosine, radiance, 2) / np.pi
        summed = np.maximum(found.directions @ normal, 0.0) @ found.irradiance
        assert summed == pytest.approx(expected, rel=0.01)


def test_directions_of_a_world_are_cycles_own():
    """A world with one bright texel lights a white plane as its light does."""
    radiance = np.zeros((16, 32, 3))
    radiance[11, 5] = 3.0
    (one,) = median_cut(radiance, 1).directions
    image = bpy.data.images.new("World", 32, 16, float_buffer=True)
    image.pixels.foreach_set(np.dstack([radiance, np.ones((16, 32))]).astype(np.float32).ravel())
    with new_scene((1, 1)) as scene:
        set_up_cycles(scene, 1, 0)
        scene.render.film_transparent = False
        scene.world = bpy.data.worlds.new("World")
        if scene.world.node_tree is None:  # before 5.0
            scene.world.use_nodes = True
        tree = scene.world.node_tree
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image, texture.interpolation = image, "Closest"
        tree.links.new(texture.outputs[0], tree.nodes["Background"].inputs[0])
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        camera.data.angle = 0.001
        camera.rotation_mode = "QUATERNION"
        scene.collection.objects.link(camera)
        scene.camera = camera
        for towards, expected in ((one, 3.0), (one * (1, -1, 1), 0.0), (one * (-1, 1, 1), 0.0)):
            camera.rotation_quaternion = Vector(towards).to_track_quat("-Z", "Y")
            assert take(scene)[0, 0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["sphere", "cloth"])
def test_a_view_of_the_smooth_mesh(kind, dataset):
    shot = Shot(kind, 2, 24, (25.0, -60.0))
    view = look_at(dataset, shot)
    assert 0.4 < view.mask.mean() < 0.9
    assert np.linalg.norm(view.view, axis=-1) == pytest.approx(np.ones(len(view.uv)))
    # Where a point is seen is where it is; the mesh's quads are flat between.
    place = follow_places(view, shot)
    row, column = np.divmod(view.places, 48)
    error = np.abs(place - np.stack([column, row], -1))
    assert error.max() < 0.2
    assert (view.view[:, 2] > -0.05).all()
    picture = view.picture(view.uv)
    assert (
        picture.shape == (24, 24, 2)
        and (picture[~view.picture(view.uv * 0 + 1)[..., 0].astype(bool)] == 0).all()
    )


def follow_places(view, shot):
    """The subpixels at which the points of a view lie."""
    towards = unit(shot.camera)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    points = view.shape.point(*view.whole.T) / (view.shape.unit * 2.3)
    place = np.stack([points @ right, points @ np.cross(towards, right)], -1)
    return (place + 0.5) * 48 - 0.5


def test_the_dataset_at_measured_directions_is_its_samples(dataset):
    y, x = np.divmod(np.arange(80), 10)
    uv = np.stack([(x + 0.5) / 10, (y + 0.5) / 8], -1)
    view = flat_view(uv, np.repeat(dataset.view[3:4], 80, axis=0))
    one, both = of_dataset(
        dataset,
        view,
        [
            Lights(dataset.light[2:3], np.array([(1.0, 0.5, 0.25)])),
            Lights(dataset.light[2:4], np.ones((2, 3))),
        ],
    )
    samples = np.asarray(dataset.samples)[:, 3].reshape(6, 80, 3)
    # picture() spreads the points over a square whose other pixels are empty.
    assert one.reshape(-1, 3)[:80] == pytest.approx(samples[2] * (1.0, 0.5, 0.25), abs=1e-4)
    assert both.reshape(-1, 3)[:80] == pytest.approx(samples[2] + samples[3], abs=1e-4)


KINDS = {
    "nsvd": {"ranks": (5, 6, 3, 3)},
    "kcta": {
        "ranks": (6, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 2},
        "shared": ("light",),
    },
    "mkcta": {
        "ranks": (3, 5, 3, 3),
        "clusters": {"light": 4, "view": 3},
        "mixtures": {"light": 3, "view": 2},
        "shared": ("y", "x"),
    },
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_sums_over_lights_are_those_of_single_lights(kind):
    tables = build_tables(make_model((12, 14, 5, 6, 3), **kind), 16)
    # So that no sum is clamped at 0.
    object.__setattr__(tables, "core", np.abs(tables.core))
    object.__setattr__(tables, "view", np.abs(tables.view))
    object.__setattr__(tables, "light", np.abs(tables.light))
    rng = np.random.default_rng(3)
    uv, views = rng.random((50, 2)) * 3, hemisphere(50)
    given = Lights(np.concatenate([hemisphere(3), [(0.0, 0.6, -0.8)]]), rng.random((4, 3)))
    expected = sum(
        colour * evaluate_points(tables, np.tile(direction, (50, 1)), views, uv)
        for direction, colour in zip(given.directions, given.irradiance, strict=True)
    )
    (found,) = of_tables(tables, flat_view(uv, views), [given])
    assert found.reshape(-1, 3)[:50] == pytest.approx(expected, rel=1e-4)


def test_many_lights_are_summed_on_a_grid():
    tables = build_tables(make_model((12, 14, 5, 6, 3), **KINDS["kcta"]), 16)
    uv, views = np.random.default_rng(3).random((50, 2)), hemisphere(50)
    many = Lights(hemisphere(40), np.random.default_rng(4).random((40, 3)))
    (found,) = of_tables(tables, flat_view(uv, views), [many])
    cuts = [slice(0, 16), slice(16, 32), slice(32, 40)]
    fewer = [Lights(many.directions[part], many.irradiance[part]) for part in cuts]
    view = flat_view(uv, views)
    # Before the clamp at 0, of sums of parts: compared where all are above it.
    parts = [of_tables(tables, view, [one])[0] for one in fewer]
    above = np.all([part > 0 for part in parts], axis=0)
    assert above.any()
    assert found[above] == pytest.approx(sum(parts)[above], rel=1e-3)


def test_three_views_are_the_measured_ones_where_they_stand():
    pytest.importorskip("scipy", reason="the benchmarks' packages are not installed")
    model = make_model((12, 14, 5, 6, 3), (3, 2, 3, 3), {"view": 3}, {"view": 1}, ("light",))
    measured = np.asarray(model.dataset["view"])
    rows = three_views(model, flat_view(np.zeros((14, 2)), measured))
    assert rows.clusters.shape == (3, 14) and rows.coefficients.shape == (1, 3, 1, 14, 4)
    for number in range(14):
        found = np.zeros((3, 2))
        for cluster, row in zip(
            rows.clusters[:, number], rows.coefficients[0, :, 0, number], strict=True
        ):
            found[cluster] += row[:2]
            assert (row[2:] == 0).all()
        expected = np.zeros((3, 2))
        expected[model.members["view"][number, 0]] = model.bases["view"][0, number, 0]
        assert found == pytest.approx(expected, abs=1e-5)


def test_three_views_change_little_with_the_view():
    pytest.importorskip("scipy", reason="the benchmarks' packages are not installed")
    model = make_model((12, 81, 5, 6, 3), (3, 2, 3, 3), {"view": 3}, {"view": 1}, ("light",))
    model = replace(model, dataset={**model.dataset, "view": ubo_81().tolist()})
    turn = np.linspace(0, 2 * np.pi, 2000)
    for theta in (20, 60, 79, 89):
        sine = np.sin(np.radians(theta))
        views = np.stack(
            [sine * np.cos(turn), sine * np.sin(turn), np.full(2000, np.cos(np.radians(theta)))], -1
        )
        rows = three_views(model, flat_view(np.zeros((2000, 2)), views))
        dense = np.zeros((2000, 3, 4))
        for clusters, row in zip(rows.clusters, rows.coefficients[0, :, 0], strict=True):
            dense[np.arange(2000), clusters] += row
        assert np.abs(np.diff(dense, axis=0)).max() < 0.05 * np.abs(dense).max()


def test_what_turns_with_the_surface_does_not_change(dataset):
    """A picture painted on the surface changes its pixels, but not its points."""
    taken = [Shot("cloth", 4, 48, one.camera) for one in shots()[:3]]
    views = [look_at(dataset, one) for one in taken]
    paint = [view.picture(np.repeat(np.sin(9 * view.whole[:, :1]), 3, 1)) for view in views]
    whole = np.stack([view.picture(view.whole) for view in views])
    mask = np.stack([view.mask for view in views])
    pixels, surface, largest = changes(np.stack(paint), mask, whole, views, taken)
    brighter = np.stack([paint[0] + number for number in range(3)])
    still, _, _ = changes(brighter, mask, whole, views, taken)
    assert pixels > 4 * surface and largest < 0.2
    assert still > 0.9
    points, near = follow(paint[0], whole[0], views[0], taken[0])
    assert near.mean() > 0.7 and points.shape == (200 * 200, 3)


def test_light_sets():
    assert len(lights("four suns").directions) == 4
    world = lights("interior", 64)
    assert len(world.directions) == 64
    up = np.maximum(world.directions[:, 2], 0.0) @ world.irradiance
    assert up.mean() == pytest.approx(0.7, rel=0.05)
    turned = lights("sun").turned(90.0).directions
    x, y, z = lights("sun").directions[0]
    assert turned[0] == pytest.approx((-y, x, z))
