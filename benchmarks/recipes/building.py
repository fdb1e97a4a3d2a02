"""What the recipes build with: meshes of arrays, coloured by vertex, and one plastic material."""

from __future__ import annotations

import bpy
import numpy as np

from addon.measure.patch import Patch


def new_patch(name: str, size: float, *parts: bpy.types.ID) -> Patch:
    """A patch of side `size` in metres made of meshes and hair curves."""
    collection = bpy.data.collections.new(name)
    for part in parts:
        collection.objects.link(bpy.data.objects.new(part.name, part))
    return Patch(collection, (size, size))


def new_mesh(
    name: str,
    points: np.ndarray,
    faces: np.ndarray,
    colours: np.ndarray,
    material: bpy.types.Material,
) -> bpy.types.Mesh:
    """A smooth mesh of points (n, 3) in metres, faces (m, 3 or 4) and linear colours (n, 3)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points.tolist(), [], faces.tolist(), shade_flat=False)
    rgba = np.ones((len(points), 4), np.float32)
    rgba[:, :3] = colours
    layer = mesh.color_attributes.new("Col", "FLOAT_COLOR", "POINT")
    layer.data.foreach_set("color", rgba.ravel())
    mesh.materials.append(material)
    return mesh


def height_field(
    name: str, height: np.ndarray, size: float, colours: np.ndarray, material: bpy.types.Material
) -> bpy.types.Mesh:
    """A periodic height field (n, n) [y, x] in metres, colours (n, n, 3), over a patch."""
    count = len(height)
    around = np.arange(count + 1) % count  # the far edge repeats the near one
    height, colours = height[np.ix_(around, around)], colours[np.ix_(around, around)]
    steps = size * (np.arange(count + 1) / count - 0.5)
    x, y = np.meshgrid(steps, steps)
    points = np.stack([x, y, height], -1).reshape(-1, 3)
    return new_mesh(name, points, grid_faces(count, count), colours.reshape(-1, 3), material)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Quads (rows * columns, 4) of a grid with (rows + 1) * (columns + 1) vertices, row by row."""
    low = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    return np.stack([low, low + 1, low + columns + 2, low + columns + 1], -1)


def joined(parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """(points, faces, colours) of several as one."""
    points, faces, colours = zip(*parts, strict=True)
    starts = np.cumsum([0, *map(len, points[:-1])])
    moved = [face + start for face, start in zip(faces, starts, strict=True)]
    return np.concatenate(points), np.concatenate(moved), np.concatenate(colours)


def principled(name: str, **inputs: float) -> bpy.types.Material:
    """A Principled material whose base colour is the points' colour; other inputs by their name
    with _ for each blank."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before 5.0
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    colour = nodes.new("ShaderNodeAttribute")
    colour.attribute_name = "Col"
    links.new(colour.outputs["Color"], shader.inputs["Base Color"])
    return material


def hair(
    name: str,
    strands: list[np.ndarray],
    radii: list[float],
    colours: np.ndarray,
    material: bpy.types.Material,
) -> bpy.types.Curves:
    """Hair curves of strands (points, 3) and a radius in metres and a colour (3) for each."""
    curves = bpy.data.hair_curves.new(name)
    sizes = [len(strand) for strand in strands]
    curves.add_curves(sizes)
    points = np.concatenate(strands).astype(np.float32)
    curves.attributes["position"].data.foreach_set("vector", points.ravel())
    layers = curves.attributes
    radius = layers.get("radius") or layers.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.repeat(np.float32(radii), sizes))
    rgba = np.ones((len(points), 4), np.float32)
    rgba[:, :3] = np.repeat(colours, sizes, axis=0)
    layers.new("Col", "FLOAT_COLOR", "POINT").data.foreach_set("color", rgba.ravel())
    curves.materials.append(material)
    return curves
