"""What a point's neighbours agree on: a local plane through the logarithms of their spectra.

Level and shape of a texture change smoothly with speed, force and heading, and close to
proportionally: in the logarithm of the spectrum a plane over the nearest points fits. It also
reaches a little beyond them, so that corners of the hull can be tested, and it averages a
dozen fits where a simplex averages three or four.

The scatter of a fit is known. In the logarithm of the spectrum the Fisher information of a
stationary Gaussian signal does not depend on its spectrum (Whittle 1953; Bloomfield 1973):
with r the difference of the logarithms of an autoregressive fit of order m to N samples and of
the truth, ``N / 2 mean(r^2)`` has a chi-squared distribution of m + 1 degrees of freedom. So a
mean of squares of logarithms over a uniform grid is the whitened distance, without a matrix.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mmt.arrays import BoolArray, FloatArray, IntArray

_RIDGE: Final = 0.002
_EDGE: Final = 1.1  # the kernel's radius over the distance of the farthest neighbour


class Consensus(NamedTuple):
    """Linear predictions at every point from others: ``weights`` of ``members``, (n, k)."""

    members: IntArray
    weights: FloatArray

    def of(self, values: FloatArray) -> FloatArray:
        """Return the prediction of values (n, ...) at every point."""
        result: FloatArray = np.einsum("nk,nk...->n...", self.weights, values[self.members])
        return result

    def scatter(self, variances: FloatArray) -> FloatArray:
        """Return the variance (n,) of own value less prediction, from that of each value."""
        result: FloatArray = variances + np.einsum(
            "nk,nk->n", self.weights**2, variances[self.members]
        )
        return result


def neighbours_wanted(dimensions: int) -> int:
    """Return how many neighbours make a consensus: four for each coefficient of the plane."""
    return 4 * (dimensions + 1)


def consensus(points: FloatArray, present: BoolArray, count: int | None = None) -> Consensus:
    """Return the local planes around all points, present or not, from present others.

    Parameters
    ----------
    points
        Shape (n, d).
    present
        Shape (n,): who has a say; at least two.
    count
        Neighbours of each; `neighbours_wanted` unless told, fewer where there are fewer.

    Notes
    -----
    Tricube weights over the distance, a small ridge on the slopes so that neighbours on a
    line do no harm. O(n log n) for the neighbours, O(n k d^2) for the planes.
    """
    n, d = points.shape
    voices = np.flatnonzero(present)
    k = min(count or neighbours_wanted(d), len(voices) - 1)
    distance, place = cKDTree(points[voices]).query(points, k=k + 1)
    members = voices[place]
    own = members == np.arange(n)[:, None]
    order = np.argsort(own, axis=1, kind="stable")[:, :k]  # itself goes last, and out
    members = np.take_along_axis(members, order, axis=1)
    distance = np.take_along_axis(distance, order, axis=1)
    radius = _EDGE * distance[:, -1:]
    radius[radius == 0.0] = 1.0
    kernel = (1.0 - (distance / radius) ** 3) ** 3
    rows = np.concatenate(
        [np.ones((n, k, 1)), (points[members] - points[:, None, :]) / radius[..., None]], axis=2
    )
    weighed = rows * kernel[..., None]
    normal = np.einsum("nki,nkj->nij", weighed, rows)
    slopes = np.arange(1, d + 1)
    normal[:, slopes, slopes] += _RIDGE * kernel.sum(axis=1)[:, None]
    first = np.zeros((n, d + 1, 1))
    first[:, 0] = 1.0
    solved = np.linalg.solve(normal, first)[..., 0]
    return Consensus(members, np.einsum("ni,nki->nk", solved, weighed))
