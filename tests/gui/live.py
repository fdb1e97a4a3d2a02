"""What a material shows while an artist works on: lights, the world, quality, undo, files.

    blender --enable-event-simulate --python tests/gui/live.py -- BTF FOLDER

Every step is done, pictured, undone and redone in the window of a real Blender; then the file is
reopened, the material appended to another one, its model lost, the engine Nacre and the comparison
with Cycles tried, and undo and loading repeated fifty times. FOLDER takes pictures of the window
and `report.json`. The file named by the variable REAL_BLENDER_READY appears at the end.
"""

import gc
import sys
from collections.abc import Iterator
from math import pi, radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))
from window import (
    CHANGED,
    FOLDER,
    MODEL,
    MODULE,
    SAME,
    Wait,
    call,
    check,
    import_sample,
    job,
    magenta,
    make_material,
    picture,
    press,
    redo,
    report,
    select_sphere,
    set_up,
    settings,
    settle,
    show_rendered,
    shown,
    sphere_pixels,
    start,
    step,
    undo,
    viewport,
)

BLEND, OTHER = FOLDER / "sample" / "live.blend", FOLDER / "sample" / "other.blend"
CYCLES = 50
SETTLED = 3  # cycles until what is made once has been made


def story() -> Iterator[Wait]:
    yield from import_sample()
    yield from compress("DRAFT")
    yield from make_material("01-created")
    yield from move_the_light()
    yield from draw_with_nacre()
    yield from receive_shadows()
    yield from light_by_world()
    yield from change_quality()
    yield from reopen()
    yield from lose_the_model()
    yield from compare_with_cycles()
    yield from undo_fifty_times()
    yield from load_fifty_times()
    yield from append()


# --- steps ----------------------------------------------------------------------------------------


def compress(quality: str) -> Iterator[Wait]:
    settings().quality = quality
    before = settings().model_facts
    call(bpy.ops.nacre.compress)
    yield lambda: job() is None and settings().model_facts != before
    yield 0.3
    check(f"{quality.lower()}: the model is there", settings().model == str(MODEL))


def move_the_light() -> Iterator[Wait]:
    def turn() -> None:
        bpy.data.objects["Sun"].rotation_euler = (radians(35), radians(25), 0)
        bpy.ops.ed.undo_push(message="Turn Sun")

    yield from step("02-moved-light", turn)

    def add() -> None:
        call(bpy.ops.object.light_add, type="POINT", location=(1.5, -1.5, 1.0))
        bpy.context.object.data.energy = 200.0
        select_sphere()
        bpy.ops.ed.undo_push(message="Strength")

    # Adding is an undo step of its own.
    yield from step("03-added-light", add, steps=2)


def draw_with_nacre() -> Iterator[Wait]:
    """The same picture by the engine; it follows a light, too."""
    eevee = sphere_pixels(picture("04-eevee"))
    before = bpy.context.scene.render.engine
    bpy.context.scene.render.engine = "NACRE"
    yield from settle("05-nacre", 2.0, 0.7)
    nacre = sphere_pixels(picture("05-nacre"))
    report["nacre against eevee"] = float(np.abs(nacre - eevee).mean())
    check("the engine's picture is EEVEE's", np.abs(nacre - eevee).mean() < 0.02)
    bpy.ops.ed.undo_push(message="Engine")

    def turn() -> None:
        bpy.data.objects["Sun"].rotation_euler = (radians(35), radians(-35), 0)
        bpy.ops.ed.undo_push(message="Turn Sun")

    yield from step("06-nacre-moved-light", turn)
    bpy.context.scene.render.engine = before
    bpy.ops.ed.undo_push(message="Engine")
    yield from settle("07-eevee-again", 2.0, 0.7)


