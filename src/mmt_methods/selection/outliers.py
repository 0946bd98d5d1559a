"""Detection of outliers by predictions from all other points, independent of point order.

A knock adds vibration to a segment. Two likelihood ratios say how much likelier a point is with an
added signal than without:

- of the *filter*: the excess of its log spectrum over the consensus, in the level and at each
  frequency of the shape, squared and divided by the variance of the prediction.
- of the segment's *samples*, if there are any: the likeliest damped tone in them
  (`mmt_methods.selection.transients`).

The score is twice the sum of their logarithms. Few surfaces are as smooth, stationary and normally
distributed as the model, so no limit is assumed for the scores of good points. The limit comes from
the surface's own scores (`limit_of`).

Knocks also spoil predictions: they hide each other, and make their neighbours look like outliers.
So the search begins with the lowest 70 % of all scores, as least trimmed squares do (Rousseeuw
1984). These points predict all points. Then the points that are not above the limit predict all
points, and so on until nothing changes.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.errors import InputError
from mmt_methods.selection.consensus import Consensus
from mmt_methods.selection.points import ModelPoints
from mmt_methods.selection.transients import tone_evidence, whitening

FALSE_ALARMS: Final = 0.01
"""Approximate share of good points that are taken for outliers."""

LARGEST_RATE: Final = 0.2
"""Largest share allowed, since the quantiles that give the limit must be below it."""

MOST: Final = 0.3
"""Largest share of outliers: with more, good points cannot be told from bad ones."""

_ROUNDS: Final = 8  # two or three mostly suffice, but the search may never settle
_CENTRAL: Final = (0.5, 0.75)  # quantiles between which the limit's exponential is fitted
_LEAST_SCALE: Final = 2.0  # of the exponential
_WORDS: Final = (
    "it is louder than strokes like it",
    "its spectrum has more than that of strokes like it",
    "something struck rings in it",
)


class Outliers(NamedTuple):
    """Result of a search among n points.

    ``outlier`` (n,); ``score`` (n,), and ``limit``, above which a point is an outlier; ``parts``
    (n, kinds), the summands of the score: level, shape and, with segments, tone.
    """

    outlier: BoolArray
    score: FloatArray
    limit: float
    parts: FloatArray


def find_outliers(data: ModelPoints, false_alarms: float = FALSE_ALARMS) -> Outliers | None:
    """Return the points that contradict the others, or None if there are too few points.

    Parameters
    ----------
    data
        The points, of two or three inputs.
    false_alarms
        Share of the good points that may be taken for outliers.

    Raises
    ------
    InputError
        The points have other inputs than speed and force, or velocity and force.

    Notes
    -----
    O(n^3), and O(samples order), in each of a handful of rounds. The rounds end once the outliers
    are those of an earlier round.
    """
    n, dimensions = data.points.shape
    if dimensions not in (2, 3) or (data.points[:, 2 * (dimensions > 2) :] < 0.0).any():
        raise InputError(
            "outliers are found over speed and force, or two velocities and force: two or three "
            "inputs, speed and force not negative"
        )
    if n < 2 * (dimensions + 1):  # twice those that determine a plane
        return None
    consensus = Consensus(data)
    score = _evidence(data, consensus, np.ones(n, dtype=np.bool_)).sum(axis=1)
    outlier = score > np.quantile(score, 1.0 - MOST)
    sets: list[BoolArray] = []
    while len(sets) < _ROUNDS:
        sets.append(outlier)
        parts = _evidence(data, consensus, ~outlier)
        score = parts.sum(axis=1)
        limit, outlier = _above(score, false_alarms)
        if any((outlier == earlier).all() for earlier in sets):
            break
    return Outliers(outlier, score, limit, parts)


def limit_of(scores: FloatArray, false_alarms: float) -> float:
    """Return the score that good points exceed at a given rate.

    The upper half of the scores is assumed to fall exponentially, as likelihood ratios do. The
    scale is the maximum likelihood estimate from the scores between the median and the 75 %
    quantile, so that it does not depend on the tail itself. It is at least 2, the scale of twice a
    log likelihood ratio (Wilks 1938). Since the scale is known from a quarter of the points only,
    the tail is that of a ratio of exponential variables (Lomax), and the limit is wider for few
    points.

    Parameters
    ----------
    scores
        Scores of the points that stay, shape (n,). The missing scores above the limit are accounted
        for.
    false_alarms
        Above 0, to `LARGEST_RATE`.
    """
    middle, upper = (share / (1.0 - false_alarms) for share in _CENTRAL)
    median, top = np.quantile(scores, (middle, upper))
    within = max(1.0, (upper - middle) * len(scores))
    scale = max((np.clip(scores, median, top) - median).sum() / within, _LEAST_SCALE)
    tail = np.expm1(np.log((1.0 - _CENTRAL[0]) / false_alarms) / within)
    return float(median + scale * within * tail)


def _evidence(data: ModelPoints, consensus: Consensus, present: BoolArray) -> FloatArray:
    """Return the parts of the score, (n, 2), or (n, 3) with segments; `present` (n,) predict."""
    order = data.lsf.shape[1]
    level, shape = consensus.predict_from(present)
    louder = np.maximum(consensus.level - level.mean, 0.0)[:, 0]
    more = np.maximum(consensus.shape - shape.mean, 0.0)
    parts = [
        np.square(louder) / level.variance,
        order * np.square(more).mean(axis=1) / shape.variance,
    ]
    if data.segments is not None:
        filters = whitening(np.exp(level.mean + shape.mean), order)
        parts.append(2.0 * tone_evidence(data.segments, filters, level.variance, data.rate_hz))
    return np.column_stack(parts)


def _above(score: FloatArray, false_alarms: float) -> tuple[float, BoolArray]:
    """Return the limit, computed from the scores below it, and the mask of points above it.

    The first limit comes from the lowest scores, as many as cannot be outliers, so that knocks do
    not hide each other.
    """
    most = float(np.quantile(score, 1.0 - MOST))
    found = score > most
    for _ in range(_ROUNDS):
        limit = max(limit_of(score[~found], false_alarms), most)
        before, found = found, score > limit
        if (found == before).all():
            break
    return limit, found


def reasons(outliers: Outliers) -> list[str]:
    """Return for each outlier a sentence with the strongest evidence, "" for good points."""
    over = outliers.parts - np.median(outliers.parts[~outliers.outlier], axis=0)
    result = []
    for parts, score, bad in zip(over, outliers.score, outliers.outlier, strict=True):
        strongest = int(np.argmax(parts))
        words = f"{_WORDS[strongest]} (score {score:.1f}, limit {outliers.limit:.1f})"
        result.append(words if bad else "")
    return result
