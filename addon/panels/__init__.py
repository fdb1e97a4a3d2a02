"""What the user sees: the Nacre tab of the 3D viewport's sidebar."""

from . import (
    active_material,
    compare_with_cycles,
    compress,
    create_material,
    import_btf,
    measure,
    missing_wheels,
)

CLASSES = (
    missing_wheels.NACRE_PT_missing_wheels,
    import_btf.NACRE_PT_import_btf,
    measure.NACRE_PT_measure,
    compress.NACRE_PT_compress,
    create_material.NACRE_PT_create_material,
    active_material.NACRE_PT_active_material,
    compare_with_cycles.NACRE_PT_compare_with_cycles,
    compare_with_cycles.NACRE_PT_compare_in_images,
)
