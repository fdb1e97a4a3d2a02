"""What a scene keeps of how its patch is to be measured."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

SETS = (
    ("ubo81", "UBO 81", "The 81 directions down to 75 degrees, as Bonn's BTFs of 2003 and UTIA's"),
    ("ubo151", "UBO 151", "The 151 directions down to 75 degrees, as Bonn's BTFs of 2014"),
    ("uniform", "Uniform", "Any number of directions at even distances down to 80 degrees"),
    ("csv", "CSV File", "A CSV file with the header theta,phi, in degrees from the normal"),
)


def _set(which: str) -> EnumProperty:
    return EnumProperty(
        name=f"{which}s", description=f"Directions of the {which.lower()}s", items=SETS
    )


def _count(which: str) -> IntProperty:
    return IntProperty(
        name="Count", description=f"How many {which.lower()}s", default=81, min=1, max=4096
    )


def _file(which: str) -> StringProperty:
    return StringProperty(
        name="File",
        description=f"CSV file of the {which.lower()}s: a line theta,phi, then two numbers each",
        subtype="FILE_PATH",
    )


def _length(name: str, description: str) -> FloatProperty:
    return FloatProperty(
        name=name,
        description=description,
        subtype="DISTANCE",
        unit="LENGTH",
        min=0.0,
        default=0.0,
        precision=4,
    )


class NACRE_PG_measurement(bpy.types.PropertyGroup):
    """The patch and the instrument."""

    what: EnumProperty(
        name="Patch",
        description="What is measured; it lies level and repeats in x and y",
        items=(
            ("OBJECT", "Object", "An object, centred on its origin", "OBJECT_DATA", 0),
            (
                "COLLECTION",
                "Collection",
                "All objects of a collection, centred on its instance offset",
                "OUTLINER_COLLECTION",
                1,
            ),
            ("MATERIAL", "Material", "A material on a plane", "MATERIAL", 2),
        ),
    )
    object: PointerProperty(
        name="Object",
        description="The object that is measured; if empty, the active one",
        type=bpy.types.Object,
    )
    collection: PointerProperty(
        name="Collection", description="The collection to measure", type=bpy.types.Collection
    )
    material: PointerProperty(
        name="Material", description="The material to measure", type=bpy.types.Material
    )
    width: _length("Width", "Length along x after which the patch repeats; 0 is the object's own")
    height: _length("Height", "Length along y after which the patch repeats; 0 is as the width")
    kind: EnumProperty(
        name="Kind",
        description="What the dataset holds",
        items=(
            ("BTF", "BTF", "How the patch looks from each view under each light"),
            ("MASK", "Occlusion Mask", "Where the patch covers what is behind it, for each view"),
            (
                "DISTANCE",
                "Occlusion Distance",
                "The same as distances from the holes' edges, which compress better",
            ),
        ),
    )
    views: _set("View")
    view_count: _count("View")
    view_file: _file("View")
    lights: _set("Light")
    light_count: _count("Light")
    light_file: _file("Light")
    texels: IntProperty(
        name="Texels",
        description="Resolution along the patch's width",
        default=64,
        min=1,
        max=4096,
        soft_max=512,
    )
    use_noise_target: BoolProperty(
        name="Noise Target", description="Find the number of samples that a noise floor takes"
    )
    samples: IntProperty(
        name="Samples",
        description="Paths of light through each texel; twice as many, about 4 dB less noise",
        default=16,
        min=1,
        max=2**16,
        soft_max=1024,
    )
    noise_db: FloatProperty(
        name="Noise Floor",
        description="Energy of the samples over that of their noise, in decibels; compression "
        "to more than this keeps noise",
        default=30.0,
        min=1.0,
        max=60.0,
        precision=1,
        step=50,
    )
    bounces: IntProperty(
        name="Bounces",
        description="How often light goes on from surface to surface",
        default=4,
        min=0,
        max=1024,
        soft_max=16,
    )
    seed: IntProperty(
        name="Seed", description="Of the first picture's noise; each has its own", min=0, max=2**30
    )
    output: StringProperty(
        name="Save As",
        description="Dataset folder to write; when empty, NAME.nacre beside the .blend file",
        subtype="FILE_PATH",
    )


def directions(chosen: NACRE_PG_measurement, which: str) -> str:
    """The name of the set of directions for "view" or "light", as `direction_set` takes it."""
    kind = getattr(chosen, f"{which}s")
    if kind == "uniform":
        return f"uniform:{getattr(chosen, f'{which}_count')}"
    if kind == "csv":
        return bpy.path.abspath(getattr(chosen, f"{which}_file"))
    return kind


def item_to_measure(
    chosen: NACRE_PG_measurement, context: bpy.types.Context
) -> bpy.types.Object | bpy.types.Collection | bpy.types.Material | None:
    """What the user picked, or the active object."""
    item = getattr(chosen, chosen.what.lower())
    if item is None and chosen.what == "OBJECT":
        return context.object
    return item
