"""What an artist may say of a measured file: the properties behind `datasets.options`."""

from typing import Any

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ..datasets.direction_sets import MOST

# Each choice and the option that it stands for; None leaves it to the file or the format.
COSINE = {"AUTO": None, "INCLUDED": 1, "NOT_INCLUDED": 0}
GAMMA = {"AUTO": None, "SRGB": "srgb", "LINEAR": 1.0}
COLOUR_SPACE = {"AUTO": None, "REC709": "rec709", "XYZ": "xyz"}
DIRECTIONS = {"AUTO": None, "UBO151": "ubo151"}

_SETS = (
    ("AUTO", "Bonn 2003", "The 81 directions that BTFs are usually measured at, down to 75°"),
    ("UBO151", "Bonn 2014", "The 151 directions of Bonn's newer BTFs, down to 75°"),
    ("UNIFORM", "Even", "As many as you like, at even distances down to 80°"),
)


class ImportOptions:
    """Properties of an operator; each is drawn only for files whose format takes the option."""

    cosine: EnumProperty(
        name="Cosine",
        description="Whether the file's values include the cosine of the light's angle",
        items=(
            ("AUTO", "Auto", "As the file says; one that does not say is taken to include it"),
            ("INCLUDED", "Included", "Take the values as they stand"),
            ("NOT_INCLUDED", "Not Included", "Multiply the values by the cosine"),
        ),
    )
    gamma: EnumProperty(
        name="Encoding",
        description="How the file's numbers stand for light",
        items=(
            ("AUTO", "Auto", "As is usual for the format"),
            ("SRGB", "sRGB", "Decode the curve of sRGB images"),
            ("LINEAR", "Linear", "Take the numbers as they stand"),
            ("POWER", "Gamma", "Raise the numbers to a power"),
        ),
        options={"SKIP_SAVE"},
    )
    gamma_power: FloatProperty(
        name="Gamma",
        description="The power that makes the file's numbers linear",
        default=2.2,
        min=0.01,
        soft_min=1.0,
        soft_max=3.0,
        max=10.0,
        options={"SKIP_SAVE"},
    )
    colour_space: EnumProperty(
        name="Colors",
        description="What the file's three channels are",
        items=(
            ("AUTO", "Auto", "As the file says, or as is usual for the format"),
            ("REC709", "Rec.709", "Red, green and blue, as in Blender and sRGB"),
            ("XYZ", "CIE XYZ", "X, Y and Z of 1931, with the white D65"),
        ),
        options={"SKIP_SAVE"},
    )
    white: FloatProperty(
        name="White",
        description="The file's value, made linear, of a white diffuser lit head-on, which becomes "
        "1; 0 for what is usual for the format",
        default=0.0,
        min=0.0,
        soft_max=10.0,
        precision=3,
        options={"SKIP_SAVE"},
    )
    patch_width: FloatProperty(
        name="Patch Width",
        description="Width of the piece of surface that was measured; 0 for what the file says, or "
        "1 cm if it does not",
        default=0.0,
        min=0.0,
        soft_max=1.0,
        precision=4,
        subtype="DISTANCE",
        unit="LENGTH",
        options={"SKIP_SAVE"},
    )
    directions: StringProperty(
        name="Direction List",
        description="CSV file of directions: theta,phi in degrees, of each mask's view, or of the "
        "lights and views that a BRDF is sampled at; for images a line of angles each",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    lights: EnumProperty(
        name="Lights",
        description="The light directions that a BRDF is sampled at",
        items=_SETS,
        options={"SKIP_SAVE"},
    )
    lights_count: IntProperty(
        name="Light Count",
        description="Number of light directions",
        default=100,
        min=1,
        soft_max=400,
        max=MOST,
        options={"SKIP_SAVE"},
    )
    views: EnumProperty(
        name="Views",
        description="The view directions that a BRDF is sampled at",
        items=_SETS,
        options={"SKIP_SAVE"},
    )
    views_count: IntProperty(
        name="View Count",
        description="Number of view directions",
        default=100,
        min=1,
        soft_max=400,
        max=MOST,
        options={"SKIP_SAVE"},
    )

    def chosen_options(self) -> dict[str, Any]:
        """The fields of Options, with None for what was left alone."""
        directions = bpy.path.abspath(self.directions) or None
        options = {
            "cosine": COSINE[self.cosine],
            "gamma": _shown(self.gamma_power) if self.gamma == "POWER" else GAMMA[self.gamma],
            "colour_space": COLOUR_SPACE[self.colour_space],
            "white": _shown(self.white) or None,
            "patch_width": _shown(self.patch_width) or None,
            "directions": directions,
        }
        for name in ("lights", "views"):
            chosen, count = getattr(self, name), getattr(self, f"{name}_count")
            options[name] = f"uniform:{count}" if chosen == "UNIFORM" else DIRECTIONS[chosen]
        return options

    def draw_options(self, layout: bpy.types.UILayout, takes: frozenset[str]) -> None:
        """The properties of those Options that the file's format takes."""
        if "cosine" in takes:
            layout.prop(self, "cosine")
        if "gamma" in takes:
            layout.prop(self, "gamma")
            if self.gamma == "POWER":
                layout.prop(self, "gamma_power")
        for name in ("colour_space", "white", "directions"):
            if name in takes:
                layout.prop(self, name)
        for name in ("lights", "views"):
            if name in takes and not self.directions:
                layout.prop(self, name)
                if getattr(self, name) == "UNIFORM":
                    layout.prop(self, f"{name}_count")
        if "patch_width" in takes:
            layout.prop(self, "patch_width")


def _shown(value: float) -> float:
    """A property in single precision as the number that it shows."""
    return float(f"{value:.6g}")
