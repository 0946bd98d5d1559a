"""Evaluation of a texture model's network at a point, in compiled code: a valid level and filter.

The network goes through level and line spectral frequencies (LSF) of the samples. It is no convex
combination: it overshoots between samples and follows its polynomial beyond them. Paper B does not
say how to keep the result valid. Here the level is not negative, is limited by `LEVEL_ROOM`, and
falls to zero below the slowest and the lightest sample. The LSF are replaced by the nearest valid
ones: at least a gap apart, and each within its range in the samples, which keeps them from 0 and
pi. With the gaps subtracted, ``z_i = w_i - i gap``, valid means ascending within ascending bounds.
Pooling adjacent violators, each pool at its mean within its bounds, finds the nearest (least
squares) in O(m) (Best, Chakravarti and Ubhaya, "Minimizing separable convex functions subject to
simple chain constraints", SIAM J. Optim. 10 (2000), 658-672).
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate

LEVEL_ROOM: Final = 2.0
"""Largest level allowed, over the largest of the samples: the level may rise further beyond the
fastest and strongest sample, but a wild extrapolation is limited."""

LEAST_GAP: Final = 0.03
"""Gap in rad: just below the smallest one, 0.038 rad, of the HaTT models at 1 kHz."""

LEAST_REACH: Final = 0.01
"""Normalised speed and force below which the level always falls to zero."""

_GAP, _UNIT, _SLOWEST, _LIGHTEST = range(4)  # the first row of the tail
_LOWEST, _HIGHEST, _COEFFICIENTS = 1, 2, 3  # rows of the tail
_BLOCK = 32  # terms added up before they join the sum: the rounding grows as n/32 + 32, not as n
_LARGEST_LEVEL = 1e300


def network_arrays(points: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve for the network of samples.

    Parameters
    ----------
    points
        Normalised, shape (n, d).
    values
        Level and LSF, shape (n, 1 + order).

    Returns
    -------
    rows
        Point and weights of each sample, shape (n, d + 1 + order).
    tail
        First the least gap of the LSF (rad), the unit of the level, and the least normalised speed
        and force of a sample; then least and largest values; then the polynomial's coefficients.
        Shape (4 + d, max(4, 1 + order)).
    """
    from mmt.texture.interpolation.network_solving import RadialBasisNetwork  # as triangulation

    unit = float(values[:, 0].max()) or 1.0
    scaled = np.column_stack([values[:, 0] / unit, values[:, 1:]])
    network = RadialBasisNetwork(points, scaled)
    speed = points[:, 0] if points.shape[1] == 2 else np.hypot(points[:, 0], points[:, 1])
    slowest, lightest = (max(float(x.min()), LEAST_REACH) for x in (speed, points[:, -1]))
    tail = np.zeros((3 + len(network.coefficients), max(4, values.shape[1])))
    tail[0, :4] = least_gap(values[:, 1:]), unit, slowest, lightest
    tail[_LOWEST, : values.shape[1]] = values.min(axis=0)
    tail[_HIGHEST, : values.shape[1]] = values.max(axis=0)
    tail[_HIGHEST, 0] = LEVEL_ROOM * min(unit, _LARGEST_LEVEL)
    tail[_COEFFICIENTS:, : values.shape[1]] = network.coefficients
    return np.ascontiguousarray(np.hstack([points, network.weights])), tail


def least_gap(lsf: FloatArray) -> float:
    """Return the gap to keep: `LEAST_GAP`, or the smallest of the samples (n, m) if it is less.

    Distances from 0 and pi count as gaps.
    """
    gaps = np.diff(lsf, axis=1, prepend=0.0, append=math.pi)
    return float(min(LEAST_GAP, gaps.min()))


@kernel("f8(f8[::1], f8, f8)", inner=True)
def _reach(point: FloatArray, slowest: float, lightest: float) -> float:
    """Return 1, or less if the hand is slower or lighter than any sample, 0 at rest."""
    speed = point[0] if len(point) == 2 else math.hypot(point[0], point[1])
    return float(min(1.0, speed / slowest, point[len(point) - 1] / lightest))


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[::1])", inner=True)
def _add_radial(rows: FloatArray, point: FloatArray, values: FloatArray, block: FloatArray) -> None:
    """Add the radial functions' part, block by block of rows."""
    dimensions, first = len(point), 0
    while first < len(rows):
        block[:] = 0.0
        last = min(first + _BLOCK, len(rows))
        for j in range(first, last):
            squared = 0.0
            for axis in range(dimensions):
                step = point[axis] - rows[j, axis]
                squared += step * step
            phi = 0.5 * squared * math.log(squared) if squared > 0.0 else 0.0
            for k in range(len(values)):
                block[k] += phi * rows[j, dimensions + k]
        for k in range(len(values)):
            values[k] += block[k]
        first = last


@kernel("void(f8[::1], f8, f8[::1], f8[::1], f8[::1])", inner=True)
def nearest_valid_lsf(
    lsf: FloatArray, gap: float, lowest: FloatArray, highest: FloatArray, work: FloatArray
) -> None:
    """Replace frequencies by the nearest ones within bounds that are a gap apart.

    Parameters
    ----------
    lsf : (m,)
        Any numbers; those that are not finite count as pi/2.
    gap
        In rad, not negative.
    lowest, highest : (m,)
        Bounds inside (0, pi), either of them a gap apart.
    work : (3 * m,) or longer
        Scratch.

    Notes
    -----
    Frequencies that are equal after rounding are moved apart by a rounding.
    """
    pools = 0  # each with its mean, its value within bounds, and its size
    for i in range(len(lsf)):
        mean = (lsf[i] if math.isfinite(lsf[i]) else 0.5 * math.pi) - i * gap
        size, first, least = 1, i, lowest[i] - i * gap
        value = min(max(mean, least), highest[i] - i * gap)
        while pools > 0 and work[3 * pools - 2] >= value:
            pools -= 1
            before = int(work[3 * pools + 2])
            share = size / (before + size)
            mean = work[3 * pools] * (1.0 - share) + mean * share
            size += before
            first -= before
            value = min(max(mean, least), highest[first] - first * gap)
        work[3 * pools] = mean
        work[3 * pools + 1] = value
        work[3 * pools + 2] = size
        pools += 1
    i = 0
    for pool in range(pools):
        for _ in range(int(work[3 * pool + 2])):
            lsf[i] = work[3 * pool + 1] + i * gap
            i += 1
    separate(lsf)


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1])", inner=True)
def network_into(
    rows: FloatArray,
    tail: FloatArray,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> None:
    """Write level and LSF (1 + order,) at a point (d,): a valid filter.

    `rows` and `tail` are those of `network_arrays`, and `scratch` holds 4 order + 1 numbers or
    more. Costs n logarithms and n (1 + order) multiplications, and O(order) for the rest.
    """
    values[:] = 0.0
    _add_radial(rows, point, values, scratch[: len(values)])
    end = len(values)
    for i in range(end):
        values[i] += tail[_COEFFICIENTS, i]
        for axis in range(len(point)):
            values[i] += point[axis] * tail[_COEFFICIENTS + 1 + axis, i]
    bound = tail[_HIGHEST, 0] * _reach(point, tail[0, _SLOWEST], tail[0, _LIGHTEST])
    values[0] = min(max(values[0], 0.0) * tail[0, _UNIT], bound)
    lowest, highest = tail[_LOWEST, 1:end], tail[_HIGHEST, 1:end]
    nearest_valid_lsf(values[1:], tail[0, _GAP], lowest, highest, scratch[end:])