def receive_shadows() -> Iterator[Wait]:
    """A disc between the sun and the sphere; in EEVEE its shadow is a choice of the material.

    Material Preview draws with EEVEE, too, by default under a picture in place of the scene's
    lights: the material still follows those, but the picture casts none of their shadows.
    """
    space = viewport()["area"].spaces.active
    point, sun = (bpy.data.objects[name] for name in ("Point", "Sun"))
    rotation = sun.rotation_euler.copy()
    point.hide_set(True)
    sun.rotation_euler = (radians(35), radians(25), 0)
    bpy.ops.ed.undo_push(message="Sun Alone")
    yield from settle("08-sun", 2.0, 0.7)
    before = sphere_pixels(picture("08-sun"))
    add_disc()
    yield from settle("08-disc", 2.0, 0.7)
    lit = sphere_pixels(picture("08-disc"))
    check("disc: no shadow without Receive Shadows", np.abs(lit - before).mean() < SAME)

    def receive() -> None:
        shown().nacre.shadows = True
        bpy.ops.ed.undo_push(message="Receive Shadows")

    yield from step("09-shadow", receive)
    shadow = sphere_pixels(picture("09-shadow"))
    darker = (shadow.mean(-1) < 0.6 * lit.mean(-1)).mean()
    report["in the shadow"] = float(darker)
    check("shadow: a part of the sphere is in it", 0.1 < darker < 0.9)

    space.shading.type = "MATERIAL"
    check("scene lights are off in Material Preview", not space.shading.use_scene_lights)
    for name, shadows in (("10-preview-shadow", True), ("11-preview", False)):
        shown().nacre.shadows = shadows
        yield from settle(name)
        pixels = sphere_pixels(picture(name))
        report[name[3:]] = [float(pixels.mean()), float(np.abs(pixels - lit).mean())]
        check(f"{name[3:]}: nothing is magenta", not magenta(pixels))
    check("preview: the scene's lights are followed", np.abs(pixels - lit).mean() < CHANGED)
    show_rendered()
    bpy.data.objects.remove(bpy.data.objects["Disc"])
    bpy.data.objects["Point"].hide_set(False)
    bpy.data.objects["Sun"].rotation_euler = rotation
    bpy.ops.ed.undo_push(message="Remove Disc")
    yield from settle("11-rendered-again", 2.0, 0.7)


def light_by_world() -> Iterator[Wait]:
    """A world that is bright on one side, turned by its Mapping node."""
    world = bpy.data.worlds.new("Bright Side")
    if world.node_tree is None:
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = next(node for node in nodes if node.type == "BACKGROUND")
    place, mapping, sky = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "Mapping", "TexEnvironment")
    )
    sky.image = bpy.data.images.new("Sky", 32, 16, float_buffer=True)
    across = np.maximum(np.cos((np.arange(32) / 16 - 1) * pi), 0.05)
    rgba = np.stack([across, across, across, across * 0 + 1], -1)
    sky.image.pixels.foreach_set(np.tile(rgba, (16, 1, 1)).astype(np.float32).ravel())
    sky.image.pack()
    links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], sky.inputs["Vector"])
    links.new(sky.outputs["Color"], background.inputs["Color"])
    bpy.context.scene.world = world
    for light in bpy.data.lights:
        light.energy *= 0.2
    bpy.ops.ed.undo_push(message="World")
    yield from settle("12-world", 2.0, 0.7)

    def light() -> None:
        call(bpy.ops.nacre.light_by_world)

    yield from step("13-world-light", light)

    def turn() -> None:
        mapping = bpy.data.worlds["Bright Side"].node_tree.nodes["Mapping"]
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, pi)
        bpy.ops.ed.undo_push(message="Turn World")

    yield from step("14-turned-world", turn)


def change_quality() -> Iterator[Wait]:
    """Compressing anew to the same file brings the material up to date, by one step of undo; the
    world lights it as before."""
    before = settings().model_facts
    settings().quality = "MEDIUM"
    bpy.ops.ed.undo_push(message="Quality")

    def compress_anew() -> None:
        call(bpy.ops.nacre.compress)

    lit = sphere_pixels(picture("15-world-lit")).mean()
    yield from step("15-recompressed", compress_anew, least=0.01)
    check("the model is another one", settings().model_facts != before)
    kept = sphere_pixels(picture("15-recompressed-redo")).mean()
    check("the world's light stays", abs(kept / lit - 1) < 0.1)

    def turn() -> None:
        mapping = bpy.data.worlds["Bright Side"].node_tree.nodes["Mapping"]
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, pi / 2)
        bpy.ops.ed.undo_push(message="Turn World")

    yield from step("15-world-stays", turn)


