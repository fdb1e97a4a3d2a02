"""Each step as scripts and `blender -b` run it: what it leaves, and its one line when it fails."""

import os
import shutil
import time
from pathlib import Path

import bpy
import pytest
from pieces import add_mesh, add_object, fails
from small_btf import write_dataset

from addon import jobs
from addon.errors import Cancelled
from addon.nodes.coordinates import stored_coordinates
from addon.nodes.kept_world import kept_world
from addon.nodes.light_set import count_of, has_shadows, light_set
from addon.nodes.material import FINAL_NODE, group_of, groups_of
from addon.nodes.model_group import lights_of
from addon.nodes.packed_environment import stored_environment
from addon.nodes.packed_tables import stored, unpack
from addon.operators import compress, import_btf
from addon.render import world_light
from addon.tables.environment import build_environment
from addon.tables.light_lobes import light_lobes


def add_light(scene, kind="SUN", name="Key"):
    return add_object(name, bpy.data.lights.new(name, kind), scene)


# --- export ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".btf", ".zip"])
def test_a_dataset_is_written_and_read_again(scene, tmp_path, ending):
    assert "choose a dataset" in fails_to_poll(bpy.ops.nacre.export_btf)
    scene.nacre.dataset = str(write_dataset(tmp_path / "a.nacre", (6, 7, 8, 10, 3)).path)
    out = tmp_path / f"b{ending}"
    assert bpy.ops.nacre.export_btf(filepath=str(out), components=6) == {"FINISHED"}
    assert bpy.ops.nacre.import_btf(filepath=str(out)) == {"FINISHED"}
    assert "6 lights × 7 views" in scene.nacre.dataset_facts
    assert "No such file" in fails(bpy.ops.nacre.export_btf, filepath=str(tmp_path / "x" / "a.btf"))


def fails_to_poll(operator) -> str:
    with pytest.raises(RuntimeError) as caught:
        operator()
    return str(caught.value)


# --- import ---------------------------------------------------------------------------------------


def test_importing_makes_the_dataset_beside_the_file(scene, sample):
    assert bpy.ops.nacre.import_btf(filepath=str(sample)) == {"FINISHED"}
    settings = scene.nacre
    assert settings.dataset == str(sample.with_suffix(".nacre"))
    assert settings.dataset_facts.split("\n") == [
        "Name\twool.nacre",
        "Directions\t81 lights × 81 views",
        "Texels\t64 × 64",
        "Size\t161 MB",
    ]
    assert settings.expected_size.startswith("up to ")
    assert sorted(os.listdir(sample.parent)) == ["wool.btf", "wool.nacre"]


def test_the_cosine_is_passed_on(monkeypatch, sample):
    seen = []

    def stop(source, destination, **options):
        seen.append(options["cosine"])
        raise Cancelled

    monkeypatch.setattr(import_btf, "import_dataset", stop)
    for name in ("AUTO", "INCLUDED", "NOT_INCLUDED"):
        assert bpy.ops.nacre.import_btf(filepath=str(sample), cosine=name) == {"CANCELLED"}
    assert seen == [None, 1, 0]


def test_a_cancelled_import_leaves_nothing(scene, sample):
    job = jobs.Job(
        lambda progress: import_btf.import_dataset(
            sample, sample.with_suffix(".nacre"), progress=progress
        )
    )
    job.start()
    end = time.monotonic() + 10
    while job.fraction == 0.0 and time.monotonic() < end:
        time.sleep(0.001)
    job.cancel()
    job.join()
    assert isinstance(job.error, Cancelled)
    assert os.listdir(sample.parent) == ["wool.btf"]


def test_a_damaged_file_is_named_in_one_line(scene, sample):
    sample.write_bytes(sample.read_bytes()[:-1])
    assert "wool.btf" in fails(bpy.ops.nacre.import_btf, filepath=str(sample))
    assert os.listdir(sample.parent) == ["wool.btf"]
    assert scene.nacre.dataset == ""


def test_no_file_to_import(tmp_path):
    assert "choose a .btf" in fails(bpy.ops.nacre.import_btf)
    assert "choose a .btf" in fails(bpy.ops.nacre.import_btf, filepath=str(tmp_path))
    absent = tmp_path / "absent.btf"
    assert "there is no file" in fails(bpy.ops.nacre.import_btf, filepath=str(absent))


