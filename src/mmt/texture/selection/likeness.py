"""What the outliers found so far have in common, and how much of it every point has.

What is struck is mostly the same table, so knocks resemble each other. Fisher's linear
discriminant (1936) between the points that were accused and the others, in the whitened excess of
the logarithms of their spectra over the consensus, says how. The covariance of the others is
shrunk towards a multiple of the identity (Ledoit and Wolf 2004), half and half: there are about
as many frequencies as points. Nobody is compared with himself: the mean of the accused is taken
without the point that is asked.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray

LEAST: Final = 8
"""So many must be accused before they have something in common."""


def likeness(excess: FloatArray, accused: BoolArray) -> FloatArray:
    """Return how far each point lies from the good ones towards the accused, shape (n,).

    Parameters
    ----------
    excess
        Logarithms of the spectra over the consensus, over their sampling deviation, (n, f).
    accused
        Which points are outliers so far, shape (n,).

    Notes
    -----
    Zero for all where fewer than `LEAST` are accused, or as few are not. O(n f^2 + f^3).
    """
    count = int(accused.sum())
    if count < LEAST or len(accused) - count < LEAST:
        return np.zeros(len(accused))
    good = excess[~accused]
    centred = excess - np.median(good, axis=0)
    deviations = good - good.mean(axis=0)
    covariance = deviations.T @ deviations / len(good)
    size = len(covariance)
    covariance[np.diag_indices(size)] += max(np.trace(covariance) / size, np.finfo(np.float64).tiny)
    total = centred[accused].sum(axis=0)
    others = (total - centred * accused[:, None]) / (count - accused)[:, None]
    return np.asarray(np.einsum("nf,nf->n", centred, np.linalg.solve(covariance, others.T).T))
