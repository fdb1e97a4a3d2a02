"""One file for each thing a user does."""

from . import (
    cancel,
    compare_with_cycles,
    compress,
    create_material,
    export_btf,
    hide_repetition,
    import_btf,
    light_by_world,
    measure,
    real_size,
    update_material,
)

CLASSES = (
    import_btf.NACRE_OT_import_btf,
    import_btf.NACRE_FH_btf,
    export_btf.NACRE_OT_export_btf,
    measure.NACRE_OT_measure,
    compress.NACRE_OT_compress,
    create_material.NACRE_OT_create_material,
    update_material.NACRE_OT_update_material,
    light_by_world.NACRE_OT_light_by_world,
    real_size.NACRE_OT_real_size,
    hide_repetition.NACRE_OT_hide_repetition,
    compare_with_cycles.NACRE_OT_compare_with_cycles,
    cancel.NACRE_OT_cancel,
)
draw_import_menu = import_btf.draw_import_menu
draw_export_menu = export_btf.draw_export_menu
