"""What a segment's power is worth, told by the segments of similar strokes together.

A segment's effective length follows from the spectrum that is fitted to it (`effective_length`),
and scatters with it: where a texture is of narrow lines, a short segment shows them now broader
and now narrower than they are, and the powers of those that look broad are believed too much. How
much of a segment is independent is a property of the texture at that stroke. So it is averaged
over the segments with similar speed, along a similar line (a stroke and its return are alike),
weighted by their length. The force, which moves lines little, does not count.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.effective_sample_size import LEAST
from mmt.texture.field.level_covariance import features

LARGEST: Final = 200
"""Segments, evenly chosen among all, over which is averaged: the cost stays O(n)."""

_SPEED_WIDTH: Final = 0.5  # nepers
_LINE_WIDTH: Final = 0.3  # sine of the angle between two lines


def shared_effective(points: FloatArray, lengths: FloatArray, effective: FloatArray) -> FloatArray:
    """Return independent samples that each power is worth, shape (n,), from `LEAST` on.

    Parameters
    ----------
    points
        Normalised inputs of the segments, shape (n, 2) or (n, 3).
    lengths
        How many samples each has, shape (n,).
    effective
        What `effective_length.effective_samples` says of each alone, shape (n,).
    """
    count = len(effective)
    chosen = np.unique(np.linspace(0, count - 1, min(count, LARGEST)).round().astype(int))
    at = features(points)
    apart = np.square(np.subtract.outer(at.speed, at.speed[chosen]) / _SPEED_WIDTH)
    if points.shape[1] == 3:
        turn = np.sin(np.subtract.outer(at.heading, at.heading[chosen]))
        apart += np.square(turn / _LINE_WIDTH)
    apart -= apart.min(axis=1, keepdims=True)  # so that one of them counts, however far
    weights = np.exp(-0.5 * apart) * lengths[chosen]
    dependent = weights @ (lengths / effective)[chosen] / weights.sum(axis=1)
    return np.asarray(np.maximum(lengths / dependent, LEAST))
