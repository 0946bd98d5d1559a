"""What the blocks of each cell of strokes say of its level, and which moments are not believed.

A row (`mmt.texture.field.cells`) is off its cell's level by the scatter of its blocks and by that
of its moment: the patch of the surface that was under the tool, the grip of the hand. Both
variances are learned from the blocks themselves, drawn to those of a homogeneous surface by a few
degrees of freedom.

A row may also be wrong altogether: a knock, a slip, hum, a smooth patch. So its error has a heavy
tail, that of a contaminated normal distribution (Tukey, "A survey of sampling from contaminated
distributions", 1960): with the probability `STRAY_SHARE` it has the standard deviation
`STRAY_DEVIATION` besides. How probable that is follows from what all other rows, through the prior
of `mmt.texture.field.covariance`, predict of the row: the posterior of its cell without the row
itself, in closed form (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
section 5.4.2), under the setting of the prior that predicts `CHOOSING` cells best. The rest of the
probability is the trust in the row, a factor on its precision. Trust depends on predictions and
predictions on trust: both are found by turns, `ROUNDS` times. A region that is silent time and
again predicts its own silence, and is believed.

Cost: O(ROUNDS c^3) for c cells, and O(k^3) a setting for its choice by k cells.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.covariance import Coordinates, prior_covariance
from mmt.texture.linear_algebra import condition

BLOCK_VARIANCE: Final = 0.08
"""Variance of a block's log power, nepers^2, on a homogeneous surface: 25 independent samples of
50. What is learned of HaTT's models in 30 s is 0.08 to 0.09 in the mean, by either hand and with
noise or without, 0.06 to 0.12 of four in five."""

MOMENT_VARIANCE: Final = 0.01
"""Least variance between moments, nepers^2: no surface and no hand is the same everywhere."""

STRAY_SHARE: Final = 0.02
"""Probability that a row is wrong altogether, before anything is known of it."""

STRAY_DEVIATION: Final = 3.0
"""Standard deviation of its error then, nepers: 13 dB."""

ROUNDS: Final = 3

CHOOSING: Final = 48
"""Most cells by which settings of the prior are compared, an even choice of all. The cost is their
cube, and more cells sharpen the weights beyond what the prior is worth: of 400 sessions of 30 s
on HaTT models 354 meet the stop criterion by 48 cells, 331 by all, at .85 and .86 right."""

_PRIOR_DEGREES: Final = 6.0
_MEDIAN: Final = 0.9
"""Median of a variance estimated from the four to nine blocks of a row, over the variance."""

_LARGEST_VARIANCE: Final = 1.0  # nepers^2; what varies by more is no steady texture
_LEAST_PRECISION: Final = 1e-3
_LEAST_BELIEVED: Final = 1e-9  # that of a row 200 dB off counts for nothing


class Observations(NamedTuple):
    """What is observed of the log level, less the prior mean, in c cells of strokes.

    ``level``, ``variance`` (c,): the mean of the rows' logarithms of powers plus
    `cells.FELT_POWER`, by their precision, and the variance of its error; ``smoothed`` (c,): the
    same as predicted from all cells together. ``block``, ``moment``: variances between the blocks
    of a moment, and between moments.
    """

    level: FloatArray
    variance: FloatArray
    smoothed: FloatArray
    block: float
    moment: float


class Choice(NamedTuple):
    """The cells by which settings of the prior are compared: `CHOOSING` or all.

    Their indices (k,), and their prior covariance under each setting, (s, k, k).
    """

    cells: IntArray
    priors: FloatArray


def choose(cells: FieldCells, every: FloatArray) -> Choice:
    """Return an even choice of cells; `every` are the settings (s, h)."""
    count = len(cells.centres.u)
    chosen = np.linspace(0, count - 1, min(count, CHOOSING)).round().astype(np.int64)
    at = Coordinates(*(axis[chosen] for axis in cells.centres))
    return Choice(chosen, prior_covariance(at, at, every))


def observe(cells: FieldCells, every: FloatArray, choice: Choice) -> Observations:
    """Return what the rows, at least one, say of each cell.

    Parameters
    ----------
    cells
        The rows.
    every
        Settings of the prior, the rows of `mmt.texture.field.covariance.settings`.
    choice
        Cells by which the likeliest setting is chosen.
    """
    cell, (count, power, _, _) = cells.cell_of_row, cells.sums.T
    block = _block_variance(cells)
    scatter = block / count
    # the logarithm of a mean lies below that of what is expected, by half its variance
    level = np.log(power / count) + 0.5 * scatter - cells.centres.law[cell]
    believed = np.ones(len(level))
    moment = _moment_variance(cell, level, scatter, believed)
    setting = every[_likeliest(choice, cell, level, moment + scatter)]
    prior = prior_covariance(cells.centres, cells.centres, setting[np.newaxis])
    found = left_out(prior, cell, level, moment + scatter, believed)
    smoothed, off, usual = (of_one[0] for of_one in found)
    for _ in range(ROUNDS):
        believed = _believed(off, usual)
        moment = _moment_variance(cell, level, scatter, believed)
        trust = np.maximum(believed, (moment + scatter) / STRAY_DEVIATION**2)
        found = left_out(prior, cell, level, moment + scatter, trust)
        smoothed, off, usual = (of_one[0] for of_one in found)
    precision, mean = _combined(cell, trust / (moment + scatter), level)
    bias = 0.5 * moment  # and a mean of logarithms, of moments, below that of the mean
    return Observations(mean + bias, 1.0 / precision, smoothed + bias, block, moment)


def _combined(
    cell: IntArray, precision: FloatArray, level: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the precision and the mean of the rows of each cell, (c,)."""
    total = np.asarray(np.bincount(cell, precision), np.float64)
    return total, np.asarray(np.bincount(cell, precision * level) / total)


