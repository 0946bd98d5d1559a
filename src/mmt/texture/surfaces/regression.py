"""Bayesian regression of a surface's blocks on their strokes.

Each component of the spectrum (`mmt.texture.surfaces.blocks`) is linear in u and v
(`mmt.texture.field.covariance`) plus a smooth departure: a Gaussian process with Matern covariances
of smoothness 3/2, in the reduced-rank form of Solin and Sarkka ("Hilbert space methods for
reduced-rank Gaussian process regression", Statistics and Computing 30, 2020), sines whose weights
have the process's spectral density as variance. If the heading counts, its first two harmonics are
added. The variance of blocks about the regression is learned too: it has an inverse gamma prior, so
that blocks are predicted by Student's t distribution. All is conjugate and in closed form (Bishop,
Pattern Recognition and Machine Learning, 2006, section 3.3).

The figures of the prior are the spread among the development half of HaTT's models, component by
component, rounded up.
"""

from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaln

from mmt.core.arrays import FloatArray

MEANS: Final = np.array([-2.6, 1.7, -0.3, 0.15, 0.0, 0.0])
"""Prior means of the components, nepers of power in (m/s2)^2."""

_CONSTANTS: Final = np.array([3.0, 0.7, 0.5, 0.25, 0.2, 0.15])
"""Standard deviations of the components from surface to surface."""

_SIZES: Final = np.array([1.0, 0.5, 0.3, 0.2, 0.15, 0.12])
"""Size of each component's changes with the stroke, over that of the level's."""

_SCATTER: Final = 1.5 * np.array([0.05, 0.05, 0.045, 0.04, 0.032, 0.025])
"""Expected variance of blocks, nepers^2: one and a half times that of white noise (measured)."""

_PRIOR_BLOCKS: Final = 20.0
"""Number of blocks that the expected variance counts as."""

_SLOPE, _DEPARTURE, _HEADING = 0.5, 0.6, 0.4
"""Standard deviations for a component of size 1: of slopes, of the departure, of a harmonic."""

_LENGTHS: Final = (0.6, 0.8)
"""Lengths of the departure in u and v."""

_CENTRE, _HALF_WIDTH = -1.1, 2.6
"""Square of u and v at whose edges the sines vanish."""

_WAVES: Final = np.pi * np.arange(1, 7) / (2.0 * _HALF_WIDTH)
"""Wave numbers of the sines on each axis."""

LARGEST: Final = 4.8
"""Bound on the innovation of a block, in standard deviations (root of the sum of squares over the
components). A larger one, as of a knock, counts and is learned as this large."""


def features(strokes: FloatArray, *, directed: bool) -> FloatArray:
    """Return the regressors (n, d) of strokes (n, 3): u, v and heading.

    ``directed``: whether the heading counts.
    """
    u, v, heading = strokes.T
    place = np.clip(strokes[:, :2] - _CENTRE, -_HALF_WIDTH, _HALF_WIDTH) + _HALF_WIDTH
    sines = np.sin(place[:, :, None] * _WAVES) / np.sqrt(_HALF_WIDTH)
    departure = (sines[:, 0, :, None] * sines[:, 1, None, :]).reshape(len(strokes), -1)
    columns = [np.ones(len(strokes)), u, v]
    if directed:
        columns += [np.cos(heading), np.sin(heading), np.cos(2 * heading), np.sin(2 * heading)]
    return np.column_stack([*columns, departure])


@cache
def _prior_precision(*, directed: bool) -> FloatArray:
    """Return the prior precisions of the weights times the variance of blocks, (components, d)."""
    rates = np.sqrt(3.0) / np.array(_LENGTHS)[:, None]
    densities = 4.0 * rates**3 / np.square(rates**2 + _WAVES**2)
    departure = _DEPARTURE * np.sqrt(np.outer(*densities)).ravel()
    stroke = [_SLOPE, _SLOPE, *([_HEADING] * 4 if directed else []), *departure]
    deviations = np.column_stack([_CONSTANTS, np.outer(_SIZES, stroke)])
    return np.asarray(_SCATTER[:, None] / np.square(deviations))


