"""Removal of redundant points, independent of their order.

Condensing starts with the corners of the convex hull. While the error at some point exceeds the
threshold, a point is added near the largest error: of the nearest points that are not in the set,
the one whose filter is closest to the prediction there. So the errors decide what is kept, not the
numbering, and of several points in one place the most typical one stays, where a rule that adds
the point in error keeps the most unusual.

The error is taken against the consensus of all points (`mmt.texture.selection.consensus`), not
against a point's own filter with its scatter.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.selection.consensus import Consensus
from mmt.texture.selection.enclosing_simplex import enclose_each
from mmt.texture.selection.leave_one_out import hull_of
from mmt.texture.selection.points import ModelPoints, amplitude_of
from mmt.texture.selection.published import spectral_error

TAU: Final = 0.27
"""Largest relative spectral error of the condensed model."""

_NEAR: Final = 4  # candidates at the largest error, times the dimensions plus one


class Condensed(NamedTuple):
    """Masks of n points: ``minimal`` (n,), corners of the hull, and ``kept`` (n,).

    ``error`` (n,) is the relative spectral error of the thin model against the consensus at
    every place that is not kept.
    """

    minimal: BoolArray
    kept: BoolArray
    error: FloatArray


def condense(data: ModelPoints, tau: float = TAU, largest: int | None = None) -> Condensed:
    """Choose the points that a model of the same texture needs.

    Parameters
    ----------
    data
        The points, outliers left out.
    tau
        Largest relative spectral error between the model of the kept points and the
        consensus, at any point's place.
    largest
        Largest number of points kept, whatever the error; corners of the hull are kept even if
        they alone are more.

    Notes
    -----
    O(n^3) for the consensus. The model is asked again only at places in whose circumsphere a point
    has joined: with c kept points about O(n c d) in all.
    """
    n = len(data)
    minimal = np.zeros(n, dtype=np.bool_)
    minimal[hull_of(data.points)] = True
    if minimal.all() or n < 3:
        return Condensed(minimal, np.ones(n, dtype=np.bool_), np.zeros(n))
    consensus = Consensus(data)
    everyone = np.ones(n, dtype=np.bool_)
    agreed = np.exp(0.5 * consensus.smoothed(consensus.predict_from(everyone)))
    nearest = cKDTree(data.points)
    thin = _Thin(data, agreed, minimal.copy())
    near = min(n, _NEAR * (data.points.shape[1] + 1))
    while largest is None or thin.kept.sum() < largest:
        worst = thin.worst()
        if thin.error[worst] <= tau:
            break
        places = nearest.query(data.points[worst], k=near)[1]
        open_places = places[~thin.kept[places]]
        if not open_places.size:
            thin.error[worst] = 0.0  # all that is there is kept: nothing more can be done
            continue
        own = spectral_error(thin.amplitude[open_places], agreed[worst])
        thin.add(int(open_places[_first_least(own, data.points[open_places])]))
    return Condensed(minimal, thin.kept, thin.error)


def _first_least(values: FloatArray, points: FloatArray) -> int:
    """Return the number of the least value; of equals, that of the least place."""
    return int(np.lexsort((*points.T[::-1], values))[0])


class _Thin:
    """The condensed model, and its error at every point."""

    def __init__(self, data: ModelPoints, agreed: FloatArray, kept: BoolArray) -> None:
        self._data = data
        self._agreed = agreed
        self.kept = kept
        self.amplitude = amplitude_of(data.lsf, data.variance)
        n, d = data.points.shape
        self._price = np.zeros((n, d + 1))
        self.error = np.zeros(n)
        self._ask(np.flatnonzero(~kept))

    def worst(self) -> int:
        """Return the index of the point of largest error."""
        return _first_least(-self.error, self._data.points)

    def add(self, index: int) -> None:
        """Add a point, and update the errors where it changes the simplex."""
        self.kept[index] = True
        self.error[index] = 0.0
        offset = self._data.points[index] - self._data.points
        inside = (offset**2).sum(axis=1) < (self._price[:, :-1] * offset).sum(axis=1) + (
            self._price[:, -1]
        )
        self._ask(np.flatnonzero(inside & ~self.kept))

    def _ask(self, places: IntArray) -> None:
        if not places.size:
            return
        kept = np.flatnonzero(self.kept)
        size = self._data.points.shape[1] + 1
        members = np.empty((places.size, size), dtype=np.int64)
        weights, price = np.zeros((2, places.size, size))
        enclose_each(
            self._data.points,
            np.tile(kept, places.size),
            np.arange(places.size + 1) * kept.size,
            self.kept,
            places,
            members,
            weights,
            price,
        )
        self._price[places] = price
        lsf = np.einsum("qc,qco->qo", weights, self._data.lsf[members])
        variance = np.einsum("qc,qc->q", weights, self._data.variance[members])
        found = members[:, 0] >= 0
        error = np.full(places.size, np.inf)  # beyond the hull by a rounding: it has to join
        error[found] = spectral_error(
            amplitude_of(lsf[found], variance[found]), self._agreed[places[found]]
        )
        self.error[places] = error
