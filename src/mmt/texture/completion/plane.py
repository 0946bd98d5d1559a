"""The part of the plane of speed and force that counts: where models are scored and expected.

It reaches from the least speed and force that are modelled to 300 mm/s and 3 N, and is cut into
equal cells, in whose middles models are looked at.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S, ModellingSettings

SPEED_RANGE_MM_S: Final = (ModellingSettings.least_speed_mm_s, MAXIMUM_SPEED_MM_S)
FORCE_RANGE_N: Final = (ModellingSettings.least_force_n, MAXIMUM_FORCE_N)


def speeds_mm_s(count: int) -> FloatArray:
    """Return the speeds in the middles of so many cells, shape (count,)."""
    return middles(SPEED_RANGE_MM_S, count)


def forces_n(count: int) -> FloatArray:
    """Return the forces in the middles of so many cells, shape (count,)."""
    return middles(FORCE_RANGE_N, count)


def middles(ends: tuple[float, float], count: int) -> FloatArray:
    """Return the middles of so many equal parts of a range, shape (count,)."""
    low, high = ends
    return low + (high - low) * (np.arange(count) + 0.5) / count
