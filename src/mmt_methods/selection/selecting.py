"""Sample selection independent of point order: outliers first, then redundant points.

Condensing starts with the corners of the convex hull. While the error at some point exceeds the
threshold, a point near the largest error is added: of the nearest points outside the set, the one
whose filter is closest to the consensus at the largest error. So errors decide what is kept, not
the order. Of several points in one place the most typical one stays; a rule that adds the point
with the largest error itself would keep the most unusual one.

The error is taken against the consensus of all points (`mmt_methods.selection.consensus`), not
against a point's own filter with its scatter.
"""

from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.bounds import check_fields
from mmt_methods.selection.consensus import Consensus
from mmt_methods.selection.outliers import FALSE_ALARMS, LARGEST_RATE, find_outliers, reasons
from mmt_methods.selection.points import ModelPoints, amplitude_of, enclose, hull_of, spectral_error

TAU: Final = 0.27
"""Largest relative spectral error of the condensed model."""

_NEAR: Final = 4  # candidates near the largest error: so many times dimensions plus one


@dataclass(frozen=True)
class SelectionSettings:
    """Thresholds of the selection.

    Raises
    ------
    SettingError
        A number is out of range.
    """

    false_alarms: Annotated[float, Gt(0), Le(LARGEST_RATE)] = FALSE_ALARMS
    """Share of the good points that may be taken for outliers."""

    tau: Annotated[float, Ge(0)] = TAU
    """Largest relative spectral error of the thinner model; 0 keeps all but the outliers."""

    largest: Annotated[int, Ge(1)] | None = None
    """Most points to keep, None for as many as `tau` needs. Corners of the convex hull stay even if
    they alone are more."""

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Selection:
    """Result of the selection for n points, arrays of shape (n,) in their given order.

    Attributes
    ----------
    outlier
        Points that contradict the others.
    kept
        Points of the selected set. Points that are neither are redundant.
    minimal
        Corners of the convex hull of the points that are no outliers.
    score
        Evidence of being an outlier, see `mmt_methods.selection.outliers`; 0 if there are
        too few points.
    reason
        A sentence for each outlier, "" for the others.
    error
        Relative spectral error of the selected set, at points outside it.
    limit
        Score above which a point is an outlier, None if there is no such limit.
    """

    outlier: BoolArray
    kept: BoolArray
    minimal: BoolArray
    score: FloatArray
    reason: tuple[str, ...]
    error: FloatArray
    limit: float | None = None

    @property
    def redundant(self) -> BoolArray:
        """Mask of points that are neither kept nor outliers."""
        return ~self.outlier & ~self.kept

    @property
    def compression(self) -> float:
        """Points before over points after."""
        return len(self.kept) / max(1, int(self.kept.sum()))


def select(data: ModelPoints, settings: SelectionSettings | None = None) -> Selection:
    """Select the points of a model.

    The result does not depend on the order of the points: they are sorted first, so that not
    even rounding depends on it.

    Parameters
    ----------
    data
        The points; with their segments, many more outliers are found.
    settings
        See `SelectionSettings`.

    Raises
    ------
    InputError
        The points have other inputs than speed and force, or velocity and force.

    Notes
    -----
    O(n^3): under a second for 500 points, some ten seconds for 2000.
    """
    settings = settings or SelectionSettings()
    n = len(data)
    order = data.canonical()
    sorted_data = data.subset(order)
    found = find_outliers(sorted_data, settings.false_alarms)
    outlier = np.zeros(n, dtype=np.bool_) if found is None else found.outlier
    good = np.flatnonzero(~outlier)
    kept, minimal = ~outlier, np.zeros(n, dtype=np.bool_)
    error = np.zeros(n)
    if settings.tau > 0 or settings.largest is not None:
        thin = condense(sorted_data.subset(good), settings.tau, settings.largest)
        kept[good], minimal[good], error[good] = thin.kept, thin.minimal, thin.error
    score = np.zeros(n) if found is None else found.score
    words = [""] * n if found is None else reasons(found)
    back = np.argsort(order)
    return Selection(
        outlier=outlier[back],
        kept=kept[back],
        minimal=minimal[back],
        score=score[back],
        reason=tuple(words[i] for i in back),
        error=error[back],
        limit=None if found is None else found.limit,
    )


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
    tau, largest
        As in `SelectionSettings`; errors are those against the consensus, at any point's place.

    Notes
    -----
    O(n^3) for the consensus, and one triangulation of the kept points for each added point.
    """
    n = len(data)
    minimal = np.zeros(n, dtype=np.bool_)
    minimal[hull_of(data.points)] = True
    if minimal.all() or n < 3:
        return Condensed(minimal, np.ones(n, dtype=np.bool_), np.zeros(n))
    agreed = np.exp(0.5 * Consensus(data).smoothed())
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
