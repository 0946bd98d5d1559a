"""Hyperparameters of `mmt.texture.field.level_process`, chosen by maximum a posteriori.

Samples of the level that lie close together are pooled first where there are too many: two
samples at one stroke are worth exactly one at their weighted mean, with the variance of that mean.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import minimize

from mmt.core.arrays import FloatArray
from mmt.texture.field.level_covariance import (
    NOISE,
    PLANAR,
    PRIOR,
    Departures,
    Features,
    covariance_and_slopes,
    departures,
)

_HEADINGS: Final = 2.0
"""Weight of a radian of heading beside a neper of speed or force."""

_COARSER: Final = 1.25


class LevelSamples(NamedTuple):
    """Samples of the level: features, bias-free logarithm of power (n,) and its variance (n,)."""

    at: Features
    logarithm: FloatArray
    variance: FloatArray


def pooled(samples: LevelSamples, largest: int) -> LevelSamples:
    """Return at most `largest` samples; those of a cell become their precision-weighted mean.

    The cells are squares in ln(speed) and ln(force), and heading, as small as possible.
    The residual from the usual power law is averaged, not the level, so that pooling keeps the
    law.
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


LARGEST_CHOICE: Final = 100
"""Samples, evenly chosen among all, that choose the hyperparameters."""

BOUND: Final = 3.0
"""Bound on every hyperparameter, in standard deviations of its prior."""

_SEARCH_STEPS: Final = 25
_JITTER: Final = 1e-10


def add_noise(total: FloatArray, variance: FloatArray, logarithms: FloatArray) -> FloatArray:
    """Add the samples' noise to their covariance; return it, shape (n,)."""
    noise = np.exp(2.0 * logarithms[NOISE]) * variance
    diagonal = np.einsum("ii->i", total)
    diagonal += noise + _JITTER * diagonal
    return np.asarray(noise)


def log_posterior(
    between: Departures, residuals: FloatArray, variance: FloatArray, logarithms: FloatArray
) -> tuple[float, FloatArray]:
    """Return the log posterior of the hyperparameters, up to a constant, and its gradient.

    Rasmussen and Williams, eq. 5.8 and 5.9, plus the logarithm of the prior.

    Parameters
    ----------
    between
        Distances among the samples.
    residuals, variance
        Logarithms of power without the usual law, and their variances, shape (n,).
    logarithms
        Logarithms of the hyperparameters, shape (4,) or (10,).
    """
    total, slopes = covariance_and_slopes(between, logarithms)
    noise = add_noise(total, variance, logarithms)
    factor = cholesky(total, lower=True, overwrite_a=True, check_finite=False)
    weights = cho_solve((factor, True), residuals, check_finite=False)
    inverse = cho_solve((factor, True), np.eye(len(residuals)), check_finite=False)
    gain = np.multiply.outer(weights, weights) - inverse
    slope = np.empty(len(logarithms))
    for number, matrix in slopes.items():
        slope[number] = 0.5 * np.einsum("ij,ij->", gain, matrix)
    slope[NOISE] = np.einsum("ii,i->", gain, noise)
    value = -0.5 * float(residuals @ weights) - float(np.log(np.einsum("ii->i", factor)).sum())
    middle, spread = PRIOR[: len(logarithms)].T
    off = (logarithms - middle) / spread
    return value - 0.5 * float(off @ off), slope - off / spread


def choose_hyperparameters(
    samples: LevelSamples,
    residuals: FloatArray,
    start: FloatArray | None = None,
    *,
    directed: bool,
) -> FloatArray:
    """Return the logarithms of the likeliest hyperparameters, shape (4,) or (10,).

    Parameters
    ----------
    samples, residuals
        The samples and their logarithms without the usual law; `LARGEST_CHOICE` of them count.
    start
        Where the search begins, None for the middle of the prior.
    directed
        Whether the heading counts.
    """
    middle, spread = PRIOR[: len(PRIOR) if directed else PLANAR].T
    count = len(residuals)
    chosen = np.unique(np.linspace(0, count - 1, min(count, LARGEST_CHOICE)).round().astype(int))
    at = Features(*(values[chosen] for values in samples.at))
    between = departures(at, at, directed=directed)

    def cost(logarithms: FloatArray) -> tuple[float, FloatArray]:
        found = log_posterior(between, residuals[chosen], samples.variance[chosen], logarithms)
        return -found[0], -found[1]

    result = minimize(
        cost,
        middle if start is None else start,
        jac=True,
        method="L-BFGS-B",
        bounds=np.column_stack([middle - BOUND * spread, middle + BOUND * spread]),
        options={"maxiter": _SEARCH_STEPS},
    )
    return np.asarray(result.x)
