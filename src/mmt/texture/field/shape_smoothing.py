"""Line spectral frequencies of a model's samples, smoothed to remove the scatter of their fits.

The filter of each segment has an error that shrinks with its length, and neighbours are similar:
repeated strokes in one region determine its filter together. Every frequency of the common order is
estimated as a Gaussian process over the plane, or over velocity and force: a linear part, and a
departure with a Matern covariance of smoothness 5/2 (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, section 2.2). A sample's noise is inversely proportional to its length. The
results are the posterior means at the samples, for the interpolation, and at the boundary points
around them: there, a line that follows the speed continues to do so, unlike a copy of the nearest
sample's line.

All frequencies share the lengths of the departure, and each has its own ratio of noise to
departure. Both have the largest evidence on a grid, with the scale at its best value: lines that
follow the speed are hardly smoothed, while resonances are. Over velocity, a stroke and its return
count as nearly alike (`_RETURN`), since ridges are the same from both sides.

If smoothing reduces the least gap of a set of frequencies to less than half that of the fitted set
(for a boundary point, the nearest sample's), the set is moved back towards the fitted one: convex
combinations of ordered frequencies are ordered.

Cost: five covariances are made tridiagonal, O(n^3), four of at most `_CHOICE` samples and one of at
most `LARGEST`; more samples are first pooled by cells. Then each noise takes O(n) for a frequency.
"""

from itertools import product
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.field.cells import distinct_rows
from mmt.texture.interpolation.vertices import boundary
from mmt.texture.linear_algebra import product as matrix_product
from mmt.texture.space import TextureSamples
from mmt.texture.tridiagonal import ShiftedSystems, shifted_systems

LARGEST: Final = 128
"""Largest number of nodes of the process; more samples are pooled."""

LEAST_SAMPLES: Final = 4
"""Least number of samples from which the noise is estimated."""

_CHOICE: Final = 64
_SCALES: Final = ((0.25, 1.0), (0.35, 1.4))  # of speed or velocity, of force
_NOISE: Final = np.geomspace(0.01, 3.0, 16)
_USUAL_NOISE: Final = (np.log(0.1), 1.2)  # mean and deviation of the logarithm
_FREE: Final = 4.0
_RETURN: Final = 0.9
_TINY: Final = 1e-12


def smoothed(
    points: FloatArray, lsf: FloatArray, weights: FloatArray, around: FloatArray
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
        Further points to which the process is continued, shape (b, d).
    """
    asked = np.vstack([points, around])
    fitted = np.vstack([lsf, lsf[cdist(around, points, "sqeuclidean").argmin(axis=1)]])
    if len(points) < LEAST_SAMPLES:
        return fitted.copy()
    nodes, values, known = _pooled(points, lsf, weights)
    known = known / known.mean()
    middle = (known @ values) / known.sum()
    values = values - middle
    chosen = np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), _CHOICE)).round().astype(int))
    scales, white = _best_scales(nodes[chosen], values[chosen], known[chosen])
    if len(chosen) < len(nodes):
        white = _whitened(_covariances(nodes, nodes, *scales)[0], values, known)
    noise = _costs(white).argmin(axis=0)
    gains = np.sqrt(known)[:, None] * white.solutions(np.square(_NOISE[noise]))
    result = matrix_product(_covariances(asked, nodes, *scales)[0], gains) + middle
    return _kept_apart(result, fitted)


def smoothed_shapes(samples: TextureSamples) -> FloatArray:
    """Return the smoothed frequencies of a model's samples and of its boundary, (n + b, order).

    Samples are weighted by their lengths, or equally if these are not known.
    """
    weights = np.ones(len(samples)) if samples.counts is None else samples.counts
    around = boundary(samples.space.dimensions)
    return smoothed(samples.points, samples.lsf, weights, around)


def _covariances(a: FloatArray, b: FloatArray, *scales: tuple[float, ...]) -> list[FloatArray]:
    """Return prior covariances (k, l) of points, in units of the departure's variance.

    There is one for each pair of scales, of speed or velocity and of force.
    """
    linear = _FREE * (1.0 + (a - 0.5) @ (b - 0.5).T)
    apart = np.abs(np.subtract.outer(a[:, -1], b[:, -1]))
    forces = [_matern(apart, scale) for scale in scales[1]]
    if a.shape[1] == 2:
        away = np.abs(np.subtract.outer(a[:, 0], b[:, 0]))
        along = [_matern(away, scale) for scale in scales[0]]
        return [linear + motion * force for motion, force in product(along, forces)]
    speeds = np.hypot(a[:, 0], a[:, 1]) - 0.5, np.hypot(b[:, 0], b[:, 1]) - 0.5
    linear += _FREE * np.multiply.outer(*speeds)
    away, back = (
        np.sqrt(
            np.square(np.subtract.outer(a[:, 0], side * b[:, 0]))
            + np.square(np.subtract.outer(a[:, 1], side * b[:, 1]))
        )
        for side in (1.0, -1.0)
    )
    along = [_matern(away, scale) + _RETURN * _matern(back, scale) for scale in scales[0]]
    return [linear + motion * force for motion, force in product(along, forces)]


def _whitened(covariance: FloatArray, values: FloatArray, weights: FloatArray) -> ShiftedSystems:
    """Return the systems of whitened nodes and frequencies (k, order); their noise is the shift."""
    roots = np.sqrt(weights)
    return shifted_systems(covariance * np.multiply.outer(roots, roots), roots[:, None] * values)


def _costs(white: ShiftedSystems) -> FloatArray:
    """Return minus the log evidence of each noise for each frequency, shape (16, order)."""
    squares, logarithms = white.squares(np.square(_NOISE))
    middle, spread = _USUAL_NOISE
    off = (np.log(_NOISE) - middle) / spread
    half = 0.5 * len(white.diagonal) * np.log(squares + _TINY)
    return np.asarray(half + (0.5 * logarithms + 0.5 * off * off)[:, None])


def _best_scales(
    points: FloatArray, values: FloatArray, weights: FloatArray
) -> tuple[tuple[tuple[float, ...], ...], ShiftedSystems]:
    covariances = _covariances(points, points, *_SCALES)
    every = [_whitened(covariance, values, weights) for covariance in covariances]
    best = int(np.argmin([_costs(white).min(axis=0).sum() for white in every]))
    speed, force = list(product(*_SCALES))[best]
    return ((speed,), (force,)), every[best]


def _pooled(
    points: FloatArray, lsf: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return at most `LARGEST` nodes with their frequencies and weights; means by weight."""
    width = 0.02
    while len(points) > LARGEST:
        _, cell = distinct_rows(np.floor(points / width).astype(np.int64))
        shares = weights / np.asarray(np.bincount(cell, weights))[cell]
        points, lsf = (_sums(shares[:, None] * values, cell) for values in (points, lsf))
        weights = _sums(weights, cell)
        width *= 1.25
    return points, lsf, weights


def _sums(values: FloatArray, cell: IntArray) -> FloatArray:
    """Return the sums of rows (n, ...) by cell."""
    columns = values.reshape(len(values), -1).T
    sums = np.array([np.bincount(cell, column) for column in columns])
    return np.ascontiguousarray(sums.T).reshape(-1, *values.shape[1:])


def _kept_apart(result: FloatArray, fitted: FloatArray) -> FloatArray:
    """Return sets moved towards the fitted ones until the least gap is half theirs or more."""
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
