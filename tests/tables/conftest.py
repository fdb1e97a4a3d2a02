"""These tests use the small models and measured materials that lie beside those of models."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "models"))
