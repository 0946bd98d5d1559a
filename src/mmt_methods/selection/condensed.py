"""Removal of redundant points, independent of their order.

Condensing starts with the corners of the convex hull. While the error at some point exceeds the
threshold, a point near the largest error is added: of the nearest points outside the set, the one
whose filter is closest to the consensus at the largest error. So errors decide what is kept, not
the order. Of several points in one place the most typical one stays; a rule that adds the point
with the largest error itself would keep the most unusual one.

The error is taken against the consensus of all points (`mmt_methods.selection.consensus`), not
against a point's own filter with its scatter.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray, FloatArray
from mmt_methods.selection.consensus import Consensus
from mmt_methods.selection.points import ModelPoints, amplitude_of, spectral_error
from mmt_methods.selection.simplices import enclose, hull_of

TAU: Final = 0.27
"""Largest relative spectral error of the condensed model."""

_NEAR: Final = 4  # candidates near the largest error: so many times dimensions plus one


class Condensed(NamedTuple):
    """Masks of n points: ``minimal`` (n,), corners of the hull, and ``kept`` (n,).

    ``error`` (n,) is the relative spectral error of the condensed model against the
    consensus, at every point that is not kept.
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
    O(n^3) for the consensus, and one triangulation of the kept points for each added point.
    """
    n = len(data)
    minimal = np.zeros(n, dtype=np.bool_)
    minimal[hull_of(data.points)] = True
    if minimal.all() or n < 3:
        return Condensed(minimal, np.ones(n, dtype=np.bool_), np.zeros(n))
    consensus = Consensus(data)
    agreed = np.exp(0.5 * consensus.smoothed(consensus.predict_from(np.ones(n, dtype=np.bool_))))
    own = amplitude_of(data.lsf, data.variance, data.frequencies)
    nearest = cKDTree(data.points)
    near = min(n, _NEAR * (data.points.shape[1] + 1))
    thin = _Thin(data, agreed, minimal.copy())
    while largest is None or thin.kept.sum() < largest:
        worst = _first_least(-thin.error, data.points)
        if thin.error[worst] <= tau:
            break
        places = nearest.query(data.points[worst], k=near)[1]
        places = places[~thin.kept[places]]
        if not places.size:  # all points near it are kept: nothing more can be done
            thin.settled[worst] = True
            thin.error[worst] = 0.0
            continue
        misfit = spectral_error(own[places], agreed[worst])
        thin.add(int(places[_first_least(misfit, data.points[places])]))
    return Condensed(minimal, thin.kept, thin.error)


def _first_least(values: FloatArray, points: FloatArray) -> int:
    """Return the index of the least value; of equal values, that at the least place."""
    return int(np.lexsort((*points.T[::-1], values))[0])


class _Thin:
    """The condensed model, and its error at every point (n,)."""

    def __init__(self, data: ModelPoints, agreed: FloatArray, kept: BoolArray) -> None:
        self._points, self._agreed = data.points, agreed
        self._values = np.column_stack([data.lsf, data.variance])
        self._members = np.full((len(data), data.points.shape[1] + 1), -2, dtype=np.int64)
        self.kept, self.settled = kept, kept.copy()
        self.error = np.zeros(len(data))
        self._ask()

    def add(self, index: int) -> None:
        """Add a point, and update the errors at points whose simplex changes."""
        self.kept[index] = self.settled[index] = True
        self.error[index] = 0.0
        self._ask()

    def _ask(self) -> None:
        kept, places = np.flatnonzero(self.kept), np.flatnonzero(~self.settled)
        around = enclose(self._points[kept], self._points[places])
        members = np.where(around.members < 0, -1, kept[around.members])
        changed = np.flatnonzero((np.sort(members, axis=1) != self._members[places]).any(axis=1))
        self._members[places] = np.sort(members, axis=1)
        values = around.interpolate(self._values[kept])[changed]
        found = np.isfinite(values[:, 0])
        error = np.full(changed.size, np.inf)  # beyond the hull by rounding: must be added
        error[found] = spectral_error(
            amplitude_of(values[found, :-1], values[found, -1], self._agreed.shape[1]),
            self._agreed[places[changed[found]]],
        )
        self.error[places[changed]] = error
