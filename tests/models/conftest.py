"""What these tests share: `small_btf` and `measured` lie beside them, `fibres` with the datasets'."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

sys.path[:0] = [str(HERE), str(HERE.parent / "datasets")]
