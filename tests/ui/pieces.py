"""What several tests of the interface share."""

from types import SimpleNamespace

import bpy
import pytest


class Layout:
    """Stands in for UILayout: notes texts, and checks that properties and operators exist."""

    def __init__(self, seen):
        self.seen = seen

    def _part(self, *args, **settings):
        return Layout(self.seen)

    row = column = split = box = _part

    def label(self, text="", icon="NONE", translate=True):
        self.seen.append(text)

    def prop(self, data, name, index=0, text="", placeholder="", slider=False):
        assert hasattr(data, name), name
        self.seen.append(name)

    def operator(self, name, text="", icon="NONE"):
        group, _, operator = name.partition(".")
        assert hasattr(bpy.types, f"{group.upper()}_OT_{operator}"), name
        self.seen.append(name)
        return SimpleNamespace()

    def progress(self, factor, text):
        self.seen.append(("progress", factor, text))


def region(width):
    """What a context knows of the region; without a window Blender's interface scale is 0."""
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
    return {"region": SimpleNamespace(width=width), "preferences": preferences}


def draw(cls):
    """What a panel shows, or None when it hides."""
    context = SimpleNamespace(
        scene=bpy.context.scene,
        object=bpy.context.object,
        **region(300),
    )
    if not cls.poll(context):
        return None
    seen = []
    cls.draw(SimpleNamespace(layout=Layout(seen)), context)
    return seen


def fails(operator, **options) -> str:
    """The one line that an operator reports instead of a result."""
    with pytest.raises(RuntimeError) as caught:
        operator(**options)
    text = str(caught.value).strip()
    assert text.startswith("Error: ")
    assert "\n" not in text
    return text.removeprefix("Error: ")


def add_object(name, data, scene):
    item = bpy.data.objects.new(name, data)
    scene.collection.objects.link(item)
    return item


def add_mesh(scene, name, uv=True):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    if uv:
        mesh.uv_layers.new(name="UVMap")
    item = add_object(name, mesh, scene)
    item.select_set(True)
    return item
