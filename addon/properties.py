"""What a scene and a material keep of the user's choices."""

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .comparison_properties import NACRE_PG_comparison
from .errors import NacreError
from .facts import dataset_facts, ensemble_facts, expected_model, model_facts
from .measurement_properties import NACRE_PG_measurement

TARGETS = {"TARGET_DB": "target_db", "TARGET_MB": "target_mb"}
"""Qualities that a search reaches, and the property that holds each."""


# Panels only draw what these callbacks found out when a path was set: no file is read to draw.


def _dataset_set(self: "NACRE_PG_scene", context: bpy.types.Context) -> None:
    self.dataset_facts = dataset_facts(bpy.path.abspath(self.dataset))
    _settings_set(self, context)


def _settings_set(self: "NACRE_PG_scene", _context: bpy.types.Context) -> None:
    self.expected_size = self.ensemble_facts = ""
    if not self.dataset:
        return
    if self.method == "SPARSE":
        paths = (bpy.path.abspath(path) for path in (self.dataset, self.ensemble))
        self.ensemble_facts = ensemble_facts(*paths, self.sparse_quality)
        return
    if self.quality in TARGETS:
        return
    try:
        from .datasets.dataset import open_dataset
        from .models.fit import quality_settings

        dataset = open_dataset(bpy.path.abspath(self.dataset))
        settings = quality_settings(dataset, self.method.lower(), self.quality)
    except (NacreError, ImportError):
        return
    self.expected_size = expected_model(dataset, self.method.lower(), settings)


def _model_set(self: "NACRE_PG_scene", _context: bpy.types.Context) -> None:
    self.model_facts = model_facts(bpy.path.abspath(self.model))


class NACRE_PG_scene(bpy.types.PropertyGroup):
    """From a measured file to a material: the paths and settings of each step."""

    measurement: PointerProperty(
        name="Measurement",
        description="What is measured with Cycles, and how",
        type=NACRE_PG_measurement,
    )
    comparison: PointerProperty(
        name="Comparison",
        description="The scene in EEVEE beside Cycles",
        type=NACRE_PG_comparison,
    )
    dataset: StringProperty(
        name="Dataset",
        description="Folder of the imported or measured samples, NAME.nacre",
        subtype="DIR_PATH",
        update=_dataset_set,
    )
    dataset_facts: StringProperty(options={"HIDDEN"})
    method: EnumProperty(
        name="Method",
        description="How the samples are approximated",
        items=(
            ("NSVD", "N-SVD", "One core tensor for all views: best quality, slow to draw"),
            ("CTA", "CTA", "Each view in one cluster: fastest to draw, lowest quality"),
            ("KCTA", "K-CTA", "Each view mixes a few clusters: fast to draw, good quality"),
            (
                "MKCTA",
                "MK-CTA",
                "Each view and each light mixes a few clusters: best quality on glossy surfaces",
            ),
            (
                "SPARSE",
                "SparseBTF",
                "A few coefficients of dictionaries that were trained on other materials: one file "
                "has every quality",
            ),
        ),
        default="KCTA",
        update=_settings_set,
    )
    quality: EnumProperty(
        name="Quality",
        description="How much of the samples' detail is kept",
        items=(
            ("DRAFT", "Draft", "Small and quick, for a first look"),
            ("MEDIUM", "Medium", "A good picture at a moderate size"),
            ("HIGH", "High", "About as close to the real thing as the samples are"),
            (
                "TARGET_DB",
                "Target Quality",
                "The smallest model of a quality; takes several fits to find",
            ),
            ("TARGET_MB", "Target Size", "The best model of a size; takes several fits to find"),
        ),
        default="HIGH",
        update=_settings_set,
    )
    target_db: FloatProperty(
        name="Decibels",
        description="Energy of the samples over that of the error, in decibels: 10 keeps 90 % of "
        "the energy, 20 keeps 99 %",
        default=15.0,
        min=0.1,
        soft_max=40.0,
        max=66.0,
        precision=1,
        step=50,
    )
    target_mb: FloatProperty(
        name="Megabytes",
        description="Largest size of the model's file, in millions of bytes",
        default=1.0,
        min=0.001,
        soft_max=100.0,
        precision=3,
    )
    ensemble: StringProperty(
        name="Dictionaries",
        description="File of dictionaries that `train` made for the same directions, or a sparse "
        "model that has them. Empty for those Nacre comes with: 81 and 151 directions of Bonn",
        subtype="FILE_PATH",
        update=_settings_set,
    )
    ensemble_facts: StringProperty(options={"HIDDEN"})
    sparse_quality: IntProperty(
        name="Quality",
        description="Latent-equivalents N of SparseBTF(N): 2 N bytes a texel. The file has all "
        "lower ones, too",
        default=64,
        min=1,
        soft_min=16,
        max=4096,
        soft_max=256,
        update=_settings_set,
    )
    expected_size: StringProperty(options={"HIDDEN"})
    output: StringProperty(
        name="Save As",
        description="File of the compressed model; when empty, NAME.exr beside the dataset",
        subtype="FILE_PATH",
    )
    model: StringProperty(
        name="Model",
        description="File of a compressed model, NAME.exr",
        subtype="FILE_PATH",
        update=_model_set,
    )
    model_facts: StringProperty(options={"HIDDEN"})
    lights: PointerProperty(
        name="Lights",
        description="Suns, points, spots and areas of this collection light the new material; if "
        "empty, those of the scene",
        type=bpy.types.Collection,
    )


