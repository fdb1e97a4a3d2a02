"""Named sets are those of the laboratories' own files."""

from pathlib import Path

import numpy as np

from addon.datasets import btf
from addon.measure.direction_sets import ubo_81

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "wool_W64xH64_L81xV81.btf"


def test_ubo_81_is_the_order_of_a_bonn_file():
    source = btf.open_source(SAMPLE, None)
    np.testing.assert_allclose(ubo_81(), source.light, atol=1e-6)
    np.testing.assert_allclose(ubo_81(), source.view, atol=1e-6)
