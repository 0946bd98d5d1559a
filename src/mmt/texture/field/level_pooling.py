"""Samples of the level that lie close together, as one: its power known as well as all of them.

Two samples at one stroke say as much as one of their weighted mean whose variance is that of
the mean, exactly. Samples that lie a little apart are pooled only where there are too many for
an update to solve.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.field.level_covariance import Features

_HEADINGS: Final = 2.0
"""Weight of a radian of heading beside a neper of speed or force."""

_COARSER: Final = 1.25


class LevelSamples(NamedTuple):
    """Features, logarithm of the power (n,), free of bias, and its variance (n,)."""

    at: Features
    logarithm: FloatArray
    variance: FloatArray


def pooled(samples: LevelSamples, largest: int) -> LevelSamples:
    """Return at most so many samples; those of a cell become their mean weighted by precision.

    The cells are squares in ln(speed) and ln(force), and heading, as small as possible.
    A sample's distance from the usual power law is averaged, not its level, so that nothing of
    the law is lost by pooling.
    """
    width = 0.05
    while len(samples.logarithm) > largest:
        samples = _by_cells(samples, width)
        width *= _COARSER
    return samples


def _by_cells(samples: LevelSamples, width: float) -> LevelSamples:
    at = samples.at
    places = np.column_stack([at.speed, at.force, _HEADINGS * at.heading]) / width
    _, cell = np.unique(np.floor(places), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    precision = 1.0 / samples.variance
    total = np.bincount(cell, precision)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(cell, precision * values) / total)

    middle = Features(mean(at.speed), mean(at.force), mean(at.heading))
    level = mean(samples.logarithm - at.law) + middle.law
    return LevelSamples(middle, level, 1.0 / total)
