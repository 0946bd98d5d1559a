"""Line spectral frequencies of a model's samples, smoothed to remove the scatter of their fits.

The filter of each segment has an error that shrinks with its length, and neighbours are similar:
repeated strokes in one region determine its filter together. Every
frequency of the common order is estimated as a Gaussian process over the plane, or over velocity
and force: a linear part, and a departure with a Matern covariance of smoothness 5/2 (Rasmussen
and Williams, Gaussian Processes for Machine Learning, 2006, section 2.2). A sample's noise is in
inverse proportion to its length. What is returned are the posterior means at the samples
themselves, for the interpolation to go on with, and at the points around them, where a
line that follows the speed goes on instead of standing still as a copy of the nearest sample's.

The lengths of the departures are shared, those of the largest evidence on a grid; each frequency's
scale is integrated out by its best value, and the ratio of noise to departure is one for all.
Over the velocity a stroke and its return count as nearly alike (`_RETURN`), since ridges are the
same from both sides.

A set of frequencies that would come closer than half as near to each other as they were fitted,
around the samples as the nearest one's were, is brought back towards these: convex combinations of
ordered frequencies are ordered.

Cost: five Cholesky factors, four of at most `_CHOICE` samples and one of at most `LARGEST`; where
there are more samples they are pooled by cells first.
"""

from itertools import product
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.interpolation.boundary import boundary
from mmt.texture.linear_algebra import cholesky, solve_backward, solve_forward
from mmt.texture.model.samples import TextureSamples

LARGEST: Final = 128
"""Nodes of the process; more samples are pooled."""

_CHOICE: Final = 64
_SCALES: Final = ((0.25, 1.0), (0.35, 1.4))  # of speed or velocity, of force
_NOISE: Final = 0.4  # deviation of a sample of mean weight, over that of the departure
_FREE: Final = 4.0
_RETURN: Final = 0.9
_TINY: Final = 1e-12


def smoothed(
    points: FloatArray, lsf: FloatArray, weights: FloatArray, around: FloatArray | None = None
) -> FloatArray:
    """Return the frequencies of samples without most of their scatter, shape (n + b, order).

    Parameters
    ----------
    points
        Normalised, shape (n, 2) or (n, 3).
    lsf
        Strictly ascending in (0, pi), shape (n, order).
    weights
        Precision of each sample, such as its length, positive, shape (n,).
    around
        Further points to which the process is continued, shape (b, d), none by default.
    """
    asked, fitted = points, lsf
    if around is not None:
        asked = np.vstack([points, around])
        fitted = np.vstack([lsf, lsf[cKDTree(points).query(around)[1]]])
    nodes, values, known = _pooled(points, lsf, weights)
    noise = _NOISE**2 * known.mean() / known
    middle = (known @ values) / known.sum()
    values = values - middle
    chosen = np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), _CHOICE)).round().astype(int))
    scales = _best_scales(nodes[chosen], values[chosen], noise[chosen])
    factor, whitened = _whitened(_Between(nodes, nodes).covariance(*scales), values, noise)
    gains = solve_backward(factor, whitened)
    result = _Between(asked, nodes).covariance(*scales) @ gains.T + middle
    return _kept_apart(result, fitted)


def smoothed_shapes(samples: TextureSamples) -> FloatArray:
    """Return the smoothed frequencies of a model's samples and of its boundary, (n + b, order).

    Samples are weighted by their lengths; where these are not known all count alike.
    """
    weights = np.ones(len(samples)) if samples.counts is None else samples.counts
    around = boundary(samples.space.dimensions).points
    return smoothed(samples.points, samples.lsf, weights, around)


class _Between:
    """What covariances between two sets of points, (k, d) and (l, d), are computed from."""

    def __init__(self, a: FloatArray, b: FloatArray) -> None:
        self._linear = _FREE * (1.0 + (a - 0.5) @ (b - 0.5).T)
        self._force: FloatArray = np.abs(np.subtract.outer(a[:, -1], b[:, -1]))
        self._back: FloatArray | None = None
        if a.shape[1] == 2:
            self._away: FloatArray = np.abs(np.subtract.outer(a[:, 0], b[:, 0]))
            return
        speeds = np.hypot(a[:, 0], a[:, 1]) - 0.5, np.hypot(b[:, 0], b[:, 1]) - 0.5
        self._linear += _FREE * np.multiply.outer(*speeds)
        self._away, self._back = (
            np.sqrt(
                np.square(np.subtract.outer(a[:, 0], side * b[:, 0]))
                + np.square(np.subtract.outer(a[:, 1], side * b[:, 1]))
            )
            for side in (1.0, -1.0)
        )

    def covariance(self, along: float, force: float) -> FloatArray:
        """Return the prior covariance (k, l) for two lengths, in units of the departure's."""
        departure = _matern(self._away, along)
        if self._back is not None:
            departure += _RETURN * _matern(self._back, along)
        return np.asarray(self._linear + departure * _matern(self._force, force))


def _whitened(
    covariance: FloatArray, values: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the factor of the covariance of samples, and their whitened values (order, k)."""
    covariance[np.diag_indices_from(covariance)] += noise
    factor = cholesky(covariance)
    return factor, solve_forward(factor, values.T)


def _best_scales(points: FloatArray, values: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Return the lengths of the largest evidence."""
    between = _Between(points, points)

    def cost(scales: tuple[float, float]) -> float:
        factor, whitened = _whitened(between.covariance(*scales), values, noise)
        squares = np.log(np.square(whitened).sum(axis=1) + _TINY)
        volume = len(squares) * np.log(np.diagonal(factor)).sum()
        return float(0.5 * len(points) * squares.sum() + volume)

    return min(product(*_SCALES), key=cost)


def _pooled(
    points: FloatArray, lsf: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return at most `LARGEST` nodes with their frequencies and weights; means by weight."""
    width = 0.02
    while len(points) > LARGEST:
        _, cell = np.unique(np.floor(points / width), axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        shares = weights / np.asarray(np.bincount(cell, weights))[cell]
        points, lsf = (_sums(shares[:, None] * values, cell) for values in (points, lsf))
        weights = _sums(weights, cell)
        width *= 1.25
    return points, lsf, weights


def _sums(values: FloatArray, cell: IntArray) -> FloatArray:
    """Return the sums of rows (n, ...) by cell."""
    sums = np.zeros((int(cell.max()) + 1, *values.shape[1:]))
    np.add.at(sums, cell, values)
    return sums


def _kept_apart(result: FloatArray, fitted: FloatArray) -> FloatArray:
    """Return sets whose least gap is half that of the fitted ones or more."""
    least = 0.5 * _gaps(fitted)
    kept = fitted.copy()
    for share in (0.25, 0.5, 1.0):
        mixed = fitted + share * (result - fitted)
        valid = _gaps(mixed) >= least
        kept[valid] = mixed[valid]
    return kept


def _gaps(lsf: FloatArray) -> FloatArray:
    return np.asarray(np.diff(lsf, prepend=0.0, append=np.pi, axis=1).min(axis=1))


def _matern(distance: FloatArray, length: float) -> FloatArray:
    """Return the Matern covariance of smoothness 5/2."""
    r = (np.sqrt(5.0) / length) * distance
    return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))