def test_a_folder_that_cannot_be_written_asks_for_another(monkeypatch, sample):
    """As an extension it falls back on its own folder, which a checkout does not have."""
    monkeypatch.setattr(import_btf, "_is_writable", lambda folder: False)
    assert "give a dataset folder" in fails(bpy.ops.nacre.import_btf, filepath=str(sample))


def test_a_folder_is_found_writable_by_writing(tmp_path):
    assert import_btf._is_writable(tmp_path)
    assert not import_btf._is_writable(tmp_path / "absent")
    assert os.listdir(tmp_path) == []


# --- compress -------------------------------------------------------------------------------------


def test_compressing_saves_the_model_and_its_facts(scene, dataset, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.quality = str(dataset), "DRAFT"
    settings.output = str(tmp_path / "cloth.exr")
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert settings.model == settings.output
    facts = dict(row.split("\t") for row in settings.model_facts.split("\n"))
    assert facts["Method"] == "K-CTA"
    assert facts["SNR"].endswith(" dB")
    assert "(1 : " in facts["Size"]
    assert os.listdir(tmp_path) == ["cloth.exr"]


def test_the_model_goes_beside_the_dataset(scene, model, dataset):
    """`model` gives an output; without one the name is the dataset's."""
    scene.nacre.dataset, scene.nacre.quality = str(dataset), "DRAFT"
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert scene.nacre.model == str(dataset.with_suffix(".exr"))


def test_a_target_quality_is_reached(scene, dataset, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.output = str(dataset), str(tmp_path / "a.exr")
    settings.quality, settings.target_db = "TARGET_DB", 8.0
    assert settings.expected_size == ""
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    facts = dict(row.split("\t") for row in settings.model_facts.split("\n"))
    assert facts["SNR"] in ("8.0 dB", "8.1 dB")
    assert os.listdir(tmp_path) == ["a.exr"]


def test_a_target_size_is_kept(scene, dataset, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.output = str(dataset), str(tmp_path / "a.exr")
    settings.quality, settings.target_mb = "TARGET_MB", 0.05
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert 45_000 < (tmp_path / "a.exr").stat().st_size <= 50_000
    settings.target_mb = 0.001
    assert "the smallest takes about" in fails(bpy.ops.nacre.compress)


def test_compressing_needs_a_dataset(scene, tmp_path):
    with pytest.raises(RuntimeError, match="Import a BTF or choose a dataset first"):
        bpy.ops.nacre.compress()
    scene.nacre.dataset = f"{tmp_path}{os.sep}"  # as Blender's folder button writes it
    assert scene.nacre.dataset_facts.startswith(f"\t{tmp_path.name} is not a Nacre dataset")
    assert "is not a Nacre dataset" in fails(bpy.ops.nacre.compress)


def test_a_model_is_an_exr_file_in_a_folder_that_exists(scene, dataset, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.quality = str(dataset), "DRAFT"
    settings.output = str(tmp_path / "cloth.png")
    assert "ends in .exr" in fails(bpy.ops.nacre.compress)
    settings.output = str(tmp_path / "absent" / "cloth.exr")
    assert "there is no folder" in fails(bpy.ops.nacre.compress)
    assert settings.model == ""
    assert os.listdir(tmp_path) == []


def test_mkcta_is_a_method_too(scene, dataset, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.output = str(dataset), str(tmp_path / "a.exr")
    settings.method, settings.quality = "MKCTA", "DRAFT"
    announced = float(settings.expected_size.removeprefix("up to ").split(" kB")[0])
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert "Method\tMK-CTA" in settings.model_facts
    assert 0.5 * announced < (tmp_path / "a.exr").stat().st_size / 1e3 <= announced
    assert bpy.ops.nacre.create_material() == {"FINISHED"}


def test_the_expected_size_follows_the_settings(scene, dataset):
    settings = scene.nacre
    settings.dataset = str(dataset)
    sizes = []
    for quality in ("DRAFT", "MEDIUM", "HIGH"):
        settings.quality = quality
        sizes.append(int(settings.expected_size.rsplit(" ", 1)[1].rstrip(")")))
    assert sizes == sorted(sizes, reverse=True)
    settings.dataset = ""
    assert (settings.dataset_facts, settings.expected_size) == ("", "")


def test_a_model_stays_below_the_size_announced(scene, dataset, model):
    settings = scene.nacre
    settings.dataset, settings.quality = str(dataset), "DRAFT"
    announced = float(settings.expected_size.removeprefix("up to ").split(" kB")[0])
    assert 0.5 * announced < model.stat().st_size / 1e3 <= announced


def test_an_unforeseen_error_is_one_line_too(monkeypatch, scene, dataset):
    def fail(path):
        raise ZeroDivisionError("first\nsecond")

    monkeypatch.setattr(compress, "open_dataset", fail)
    scene.nacre.dataset = str(dataset)
    text = fails(bpy.ops.nacre.compress)
    assert text == "Compress failed: ZeroDivisionError first (details in the console)"


# --- create material ------------------------------------------------------------------------------


def test_a_material_on_the_selected_meshes(scene, model):
    add_light(scene)
    meshes = [add_mesh(scene, "A"), add_mesh(scene, "B")]
    other = bpy.data.materials.new("Other")
    meshes[1].data.materials.append(other)
    left = add_mesh(scene, "Left")
    left.select_set(False)
    scene.nacre.model = str(model)
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    material = bpy.data.materials["wool"]
    assert [item.active_material for item in meshes] == [material, material]
    assert len(meshes[1].material_slots) == 1
    assert left.active_material is None
    assert material.nacre.model == str(model)
    assert lights_of(group_of(material)) == light_set(scene)
    assert count_of(light_set(scene)) == 1


def test_without_selection_it_makes_only_the_material(scene, model):
    scene.nacre.model = str(model)
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    assert count_of(lights_of(group_of(bpy.data.materials["wool"]))) == 0
    assert bpy.data.materials["wool"].users == 0


def test_lights_of_a_collection_take_over(scene, model):
    add_light(scene)
    chosen = bpy.data.collections.new("Chosen")
    scene.collection.children.link(chosen)
    spot = bpy.data.objects.new("Spot", bpy.data.lights.new("Spot", "SPOT"))
    chosen.objects.link(spot)
    scene.nacre.model, scene.nacre.lights = str(model), chosen
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    material = bpy.data.materials["wool"]
    assert followed(material) == {spot}
    material.nacre.shadows = True
    assert followed(material) == {spot} and has_shadows(lights_of(group_of(material)))
    material.nacre.lights = None
    assert has_shadows(lights_of(group_of(material)))
    assert followed(material) == set(scene.objects)


def followed(material):
    data = lights_of(group_of(material)).animation_data
    return {
        target.id
        for curve in (data.drivers if data else ())
        for variable in curve.driver.variables
        for target in variable.targets
    }


def test_lights_that_are_added_and_removed_are_followed(scene, model):
    """By themselves, as Blender says what has changed."""
    scene.nacre.model = str(model)
    bpy.ops.nacre.create_material()
    material = bpy.data.materials["wool"]
    lamp = add_light(scene, "POINT", "Lamp")
    bpy.context.view_layer.update()
    assert followed(material) == {lamp}
    area = add_light(scene, "AREA", "Area")
    bpy.context.view_layer.update()
    assert followed(material) == {lamp, area}
    bpy.data.objects.remove(lamp)
    bpy.context.view_layer.update()
    assert followed(material) == {area}


def test_a_material_is_appended_to_another_file(scene, model, tmp_path):
    """Its first file's lights do not light it there."""
    scene.nacre.model = str(model)
    add_light(scene)
    bpy.ops.nacre.create_material()
    path = tmp_path / "a.blend"
    bpy.data.libraries.write(str(path), {bpy.data.materials["wool"]}, fake_user=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    new = bpy.context.scene
    new.name = "Another"
    lamp = add_light(new, "POINT", "Lamp")
    with bpy.data.libraries.load(str(path)) as (_, target):
        target.materials = ["wool"]
    add_mesh(new, "A").data.materials.append(target.materials[0])
    bpy.context.view_layer.update()
    assert followed(target.materials[0]) == {lamp}
    assert len([tree for tree in bpy.data.node_groups if "Lights" in tree.name]) == 1


def test_a_model_compressed_again_is_shown_in_place(scene, dataset, model, tmp_path):
    model = Path(shutil.copy(model, tmp_path))
    scene.nacre.model = str(model)
    bpy.ops.nacre.create_material()
    material = bpy.data.materials["wool"]
    links = len(material.node_tree.links)
    before = {image.name for image in bpy.data.images}
    scene.nacre.dataset, scene.nacre.output = str(dataset), str(model)
    scene.nacre.method, scene.nacre.quality = "NSVD", "DRAFT"
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert len(material.node_tree.links) == links
    assert len(bpy.data.images) == len(before)


def test_a_final_model_takes_the_place_of_the_shown_one_while_rendering(scene, model):
    scene.nacre.model = str(model)
    item = add_mesh(scene, "A")
    bpy.ops.nacre.create_material()
    material = item.active_material
    bpy.context.view_layer.objects.active = item
    material.nacre.final_model = str(model)
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    shown, final = groups_of(material)
    assert shown != final and len(material.node_tree.links) > 5
    links = {(link.from_node.name, link.to_node.name) for link in material.node_tree.links}
    seen = []

    def look(*_):
        seen.append(group_of(material))

    bpy.app.handlers.render_pre.append(look)
    add_camera(scene)
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x = scene.render.resolution_y = 8
    bpy.ops.render.render()
    bpy.app.handlers.render_pre.remove(look)
    assert seen == [final]
    assert group_of(material) == shown
    assert {(link.from_node.name, link.to_node.name) for link in material.node_tree.links} == links
    images = len(bpy.data.images)
    material.nacre.final_model = ""
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert FINAL_NODE not in material.node_tree.nodes
    assert len(bpy.data.images) == images - 4


def test_world_light_and_laying_are_carried_over(scene, dataset, model, tmp_path, monkeypatch):
    """Compressed again, updated, and with a final model set afterwards; removed from all."""
    monkeypatch.setattr(world_light, "SIZE", (32, 16))
    model = Path(shutil.copy(model, tmp_path))
    scene.nacre.model = str(model)
    item = add_mesh(scene, "A")
    bpy.ops.nacre.create_material()
    material = item.active_material
    bpy.context.view_layer.objects.active = item
    scene.world = bpy.data.worlds.new("Sky")
    add_environment(scene.world)
    assert bpy.ops.nacre.light_by_world() == {"FINISHED"}
    assert bpy.ops.nacre.hide_repetition() == {"FINISHED"}
    before = stored_environment(group_of(material))
    laid = stored_coordinates(group_of(material))

    scene.nacre.dataset, scene.nacre.output = str(dataset), str(model)
    scene.nacre.method, scene.nacre.quality = "NSVD", "DRAFT"
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    material.nacre.final_model = str(model)
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    shown, final = groups_of(material)
    for group in (shown, final):
        environment = stored_environment(group)
        assert (environment.world, environment.mapping) == (before.world, before.mapping)
        assert len([node for node in group.nodes if node.type == "MAPPING"]) == 3
        assert stored_coordinates(group) == laid
    wanted = build_environment(light_lobes(unpack(stored(shown))), kept_picture(material))
    assert stored_environment(shown).scale == pytest.approx(wanted.scale, rel=1e-6)

    assert bpy.ops.nacre.light_by_world(remove=True) == {"FINISHED"}
    assert bpy.ops.nacre.hide_repetition(remove=True) == {"FINISHED"}
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    for group in groups_of(material):
        assert stored_environment(group) is None and stored_coordinates(group) is None
    assert len([image for image in bpy.data.images if image.name.startswith("Nacre")]) == 8


def kept_picture(material):
    kept = kept_world(material.node_tree)
    assert kept.radiance.shape == (16, 32, 3) and kept.world == "Sky"
    return kept.radiance


def test_the_world_lights_a_material_and_turns_live(scene, model, monkeypatch):
    monkeypatch.setattr(world_light, "SIZE", (32, 16))
    scene.nacre.model = str(model)
    item = add_mesh(scene, "A")
    bpy.ops.nacre.create_material()
    bpy.context.view_layer.objects.active = item
    scene.world = world = bpy.data.worlds.new("Sky")
    mapping = add_environment(world)
    assert bpy.ops.nacre.light_by_world() == {"FINISHED"}
    group = group_of(item.active_material)
    add_light(scene)
    bpy.context.view_layer.update()  # written anew, the world's light stays
    turning = [node for node in group.nodes if node.type == "MAPPING"]
    assert len(turning) == 3 and count_of(lights_of(group)) == 1
    mapping.inputs["Rotation"].default_value[2] = 0.7
    for _ in range(2):
        bpy.context.view_layer.update()
    for node in turning:
        assert node.inputs["Rotation"].default_value[2] == pytest.approx(0.7)
    images = len(bpy.data.images)
    assert bpy.ops.nacre.light_by_world() == {"FINISHED"}
    assert len(bpy.data.images) == images
    assert bpy.ops.nacre.light_by_world(remove=True) == {"FINISHED"}
    assert not [node for node in group.nodes if node.type == "MAPPING"]
    assert len(bpy.data.images) == images - 2  # its table and its picture


def test_a_material_is_as_large_as_it_was_measured(scene, model):
    scene.nacre.model = str(model)
    bpy.ops.mesh.primitive_plane_add(size=0.6)  # one UV unit
    plane = bpy.context.object
    bpy.ops.nacre.create_material()
    material = plane.active_material
    width, height = material.nacre.patch_size
    assert width > 0.0
    plane.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    assert bpy.ops.nacre.real_size() == {"FINISHED"}
    repeat = material.node_tree.nodes["Repeat"].inputs[1].default_value
    assert tuple(repeat) == pytest.approx((1.2 / width, 1.2 / height, 1.0), rel=1e-4)
    for corner in plane.data.uv_layers.active.uv:
        corner.vector = (0.0, 0.0)
    assert "has no area" in fails(bpy.ops.nacre.real_size)


def add_environment(world):
    """A picture of noise, and the node that turns it."""
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    texture, mapping, coordinates = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord")
    )
    texture.image = bpy.data.images.new("Noise", 8, 4, float_buffer=True)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return mapping


def add_camera(scene):
    scene.camera = add_object("Camera", bpy.data.cameras.new("Camera"), scene)


def test_a_broken_file_leaves_the_material_as_it_was(scene, model, tmp_path):
    scene.nacre.model = str(model)
    add_light(scene)
    item = add_mesh(scene, "A")
    bpy.ops.nacre.create_material()
    bpy.context.view_layer.objects.active = item
    group = group_of(item.active_material)
    short = tmp_path / "short.exr"
    short.write_bytes(model.read_bytes()[:-100])
    for path, reason in ((short, "cut short"), (tmp_path / "none.exr", "none.exr")):
        item.active_material.nacre.model = str(path)
        assert reason in fails(bpy.ops.nacre.update_material)
        assert group_of(item.active_material) == group and len(group.nodes) > 50


def test_a_model_cut_short_is_named_in_one_line(scene, model, tmp_path):
    short = tmp_path / "short.exr"
    short.write_bytes(model.read_bytes()[:-100])
    scene.nacre.model = str(short)
    before = len(bpy.data.materials), len(bpy.data.images), len(bpy.data.node_groups)
    assert "cut short" in scene.nacre.model_facts
    assert "cut short" in fails(bpy.ops.nacre.create_material)
    after = len(bpy.data.materials), len(bpy.data.images), len(bpy.data.node_groups)
    assert after == before


def test_a_material_needs_a_model():
    with pytest.raises(RuntimeError, match="Compress a dataset or choose a model first"):
        bpy.ops.nacre.create_material()


def test_an_object_without_a_uv_map_is_warned_of(scene, model, capfd):
    add_light(scene)
    add_mesh(scene, "Bare", uv=False)
    scene.nacre.model = str(model)
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    assert "Warning: No UV map on Bare" in capfd.readouterr().out


def test_a_library_mesh_is_left_alone(scene, model, tmp_path):
    """Linked objects cannot take a material: they are passed over."""
    library = tmp_path / "library.blend"
    item = add_mesh(scene, "Linked")
    bpy.data.libraries.write(str(library), {item})
    bpy.data.objects.remove(item)
    with bpy.data.libraries.load(str(library), link=True) as (source, target):
        target.objects = source.objects
    scene.collection.objects.link(target.objects[0])
    target.objects[0].select_set(True)
    scene.nacre.model = str(model)
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    assert target.objects[0].active_material is None


# --- cancel ---------------------------------------------------------------------------------------


def test_there_is_nothing_to_cancel():
    assert not bpy.ops.nacre.cancel.poll()


def test_cancelling_stops_the_job_and_nothing_else_starts_before(scene, dataset):
    def work(progress):
        while progress(0.5, "Working"):
            time.sleep(0.002)
        raise Cancelled

    job = jobs.Job(work, "nacre.compress")
    job.start()
    scene.nacre.dataset = str(dataset)
    assert not bpy.ops.nacre.compress.poll()
    assert not bpy.ops.nacre.import_btf.poll()
    assert bpy.ops.nacre.cancel() == {"FINISHED"}
    job.join(10)
    assert job.done
    assert bpy.ops.nacre.compress.poll()
