"""One file for each verb of the command line.

A verb module has `add_arguments(parser)` and `run(options, progress)`, which returns what to print
as a JSON-able dict and raises NacreError; its docstring is the verb's help. It imports what it
needs when it runs: most verbs work without Blender, and none should wait for packages of others.
"""

from types import ModuleType

from . import (
    blend,
    compare,
    compress,
    decode,
    export,
    import_btf,
    info,
    material,
    measure,
    merge,
    render,
    train,
    verify,
)

VERBS: dict[str, ModuleType] = {
    "import": import_btf,
    "export": export,
    "measure": measure,
    "merge": merge,
    "info": info,
    "train": train,
    "compress": compress,
    "blend": blend,
    "decode": decode,
    "compare": compare,
    "verify": verify,
    "material": material,
    "render": render,
}
