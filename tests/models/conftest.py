"""Where `small_btf`, `measured` and the datasets' `fibres` are found."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

sys.path[:0] = [str(HERE), str(HERE.parent / "datasets")]