class Innovations(NamedTuple):
    """Innovations of n blocks, bounded by `LARGEST`.

    ``deviation``: standard deviation of each block's prediction, over that of the scatter;
    ``innovation``: prediction error over ``deviation``; ``values``: the components that have these
    innovations; all (`COMPONENTS`, n). ``shape`` (n,) and ``rate`` (`COMPONENTS`, n): parameters of
    the inverse gamma distribution of the variance before each block.
    """

    deviation: FloatArray
    innovation: FloatArray
    values: FloatArray
    shape: FloatArray
    rate: FloatArray


class SurfaceRegression:
    """Regression of the components of one surface's blocks; without blocks it is the prior.

    Parameters
    ----------
    directed
        Whether the heading counts.
    """

    def __init__(self, *, directed: bool) -> None:
        precision = _prior_precision(directed=directed)
        self._precision = precision[:, :, None] * np.eye(precision.shape[1])
        self.covariance = np.eye(precision.shape[1]) / precision[:, :, None]
        self._weighted = np.zeros_like(precision)
        self.shape = 0.5 * _PRIOR_BLOCKS
        self.rate: FloatArray = np.asarray(self.shape * _SCATTER)

    def log_densities(self, rows: FloatArray, values: FloatArray) -> FloatArray:
        """Return the log density (n,) of n blocks, given learned blocks and those before each.

        Parameters
        ----------
        rows, values
            `features` (n, d) and components less `MEANS` (n, `COMPONENTS`) of the blocks.
        """
        found = self.innovations(rows, values)
        shape, rate = found.shape, found.rate
        densities = gammaln(shape + 0.5) - gammaln(shape) - 0.5 * np.log(2.0 * np.pi * rate)
        squares = np.square(found.innovation) / rate
        densities -= np.log(found.deviation) + (shape + 0.5) * np.log1p(0.5 * squares)
        return np.asarray(densities.sum(axis=0))

    def learn(self, rows: FloatArray, values: FloatArray) -> None:
        """Learn n blocks, n > 0, in their order; parameters as of `log_densities`."""
        found = self.innovations(rows, values)
        self._precision = self._precision + rows.T @ rows
        self.covariance = np.asarray(np.linalg.inv(self._precision), dtype=np.float64)
        self._weighted = self._weighted + found.values @ rows
        self.shape += 0.5 * len(rows)
        self.rate = np.asarray(self.rate + 0.5 * np.square(found.innovation).sum(axis=1))

    def innovations(self, rows: FloatArray, values: FloatArray) -> Innovations:
        """Return the innovations of n blocks, given learned blocks and those before each."""
        mean = np.einsum("cde,ce,nd->cn", self.covariance, self._weighted, rows)
        factor = np.linalg.cholesky(rows @ self.covariance @ rows.T + np.eye(len(rows)))
        deviation = np.diagonal(factor, axis1=1, axis2=2)
        shape: FloatArray = np.asarray(self.shape + 0.5 * np.arange(len(rows)))
        innovation, rate = np.zeros_like(mean), np.zeros_like(mean)
        now = self.rate
        for n, rest in enumerate((values.T - mean).T):  # forward substitution, bounded at each step
            told = (factor[:, n, :n] * innovation[:, :n]).sum(axis=1)
            new = (rest - told) / deviation[:, n]
            size = float(np.sqrt((np.square(new) * shape[n] / now).sum()))
            innovation[:, n] = new * (LARGEST / max(size, LARGEST))
            rate[:, n] = now
            now = now + 0.5 * np.square(innovation[:, n])
        tamed = mean + np.einsum("cnk,ck->cn", factor, innovation)
        return Innovations(deviation, innovation, tamed, shape, rate)