def _block_variance(cells: FieldCells) -> float:
    """Return the variance between the blocks of a moment: the median of the rows'."""
    count, _, first, second = cells.sums[cells.sums[:, 0] >= 2.0].T
    each = np.maximum(second - np.square(first) / count, 0.0) / (count - 1.0)
    prior = np.full(int(_PRIOR_DEGREES), _MEDIAN * BLOCK_VARIANCE)
    return min(float(np.median(np.concatenate([each, prior])) / _MEDIAN), _LARGEST_VARIANCE)


def _moment_variance(
    cell: IntArray, level: FloatArray, scatter: FloatArray, trust: FloatArray
) -> float:
    """Return the variance between moments beyond that of their blocks, of trusted rows."""
    weight, mean = _combined(cell, trust, level)
    degrees = trust * (1.0 - trust / weight[cell])
    excess = trust @ np.square(level - mean[cell]) - degrees @ scatter
    total = degrees.sum() + _PRIOR_DEGREES
    found = float((excess + _PRIOR_DEGREES * MOMENT_VARIANCE) / total)
    return min(max(found, MOMENT_VARIANCE), _LARGEST_VARIANCE)


def left_out(
    priors: FloatArray, cell: IntArray, level: FloatArray, scatter: FloatArray, trust: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the smoothed level (s, c), and how far each row is off what the others predict.

    The latter with its variance if nothing is wrong with the row, both (s, r).
    """
    smoothed = np.empty(priors.shape[:2])
    off, usual = np.empty((2, len(priors), len(cell)))
    if not _leave_out(priors, cell, level, scatter, trust, smoothed, off, usual):
        raise np.linalg.LinAlgError("the prior is not positive definite")
    return smoothed, off, usual


@kernel("b1(f8[:, :, ::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _leave_out(
    priors: FloatArray,
    cell: IntArray,
    level: FloatArray,
    scatter: FloatArray,
    trust: FloatArray,
    smoothed: FloatArray,
    off: FloatArray,
    usual: FloatArray,
) -> bool:
    """Set the results of `left_out`; returns whether every prior is positive definite."""
    count, own = priors.shape[1], trust / scatter
    precision, mean = np.zeros(count), np.zeros(count)
    for row in range(len(cell)):
        precision[cell[row]] += own[row]
        mean[cell[row]] += own[row] * level[row]
    middle = mean.sum() / precision.sum()
    mean /= precision
    gains, left = np.empty((len(priors), count)), np.empty((len(priors), count))
    evidence = np.empty(len(priors))
    if not condition(priors, 1.0 / precision, mean - middle, True, evidence, gains, left):
        return False
    for s in range(len(priors)):
        smoothed[s] = mean - gains[s] / precision
        known = 1.0 / precision - left[s] / precision**2
        for row in range(len(cell)):
            c = cell[row]
            variance = 1.0 / max(1.0 / known[c] - own[row], _LEAST_PRECISION)
            predicted = variance * (smoothed[s, c] / known[c] - own[row] * level[row])
            off[s, row], usual[s, row] = level[row] - predicted, variance + scatter[row]
    return True


def _likeliest(choice: Choice, cell: IntArray, level: FloatArray, scatter: FloatArray) -> int:
    """Return which setting of the prior predicts the rows of the chosen cells best."""
    rows = np.isin(cell, choice.cells)
    part = np.searchsorted(choice.cells, cell[rows])
    trust = np.ones(len(part))
    _, off, usual = left_out(choice.priors, part, level[rows], scatter[rows], trust)
    return int(_log_density(off, usual).sum(axis=1).argmax())


def _believed(off: FloatArray, usual: FloatArray) -> FloatArray:
    """Return the probability that nothing is wrong with each row, (r,)."""
    right = np.exp(_log_normal(off, usual) - _log_density(off, usual))
    return np.maximum(right, _LEAST_BELIEVED)


def _log_density(off: FloatArray, usual: FloatArray) -> FloatArray:
    """Return the logarithm of the probability density of rows, but for a constant, (r,)."""
    stray = np.log(STRAY_SHARE) + _log_normal(off, usual + STRAY_DEVIATION**2)
    return np.asarray(np.logaddexp(_log_normal(off, usual), stray))


def _log_normal(off: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(-0.5 * (np.square(off) / variance + np.log(variance)))
