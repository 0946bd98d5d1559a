"""Sample selection independent of point order: outliers first, then redundant points."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.bounds import check_fields
from mmt_methods.selection.condensed import TAU, condense
from mmt_methods.selection.outliers import FALSE_ALARMS, LARGEST_RATE, find_outliers, reasons
from mmt_methods.selection.points import ModelPoints


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
