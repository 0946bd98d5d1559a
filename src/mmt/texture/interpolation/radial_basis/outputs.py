"""What a radial basis function network returns, made a valid filter.

A network is no convex combination: between samples it overshoots, beyond them it follows its
polynomial. So its line spectral frequencies (LSF) are replaced by the nearest valid ones: at
least a gap apart, and each within what the samples have of it, which keeps them from 0 and pi.
With the gaps taken out, ``z_i = w_i - i gap``, valid means ascending within ascending bounds,
and pooling adjacent violators, each pool at its mean within its bounds, finds the nearest
(least squares) in O(m) (Best, Chakravarti and Ubhaya, "Minimizing separable convex functions
subject to simple chain constraints", SIAM J. Optim. 10 (2000), 658-672).
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate

LEAST_GAP: Final = 0.03
"""In rad: just below the smallest gap, 0.038 rad, of the HaTT models at 1 kHz."""


def least_gap(lsf: FloatArray) -> float:
    """Return the gap to keep for samples (n, m): 0.03 rad, or what they themselves keep.

    Distances from 0 and pi count as gaps.
    """
    gaps = np.diff(lsf, axis=1, prepend=0.0, append=math.pi)
    return float(min(LEAST_GAP, gaps.min()))


@kernel("void(f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def nearest_valid_lsf(
    lsf: FloatArray, gap: float, lowest: FloatArray, highest: FloatArray, work: FloatArray
) -> None:
    """Replace frequencies by the nearest ones within bounds that are a gap apart.

    Parameters
    ----------
    lsf : (m,)
        Any numbers; those that are not finite count as pi/2.
    gap
        In rad, not negative.
    lowest, highest : (m,)
        Bounds inside (0, pi), either of them a gap apart.
    work : (3 * m,) or longer
        Scratch.

    Notes
    -----
    What rounding leaves together is moved apart by a rounding.
    """
    pools = 0  # each with its mean, its value within bounds, and how many it has
    for i in range(len(lsf)):
        mean = (lsf[i] if math.isfinite(lsf[i]) else 0.5 * math.pi) - i * gap
        size, first, least = 1, i, lowest[i] - i * gap
        value = min(max(mean, least), highest[i] - i * gap)
        while pools > 0 and work[3 * pools - 2] >= value:
            pools -= 1
            before = int(work[3 * pools + 2])
            share = size / (before + size)
            mean = work[3 * pools] * (1.0 - share) + mean * share
            size += before
            first -= before
            value = min(max(mean, least), highest[first] - first * gap)
        work[3 * pools] = mean
        work[3 * pools + 1] = value
        work[3 * pools + 2] = size
        pools += 1
    i = 0
    for pool in range(pools):
        for _ in range(int(work[3 * pool + 2])):
            lsf[i] = work[3 * pool + 1] + i * gap
            i += 1
    separate(lsf)
