"""Compiled kernels of the kriging in `mmt.texture.selection.neighbour_prediction`."""

import math

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel


@kernel("i8[:, ::1](i8[:, ::1], i8[::1], i8)")
def nearest(order: IntArray, voices: IntArray, count: int) -> IntArray:
    """Return the first ``count`` others of each row, without repeats, shape (n, count).

    Parameters
    ----------
    order
        Indices into `voices` by distance, shape (n, k); from ``len(voices)`` on they repeat. Each
        row holds at least ``count`` others.
    voices
        Indices of the present points.
    """
    members = np.empty((order.shape[0], count), dtype=np.int64)
    for row in range(order.shape[0]):
        found = 0
        for column in range(order.shape[1]):
            if found == count:
                break
            voice = voices[order[row, column] % voices.size]
            new = voice != row
            for k in range(found):
                new = new and members[row, k] != voice
            if new:
                members[row, found] = voice
                found += 1
    return members


@kernel("f8(f8)")
def _matern(distance: float) -> float:
    """Return the Matern correlation of smoothness 5/2 at a distance in lengths."""
    r = 2.23606797749979 * distance
    result: float = (1.0 + r + r * r / 3.0) * math.exp(-r)
    return result


@kernel("f8[::1](f8[:, ::1], f8[::1])")
def _deviations(velocity: FloatArray, scales: FloatArray) -> FloatArray:
    """Return the normalisation of each departure in a covariance, shape (n,).

    Where a stroke and its return are the same the sum of both correlations would be larger.
    """
    result = np.full(velocity.shape[0], 1.0 / scales[0])
    if scales[4] > 0.0:
        for i in range(result.size):
            speed = math.sqrt((velocity[i] * velocity[i]).sum())
            result[i] *= math.sqrt(1.0 + scales[4] * _matern(2.0 * speed / scales[1]))
    return result


@kernel("f8(f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], i8, i8)")
def _departure(
    velocity: FloatArray,
    law: FloatArray,
    scales: FloatArray,
    deviations: FloatArray,
    i: int,
    j: int,
) -> float:
    """Return the covariance of the departures at two points."""
    away, returning = 0.0, 0.0
    for axis in range(velocity.shape[1]):
        a, b = velocity[i, axis], velocity[j, axis]
        away += (a - b) * (a - b)
        returning += (a + b) * (a + b)
    along = _matern(math.sqrt(away) / scales[1])
    if scales[4] > 0.0:
        along += scales[4] * _matern(math.sqrt(returning) / scales[1])
    across = _matern(abs(law[i, 1] - law[j, 1]) / scales[3])
    result: float = along * across / (deviations[i] * deviations[j])
    return result


@kernel("f8[:, ::1](f8[:, ::1], f8[:, ::1], f8[::1])")
def covariance(velocity: FloatArray, law: FloatArray, scales: FloatArray) -> FloatArray:
    """Return the prior covariance (n, n) of points, the constant left out.

    Parameters
    ----------
    velocity
        Shape (n, d - 1).
    law
        Inputs of the plane, shape (n, 2), the last one of the force.
    scales
        Departure, its length along the velocity, slope, length along the force, and correlation
        of a stroke and its return.
    """
    n = velocity.shape[0]
    result = np.empty((n, n))
    deviations = _deviations(velocity, scales)
    middle = np.array([law[:, 0].mean(), law[:, 1].mean()])
    for i in range(n):
        for j in range(i + 1):
            slopes = 0.0
            for k in range(2):
                slopes += (law[i, k] - middle[k]) * (law[j, k] - middle[k])
            result[i, j] = scales[2] * scales[2] * slopes
            result[i, j] += _departure(velocity, law, scales, deviations, i, j)
            result[j, i] = result[i, j]
    return result


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], i8[:, ::1], i8[::1], f8[::1], f8[:, ::1])")
def kriged(
    velocity: FloatArray,
    law: FloatArray,
    variances: FloatArray,
    members: IntArray,
    rows: IntArray,
    scales: FloatArray,
    weights: FloatArray,
) -> None:
    """Write the weights (n, k) by which the members predict the points ``rows``.

    Ordinary kriging: the weights have sum 1, so that the constant does not matter. The
    parameters are as in `covariance`, ``variances`` (n,) those of the noise.
    """
    size = members.shape[1]
    total = np.empty((size, size))
    sides = np.ones((size, 2))
    deviations = _deviations(velocity, scales)
    for row in rows:
        for i in range(size):
            first = members[row, i]
            sides[i, 0] = _departure(velocity, law, scales, deviations, first, row)
            for j in range(i + 1):
                second = members[row, j]
                slopes = 0.0
                for k in range(2):
                    slopes += (law[first, k] - law[row, k]) * (law[second, k] - law[row, k])
                total[i, j] = scales[2] * scales[2] * slopes
                total[i, j] += _departure(velocity, law, scales, deviations, first, second)
                total[j, i] = total[i, j]
            total[i, i] += variances[first]
        solved = np.linalg.solve(total, sides)
        missing = (1.0 - solved[:, 0].sum()) / solved[:, 1].sum()
        for i in range(size):
            weights[row, i] = solved[i, 0] + missing * solved[i, 1]
