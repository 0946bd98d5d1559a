"""Level of each cell of strokes as observed in its blocks, and how far each moment is trusted.

A row (`mmt.texture.field.cells`) differs from its cell's level by the scatter of its blocks and by
that of its moment (the patch of the surface under the tool, the grip of the hand). Both variances
are estimated from the blocks, with a prior of a few degrees of freedom at those of a homogeneous
surface.

A row may also be an outlier: a knock, a slip, hum, a smooth patch. So its error has the heavy tail
of a contaminated normal distribution (Tukey, "A survey of sampling from contaminated
distributions", 1960): with the probability `STRAY_SHARE` an error of standard deviation
`STRAY_DEVIATION` is added. The probability that a row is an outlier follows from its prediction by
all other rows, through the prior of `mmt.texture.field.covariance`: the posterior of its cell
without the row itself, in closed form (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, section 5.4.2), under the setting of the prior that predicts `CHOOSING` cells best.
The remaining probability is the trust in the row, a factor on its precision. Trust and predictions
depend on each other and are computed in turn, `ROUNDS` times. A region that is silent repeatedly
predicts its own silence, and is trusted.

Cost: O(ROUNDS c^3) for c cells, and O(k^3) per setting to choose the setting by k cells.
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
50. Estimates from 30 s on HaTT models are 0.08 to 0.09 in the mean, with either hand and with or
without noise; four in five are between 0.06 and 0.12."""

MOMENT_VARIANCE: Final = 0.01
"""Least variance between moments, nepers^2: no surface and no hand is the same everywhere."""

STRAY_SHARE: Final = 0.02
"""Prior probability that a row is an outlier."""

STRAY_DEVIATION: Final = 3.0
"""Standard deviation of an outlier's error, nepers: 13 dB."""

ROUNDS: Final = 3

CHOOSING: Final = 48
"""Largest number of cells, evenly chosen, by which settings of the prior are compared. The cost is
cubic, and more cells sharpen the weights more than the prior justifies: of 400 sessions of 30 s on
HaTT models 354 meet the stop criterion with 48 cells, 331 with all, at .85 and .86 right."""

_PRIOR_DEGREES: Final = 6.0
_MEDIAN: Final = 0.9
"""Median of a variance estimated from the four to nine blocks of a row, over the true one."""

_LARGEST_VARIANCE: Final = 1.0  # nepers^2; what varies by more is no steady texture
_LEAST_PRECISION: Final = 1e-3
_LEAST_BELIEVED: Final = 1e-9  # so low that even a row 200 dB off counts for nothing


class Observations(NamedTuple):
    """Observed log level, minus the prior mean, in c cells of strokes.

    ``level`` (c,): precision-weighted mean of the rows' log powers, with `cells.FELT_POWER`
    included. ``variance`` (c,): variance of its error. ``smoothed`` (c,): level as predicted from
    all cells together. ``block``, ``moment``: variances between the blocks of a moment, and
    between moments.
    """

    level: FloatArray
    variance: FloatArray
    smoothed: FloatArray
    block: float
    moment: float


class Choice(NamedTuple):
    """Cells by which settings of the prior are compared: `CHOOSING` of them, or all.

    Holds their indices (k,), and their prior covariance under each setting, (s, k, k).
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
    """Return the observed level of each cell from its rows, at least one in all.

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
    # the log of a mean power is, on average, half its variance below that of the expected power
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
    bias = 0.5 * moment  # likewise for the mean of logarithms over moments
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
    """Return the smoothed level (s, c), and the error of each row's prediction by the others.

    The error comes with its variance if the row is no outlier, both (s, r).
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
    """Write the results of `left_out`; return whether every prior is positive definite."""
    count = priors.shape[1]
    precision, mean, own = np.zeros(count), np.zeros(count), np.empty(len(cell))
    for row in range(len(cell)):
        own[row] = trust[row] / scatter[row]
        precision[cell[row]] += own[row]
        mean[cell[row]] += own[row] * level[row]
    total = summed = 0.0
    for c in range(count):
        total += mean[c]
        summed += precision[c]
    errors, rest = np.empty(count), np.empty(count)
    for c in range(count):
        mean[c] /= precision[c]
        errors[c], rest[c] = 1.0 / precision[c], mean[c] - total / summed
    gains, left = np.empty((len(priors), count)), np.empty((len(priors), count))
    if not condition(priors, errors, rest, True, np.empty(len(priors)), gains, left):
        return False
    for s in range(len(priors)):
        for c in range(count):
            smoothed[s, c] = mean[c] - gains[s, c] / precision[c]
        for row in range(len(cell)):
            c = cell[row]
            known = errors[c] - left[s, c] / precision[c] ** 2
            variance = 1.0 / max(1.0 / known - own[row], _LEAST_PRECISION)
            predicted = variance * (smoothed[s, c] / known - own[row] * level[row])
            off[s, row], usual[s, row] = level[row] - predicted, variance + scatter[row]
    return True


def _likeliest(choice: Choice, cell: IntArray, level: FloatArray, scatter: FloatArray) -> int:
    """Return the index of the setting that predicts the rows of the chosen cells best."""
    rows = np.isin(cell, choice.cells)
    part = np.searchsorted(choice.cells, cell[rows])
    trust = np.ones(len(part))
    _, off, usual = left_out(choice.priors, part, level[rows], scatter[rows], trust)
    return int(_log_density(off, usual).sum(axis=1).argmax())


def _believed(off: FloatArray, usual: FloatArray) -> FloatArray:
    """Return the probability that each row is no outlier, (r,)."""
    right = np.exp(_log_normal(off, usual) - _log_density(off, usual))
    return np.maximum(right, _LEAST_BELIEVED)


def _log_density(off: FloatArray, usual: FloatArray) -> FloatArray:
    """Return the log probability density of rows, up to a constant, (r,)."""
    stray = np.log(STRAY_SHARE) + _log_normal(off, usual + STRAY_DEVIATION**2)
    return np.asarray(np.logaddexp(_log_normal(off, usual), stray))


def _log_normal(off: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(-0.5 * (np.square(off) / variance + np.log(variance)))
