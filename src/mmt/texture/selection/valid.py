"""Filters out of numbers that an interpolator gave which knows nothing of filters."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray

LEAST_GAP_RAD: Final = 0.01
"""Between line spectral frequencies that had to be put in order."""


def valid_filter(lsf: FloatArray, variance: float) -> tuple[FloatArray, float]:
    """Return line spectral frequencies in order inside (0, pi), and a positive variance.

    What is valid is returned as it is; a convex combination always is. Otherwise the
    frequencies are sorted and pushed apart to `LEAST_GAP_RAD` (less where the order leaves
    no room for it).
    """
    variance = max(variance, float(np.finfo(np.float64).tiny))
    if (np.diff(lsf, prepend=0.0, append=np.pi) > 0).all():
        return lsf, variance
    gap = min(LEAST_GAP_RAD, 0.5 * np.pi / (len(lsf) + 1))
    steps = gap * np.arange(1, len(lsf) + 1)
    ordered = np.maximum.accumulate(np.sort(lsf) - steps)
    top = np.pi - gap * (len(lsf) + 1)
    return np.clip(ordered, 0.0, top) + steps, variance
