"""`python -m addon VERB ...`: the command line where bpy is a wheel or absent."""

import sys

from .cli import main

sys.exit(main(sys.argv[1:]))
