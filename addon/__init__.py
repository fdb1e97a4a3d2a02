"""Measured materials (BTF), compressed and live in the viewport."""

_cli_commands: list = []


def register() -> None:
    """Add what the user sees; nothing compiled is imported before it is used."""
    import bpy

    from . import live, operators, panels, properties
    from .preview import engine, standard_panels

    for cls in (*properties.CLASSES, *operators.CLASSES, *panels.CLASSES):
        bpy.utils.register_class(cls)
    bpy.utils.register_class(engine.NACRE_RE_engine)
    standard_panels.add(engine.NACRE_RE_engine.bl_idname)
    bpy.types.Scene.nacre = bpy.props.PointerProperty(type=properties.NACRE_PG_scene)
    bpy.types.Material.nacre = bpy.props.PointerProperty(type=properties.NACRE_PG_material)
    live.register()
    bpy.types.TOPBAR_MT_file_import.append(operators.draw_import_menu)
    bpy.types.TOPBAR_MT_file_export.append(operators.draw_export_menu)

    def command(arguments: list[str]) -> int:
        from .cli import main

        return main(arguments)

    _cli_commands.append(bpy.utils.register_cli_command("nacre", command))


def unregister() -> None:
    """Stop a running job and take everything back."""
    import bpy

    from . import jobs, live, operators, panels, properties, quality_slider
    from .preview import engine, standard_panels

    jobs.stop()
    quality_slider.stop()
    live.unregister()
    while _cli_commands:
        bpy.utils.unregister_cli_command(_cli_commands.pop())
    bpy.types.TOPBAR_MT_file_export.remove(operators.draw_export_menu)
    bpy.types.TOPBAR_MT_file_import.remove(operators.draw_import_menu)
    del bpy.types.Material.nacre
    del bpy.types.Scene.nacre
    standard_panels.remove(engine.NACRE_RE_engine.bl_idname)
    bpy.utils.unregister_class(engine.NACRE_RE_engine)
    for cls in reversed((*properties.CLASSES, *operators.CLASSES, *panels.CLASSES)):
        bpy.utils.unregister_class(cls)