def reopen() -> Iterator[Wait]:
    """The file as it was, and the light is followed as before."""
    before = sphere_pixels(picture("16-saved"))
    bpy.ops.wm.save_as_mainfile(filepath=str(BLEND))
    bpy.ops.wm.read_homefile(use_empty=True)
    yield 0.5
    bpy.ops.wm.open_mainfile(filepath=str(BLEND))
    show_rendered()
    yield from settle("17-reopened")
    after = sphere_pixels(picture("17-reopened"))
    check("the reopened file shows the same", np.abs(after - before).mean() < SAME)
    bpy.ops.ed.undo_push(message="Reopened")

    def turn() -> None:
        bpy.data.objects["Sun"].rotation_euler = (radians(60), 0, radians(20))
        bpy.data.lights["Sun"].energy = pi
        bpy.ops.ed.undo_push(message="Turn Sun")

    yield from step("18-reopened-moved-light", turn)


def lose_the_model() -> Iterator[Wait]:
    """Its file damaged, then gone: what is shown stays; without tables, a named placeholder."""
    before = sphere_pixels(picture("19-before-losing"))
    kept = MODEL.read_bytes()
    for name, lose in (
        ("20-broken", lambda: MODEL.write_bytes(kept[:1000])),
        ("21-missing", lambda: MODEL.unlink()),
    ):
        lose()
        call(bpy.ops.nacre.update_material)
        yield 0.2
        yield lambda: job() is None
        yield 1.0
        picture(name)
        press("ESC")  # the report
        yield 1.0
        now = sphere_pixels(picture(f"{name}-closed"))
        check(f"{name[3:]}: the material shows what it had", np.abs(now - before).mean() < SAME)
        check(f"{name[3:]}: nothing is magenta", not magenta(now))
    material = shown()
    lost = bpy.data.materials.new("Lost")
    lost.nacre.model = str(MODEL)
    engine = bpy.context.scene.render.engine
    bpy.context.scene.render.engine = "NACRE"
    bpy.data.objects["Sphere"].active_material = lost
    for name, prepare in (
        ("22-placeholder-missing", lambda: None),
        ("23-placeholder-broken", lambda: MODEL.write_bytes(kept[:1000])),
    ):
        prepare()
        bpy.data.objects["Sphere"].update_tag()
        yield from settle(name, 2.0, 0.7)
        pixels = sphere_pixels(picture(name))
        check(f"{name[3:]}: the placeholder is seen", pixels.std() > 0.01)
        message = part("preview.appearance").appearance_of(lost).message
        check(f"{name[3:]}: it is named", message.startswith("Lost: ") and MODEL.name in message)
    MODEL.write_bytes(kept)
    bpy.data.objects["Sphere"].active_material = material
    bpy.data.materials.remove(lost)
    bpy.context.scene.render.engine = engine
    yield 0.5


def compare_with_cycles() -> Iterator[Wait]:
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 240, 160
    scene.cycles.samples = 16
    if scene.camera is None:
        call(bpy.ops.object.camera_add, location=(0, -4, 0), rotation=(pi / 2, 0, 0))
        scene.camera = bpy.context.object
        select_sphere()
    call(bpy.ops.nacre.compare_with_cycles)
    yield 0.5
    check("the comparison runs on a thread", job() is not None)
    yield lambda: job() is None
    yield 1.5
    picture("24-compared")
    facts = scene.nacre.comparison.facts
    report["comparison"] = facts
    check("EEVEE and Cycles are compared", "PSNR" in facts)
    check("the images are shown", bool(image_editors()))
    while len(bpy.context.window_manager.windows) > 1:
        other = bpy.context.window_manager.windows[-1]
        with bpy.context.temp_override(window=other):
            bpy.ops.wm.window_close()
        yield 0.5


def undo_fifty_times() -> Iterator[Wait]:
    bpy.context.scene.render.engine = "NACRE"
    bpy.ops.ed.undo_push(message="Engine")
    seen = []
    for _ in range(CYCLES):
        call(bpy.ops.mesh.primitive_cube_add, location=(0, 3, 0))
        bpy.context.object.active_material = shown()
        call(bpy.ops.object.light_add, type="POINT", location=(1, 1, 3))
        yield 0.2
        undo()
        yield 0.1
        redo()
        yield 0.1
        undo()
        undo()
        yield 0.2
        seen.append(counts())
    no_growth("undo", seen)
    picture("25-undone-fifty-times")
    select_sphere()


