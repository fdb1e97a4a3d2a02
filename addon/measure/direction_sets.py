"""Named sets of directions that laboratories measure at."""

import numpy as np

from ..datasets.directions import spherical_to_unit

# (theta in degrees, directions evenly spaced in azimuth from phi = 0): the 81 directions of the
# University of Bonn's BTFs, in the order of its files.
_UBO_81 = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 20), (75, 24))


def ubo_81() -> np.ndarray:
    """Unit vectors (81, 3) float64."""
    rings = [(theta, 360.0 * i / count) for theta, count in _UBO_81 for i in range(count)]
    theta, phi = zip(*rings, strict=True)
    return spherical_to_unit(theta, phi)