def _lights_set(self: "NACRE_PG_material", context: bpy.types.Context) -> None:
    from .nodes.material import is_nacre_material, set_lights

    if is_nacre_material(self.id_data):
        set_lights(self.id_data, self.lights or context.scene, self.shadows)


def _quality_set(self: "NACRE_PG_material", _context: bpy.types.Context) -> None:
    from .quality_slider import follow_quality

    for name in ("quality", "final_quality"):
        if 0 < self.file_quality < getattr(self, name):
            setattr(self, name, self.file_quality)
    follow_quality(self.id_data)


class NACRE_PG_material(bpy.types.PropertyGroup):
    """What the user may change about a material that shows a model."""

    lights: PointerProperty(
        name="Lights",
        description="Suns, points, spots and areas of this collection light this material, "
        "followed live; if empty, those of the scene",
        type=bpy.types.Collection,
        update=_lights_set,
    )
    shadows: BoolProperty(
        name="Receive Shadows",
        description="In EEVEE, take from the scene how much of each light arrives: shadows of all "
        "objects, light linking, and where a light ends. Costs more with each light. In Material "
        "Preview it needs Scene Lights on. Cycles cannot do this, and shows all lights without "
        "shadows",
        default=False,
        update=_lights_set,
    )
    patch_size: FloatVectorProperty(
        name="Patch Size",
        description="Width and height of the measured patch; 0 where the model does not say",
        size=2,
        subtype="XYZ_LENGTH",
        min=0.0,
    )
    model: StringProperty(
        name="Model",
        description="File of the model that this material shows; Update reads it",
        subtype="FILE_PATH",
    )
    occlusion: StringProperty(
        name="Occlusion",
        description="File of a model of occlusion that gives this material its holes; Update reads "
        "it. If empty, it has none",
        subtype="FILE_PATH",
    )
    blended: StringProperty(
        name="Mix With",
        description="File of a second sparse model, of the same directions or others; Update reads "
        "it. The input Mix of the material's node says how much of it is shown, and takes a mask. "
        "Logarithms are mixed (SparseBTF, Section 3.5 Eq. 7). If empty, there is none",
        subtype="FILE_PATH",
    )
    final_model: StringProperty(
        name="Final Model",
        description="File of the model that replaces it while a final render runs, of a higher "
        "quality for instance; Update reads it. If empty, the same model",
        subtype="FILE_PATH",
    )
    quality: IntProperty(
        name="Quality",
        description="Latent-equivalents of the sparse model that are shown: the most important "
        "coefficients, in twice as many bytes a texel. Less is faster to draw; one file has them "
        "all, without a new fit",
        min=1,
        soft_min=16,
        default=64,
        max=4096,
        soft_max=256,
        options=set(),
        update=_quality_set,
    )
    final_quality: IntProperty(
        name="Final Quality",
        description="Latent-equivalents of the sparse model in final renders; 0 for those that are "
        "shown",
        min=0,
        default=0,
        max=4096,
        soft_max=256,
        options=set(),
        update=_quality_set,
    )
    file_quality: IntProperty(options={"HIDDEN"})  # the best of the file; 0 if it has no slider
    shown_quality: IntProperty(options={"HIDDEN"})  # what the nodes hold
    shown_final: IntProperty(options={"HIDDEN"})  # and for final renders; 0 if nothing else
    problem: StringProperty(options={"HIDDEN"})  # why it is not the one that is asked for


CLASSES = (NACRE_PG_measurement, NACRE_PG_comparison, NACRE_PG_scene, NACRE_PG_material)