def load_fifty_times() -> Iterator[Wait]:
    bpy.ops.wm.save_as_mainfile(filepath=str(BLEND))
    seen = []
    for _ in range(CYCLES):
        bpy.ops.wm.open_mainfile(filepath=str(BLEND))
        show_rendered()
        yield 0.4
        seen.append(counts())
    no_growth("load", seen)
    pixels = sphere_pixels(picture("26-loaded-fifty-times"))
    check("it is still shown", pixels.std() > 0.01)


def append() -> Iterator[Wait]:
    """Into another file, whose lights it follows."""
    name = shown().name
    bpy.ops.wm.read_homefile(use_empty=False)
    yield 0.5
    yield from set_up()
    with bpy.context.temp_override(**viewport()):
        bpy.ops.wm.append(directory=str(BLEND / "Material") + "/", filename=name)
    material = bpy.data.materials[name]
    bpy.data.objects["Sphere"].active_material = material
    bpy.ops.ed.undo_push(message="Append")
    show_rendered()
    yield from settle("27-appended")
    pixels = sphere_pixels(picture("27-appended"))
    check("the appended material is lit and has detail", pixels.std() > 0.01)
    check("nothing of it is magenta", not magenta(pixels))
    check("there is one set of lights", len(light_sets()) == 1)

    def turn() -> None:
        bpy.data.objects["Sun"].rotation_euler = (radians(35), radians(25), 0)
        bpy.ops.ed.undo_push(message="Turn Sun")

    yield from step("28-appended-moved-light", turn)
    bpy.ops.wm.save_as_mainfile(filepath=str(OTHER))


# --- what steps share -----------------------------------------------------------------------------


def add_disc() -> None:
    """Where it shades the middle of the sphere from the sun, out of the view's way."""
    towards_sun = bpy.data.objects["Sun"].matrix_world.to_quaternion() @ Vector((0.0, 0.0, 1.0))
    towards_view = viewport()["area"].spaces.active.region_3d.view_rotation @ Vector((0, 0, 1))
    call(
        bpy.ops.mesh.primitive_circle_add,
        radius=0.25,
        fill_type="NGON",
        location=towards_view + 1.5 * towards_sun,
        rotation=towards_sun.to_track_quat("Z", "Y").to_euler(),
    )
    bpy.context.object.name = "Disc"
    select_sphere()
    bpy.ops.ed.undo_push(message="Name")


def part(name: str):
    """A module of the extension."""
    return sys.modules[f"{MODULE}.{name}"]


def image_editors() -> list[bpy.types.Area]:
    return [
        area
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "IMAGE_EDITOR"
    ]


def light_sets() -> list[bpy.types.NodeTree]:
    return list(part("nodes.light_set").light_sets())


def counts() -> dict[str, int]:
    """How many of everything there are, and what the engine keeps on the graphics card."""
    found = {
        name: len(getattr(bpy.data, name))
        for name in dir(bpy.data)
        if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)
    }
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            found[f"handlers {name}"] = len(handlers)
    gc.collect()
    kept = [
        thing for thing in gc.get_objects() if isinstance(thing, part("preview.draw").Resources)
    ]
    found["viewports of the engine"] = len(kept)
    for name in ("meshes", "textures", "shaders"):
        found[f"engine's {name}"] = sum(len(getattr(one, name)) for one in kept)
    found["memory"] = int(Path("/proc/self/statm").read_text().split()[1]) * 4096
    return found


def no_growth(what: str, seen: list[dict[str, int]]) -> None:
    memory = [found.pop("memory") for found in seen]
    report[f"memory, {what}"] = [memory[SETTLED], memory[-1]]
    grown = {
        name: (seen[SETTLED][name], seen[-1][name])
        for name in seen[-1]
        if seen[-1][name] != seen[SETTLED][name]
    }
    report[f"grown, {what}"] = grown
    report[f"counts, {what}"] = seen[-1]
    check(f"fifty times {what} leave nothing behind", not grown)


start(story())
