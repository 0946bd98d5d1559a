"""A radial basis model at a point: level and filter, in compiled code, made a valid filter.

The model is two networks over the same samples (see
`mmt.texture.interpolation.radial_basis.interpolator`), packed into the arrays of an `Interpolant`:

- ``rows``: coordinates, weight of the level, weights of the line spectral frequencies (LSF);
  the samples first, then the points at which the level is zero, which have no filter;
- ``links``: samples, number of the level's and of the filter's radial function; then the
  exponents of the monomials;
- ``tail``: a row as `Bounds` has it, then (each for the level and for every LSF) the least
  and the largest value, and the monomials' coefficients.

A network is no convex combination: between samples it overshoots, beyond them it follows its
polynomial. So its line spectral frequencies (LSF) are replaced by the nearest valid ones: at
least a gap apart, and each within what the samples have of it, which keeps them from 0 and pi.
With the gaps taken out, ``z_i = w_i - i gap``, valid means ascending within ascending bounds,
and pooling adjacent violators, each pool at its mean within its bounds, finds the nearest
(least squares) in O(m) (Best, Chakravarti and Ubhaya, "Minimizing separable convex functions
subject to simple chain constraints", SIAM J. Optim. 10 (2000), 658-672).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate
from mmt.texture.interpolation.interpolator import Evaluator
from mmt.texture.interpolation.radial_basis.functions import monomial, radial_value

LEAST_GAP: Final = 0.03
"""In rad: just below the smallest gap, 0.038 rad, of the HaTT models at 1 kHz."""

_LOWEST, _HIGHEST, _COEFFICIENTS = 1, 2, 3  # rows of the tail
_BLOCK = 32  # see `mmt.texture.interpolation.radial_basis.functions`


class Bounds(NamedTuple):
    """The first row of ``tail``.

    ``level_epsilon`` and ``filter_epsilon`` are squared shape parameters, ``gap`` the least
    one of LSF in rad, ``unit`` what the level is in units of, ``slowest`` and ``lightest``
    the least normalised speed and force of a sample, 0 where no place is silent.
    """

    level_epsilon: float
    filter_epsilon: float
    gap: float
    unit: float
    slowest: float
    lightest: float


@kernel("f8(f8[::1], f8, f8)")
def _reach(point: FloatArray, slowest: float, lightest: float) -> float:
    """Return 1, or less where the hand is slower or lighter than any sample, 0 at rest."""
    speed = point[0] if len(point) == 2 else math.hypot(point[0], point[1])
    force = point[len(point) - 1]
    reach = 1.0
    if speed < slowest:
        reach = speed / slowest
    if force < lightest:
        reach = min(reach, force / lightest)
    return reach


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1])")
def _add_radial(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    point: FloatArray,
    values: FloatArray,
    block: FloatArray,
) -> None:
    """Add the radial functions' part, block by block of rows."""
    dimensions, count, samples = len(point), len(rows), links[0, 0]
    level_number, filter_number = links[0, 1], links[0, 2]
    level_scale, filter_scale = tail[0, 0], tail[0, 1]
    shared = level_number == filter_number and level_scale == filter_scale
    first = 0
    while first < count:
        block[:] = 0.0
        last = min(first + _BLOCK, count)
        for j in range(first, last):
            squared = 0.0
            for axis in range(dimensions):
                step = point[axis] - rows[j, axis]
                squared += step * step
            phi = radial_value(level_number, level_scale * squared)
            block[0] += phi * rows[j, dimensions]
            if j < samples:
                if not shared:
                    phi = radial_value(filter_number, filter_scale * squared)
                for k in range(1, len(values)):
                    block[k] += phi * rows[j, dimensions + k]
        for k in range(len(values)):
            values[k] += block[k]
        first = last


def least_gap(lsf: FloatArray) -> float:
    """Return the gap to keep for samples (n, m): 0.03 rad, or what they themselves keep.

    Distances from 0 and pi count as gaps.
    """
    gaps = np.diff(lsf, axis=1, prepend=0.0, append=math.pi)
    return float(min(LEAST_GAP, gaps.min()))


@kernel("void(f8[::1], f8, f8[::1], f8[::1], f8[::1])")
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
    What rounding leaves together is moved apart by a rounding.
    """
    pools = 0  # each with its mean, its value within bounds, and how many it has
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


@Evaluator
def evaluate_networks(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    hint: int,  # noqa: ARG001
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write level and LSF at a point (d,) into `values` (1 + order,), a valid filter.

    The level is not negative, no larger than its bound, and falls to zero from the slowest
    and the lightest sample on at the latest. The LSF are the nearest valid ones.

    Notes
    -----
    Costs n radial functions (twice as many where level and filter have different ones) and
    n (1 + order) multiplications; O(order) for the rest.
    """
    values[:] = 0.0
    _add_radial(rows, links, tail, point, values, scratch[: len(values)])
    for k in range(1, len(links)):
        product = monomial(links[k], point)
        for i in range(len(values)):
            values[i] += product * tail[_COEFFICIENTS + k - 1, i]
    bound = tail[_HIGHEST, 0] * _reach(point, tail[0, 4], tail[0, 5])
    values[0] = min(max(values[0], 0.0) * tail[0, 3], bound)
    end = len(values)
    lowest, highest = tail[_LOWEST, 1:end], tail[_HIGHEST, 1:end]
    nearest_valid_lsf(values[1:], tail[0, 2], lowest, highest, scratch[end:])
    return 0
