"""Kernels that find zeros of three-term recurrences, sixteen side by side.

A symmetric tridiagonal matrix of zero diagonal, ``c_j`` the squares beside it, has eigenvalues
plus and minus ``t``; in ``x = t^2`` its characteristic polynomial comes from the recurrence

    r_0 = r_1 = 1,    r_(j+1) = x r_j - c_j r_(j-1), the factor x for odd j alone.

The sign changes in r_0, r_1, ... are the zeros above x (Sturm). Each computed value is that of a
recurrence whose c_j are changed by a few roundings relative to themselves, and with them every
zero by as little relative to itself (Demmel and Kahan, "Accurate singular values of bidiagonal
matrices", SIAM J. Sci. Stat. Comput. 11 (1990), 873-912). Hence count and value may be trusted
near any zero, however small it is or close to others.

Every lane searches one zero of a recurrence of its own; the lanes go step by step together, so
that the processor's vectors hold them. What one lane does never depends on another.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel

LANES: Final = 16
STATE_SIZE: Final = 15 * LANES

# Rows of the state, which is one flat array: the compiler sees that rows are a constant apart,
# hence that lanes are independent. A value of r, r' and r''/2 by even and by odd j:
_EVEN: Final = 0
_ODD: Final = 1 * LANES
_EVEN_SLOPE: Final = 2 * LANES
_ODD_SLOPE: Final = 3 * LANES
_EVEN_BEND: Final = 4 * LANES
_ODD_BEND: Final = 5 * LANES
_CHANGES: Final = 6 * LANES
X: Final = 7 * LANES
# Bracket of the zero, the number of zeros above it, and the number of all zeros:
_LOW: Final = 8 * LANES
_HIGH: Final = 9 * LANES
_ABOVE: Final = 10 * LANES
_DEGREE: Final = 11 * LANES
_LONGER: Final = 12 * LANES  # 1 where the recurrence has all steps, 0 where it has one less
_STRIDE: Final = 13 * LANES  # of Laguerre's last step, 0 for none
_STEPS: Final = 14 * LANES  # taken so far, -1 when found

_LARGEST: Final = 4.0
_LEAST: Final = 2.0**-206
_EPSILON: Final = float(np.finfo(np.float64).eps)
_STEPS_BEFORE_BISECTION: Final = 24
_STRETCH: Final = 8  # pairs of steps, each shrinking r by 2^-106 at most, within the numbers' range


@kernel("void(f8[::1], i8, f8, i8, i8, b1)")
def begin_search(
    state: FloatArray, lane: int, x: float, above: int, degree: int, longer: bool
) -> None:
    """Start the search of a lane at `x` for the zero in (0, 4) that `above` of `degree` exceed.

    Its recurrence has as many steps as `improve` is told, or one less if not `longer`.
    """
    state[X + lane] = x
    state[_LOW + lane], state[_HIGH + lane] = _LEAST, _LARGEST
    state[_ABOVE + lane], state[_DEGREE + lane] = above, degree
    state[_LONGER + lane] = 1.0 if longer else 0.0
    state[_STRIDE + lane] = state[_STEPS + lane] = 0.0


@kernel("b1(f8[::1], i8)")
def is_found(state: FloatArray, lane: int) -> bool:
    """Return whether `X` of a lane is its zero."""
    return bool(state[_STEPS + lane] < 0.0)


@kernel("void(f8[::1])")
def _rescale(state: FloatArray) -> None:
    """Bring r to one, and its derivatives along: their ratios alone matter."""
    for lane in range(LANES):
        scale = 1.0 / max(abs(state[_EVEN + lane]), abs(state[_ODD + lane]))
        state[_EVEN + lane] *= scale
        state[_ODD + lane] *= scale
        state[_EVEN_SLOPE + lane] *= scale
        state[_ODD_SLOPE + lane] *= scale
        state[_EVEN_BEND + lane] *= scale
        state[_ODD_BEND + lane] *= scale


@kernel("void(f8[::1], f8[::1], i8)")
def _steps_in_pairs(state: FloatArray, coefficients: FloatArray, pairs: int) -> None:
    """Advance the recurrence and its derivatives by pairs of steps; count the sign changes."""
    for pair in range(pairs):
        if pair > 0 and pair % _STRETCH == 0:
            _rescale(state)
        for lane in range(LANES):
            x, c = state[X + lane], coefficients[2 * LANES * pair + lane]
            r, slope, bend = state[_ODD + lane], state[_ODD_SLOPE + lane], state[_ODD_BEND + lane]
            even_bend = slope + x * bend - c * state[_EVEN_BEND + lane]
            even_slope = r + x * slope - c * state[_EVEN_SLOPE + lane]
            even = x * r - c * state[_EVEN + lane]
            c = coefficients[2 * LANES * pair + LANES + lane]
            odd = even - c * r
            changes = 1.0 if (even < 0.0) != (r < 0.0) else 0.0
            changes += 1.0 if (odd < 0.0) != (even < 0.0) else 0.0
            state[_EVEN + lane], state[_ODD + lane] = even, odd
            state[_EVEN_SLOPE + lane] = even_slope
            state[_ODD_SLOPE + lane] = even_slope - c * slope
            state[_EVEN_BEND + lane] = even_bend
            state[_ODD_BEND + lane] = even_bend - c * bend
            state[_CHANGES + lane] += changes


@kernel("void(f8[::1], f8[::1])")
def _last_step(state: FloatArray, coefficients: FloatArray) -> None:
    """Advance by the last of an odd number of steps, if any; its result is in the odd place."""
    for lane in range(LANES):
        x, c, longer = state[X + lane], coefficients[lane], state[_LONGER + lane] > 0.0
        r, slope, bend = state[_ODD + lane], state[_ODD_SLOPE + lane], state[_ODD_BEND + lane]
        even_bend = slope + x * bend - c * state[_EVEN_BEND + lane]
        even_slope = r + x * slope - c * state[_EVEN_SLOPE + lane]
        even = x * r - c * state[_EVEN + lane]
        state[_CHANGES + lane] += 1.0 if longer and (even < 0.0) != (r < 0.0) else 0.0
        state[_ODD + lane] = even if longer else r
        state[_ODD_SLOPE + lane] = even_slope if longer else slope
        state[_ODD_BEND + lane] = even_bend if longer else bend


@kernel("f8(f8, f8, f8, f8, b1)")
def _laguerre(degree: float, over: float, pull: float, bend: float, upward: bool) -> float:
    """Return Laguerre's step, from ``r'/r`` and ``r''/r``, for a zero of multiplicity `over`.

    It does not pass the last of `over` zeros on its side (Li and Zeng, "The Laguerre iteration
    in solving the symmetric tridiagonal eigenproblem, revisited", SIAM J. Sci. Comput. 15
    (1994), 1145-1173); for one it converges cubically.
    """
    spread = (degree - over) / over * ((degree - 1.0) * pull * pull - degree * bend)
    root = math.sqrt(max(spread, 0.0))
    return degree / (root - pull if upward else -root - pull)


@kernel("b1(f8, f8, f8, f8, f8, f8)")
def _is_exact(
    step: float, before: float, aim: float, degree: float, pull: float, bend: float
) -> bool:
    """Return whether a step to `aim`, after one of length `before`, leaves less than a rounding.

    Left is about ``step^4 / before^3``, and what the other zeros contribute to the sum of
    ``(x - zero)^-2``. A step that is long beside `aim` has roundings of its own.
    """
    limit = 0.125 * _EPSILON * aim
    size = abs(step)
    others = size * degree * abs((pull * pull - bend) * step * step - 1.0)
    cubic = size * size * size <= limit * before * before
    return bool(cubic & (others <= limit) & (16.0 * size <= aim))


@kernel("void(f8[::1])")
def _move(state: FloatArray) -> None:
    """Move every lane by Laguerre's step, or to its bracket's middle; tell those that arrive.

    Away from a zero close behind it Laguerre's step would creep: there, and where roundings
    lead it out of the bracket, the bracket is halved.
    """
    for lane in range(LANES):
        x, r, degree = state[X + lane], state[_ODD + lane], state[_DEGREE + lane]
        over = state[_CHANGES + lane] - state[_ABOVE + lane]
        upward = over > 0.0
        over = over if upward else 1.0 - over
        low = x if upward else state[_LOW + lane]
        high = state[_HIGH + lane] if upward else x
        # No zero is nearer than a rounding: r = 0, counted as positive, is one before it.
        least = 0.25 * _EPSILON * x * abs(state[_ODD_SLOPE + lane])
        inverse = 1.0 / (min(r, -least) if r < 0.0 else max(r, least))
        pull, bend = inverse * state[_ODD_SLOPE + lane], 2.0 * inverse * state[_ODD_BEND + lane]
        step = _laguerre(degree, over, pull, bend, upward)
        aim = x + step
        near = (over == 1.0) & (step * pull < -0.5)
        good = (step * pull < 0.0) & (aim > low) & (aim < high)
        there = near & good & _is_exact(step, state[_STRIDE + lane], aim, degree, pull, bend)
        done = there | (high - low <= 8.0 * _EPSILON * high) | (high <= 4.0 * _LEAST)
        late = state[_STEPS + lane] >= _STEPS_BEFORE_BISECTION
        # Among roundings the direction may be wrong: go beyond, so that the counts tell.
        lost = near & (abs(step) <= 4.0 * _EPSILON * x) & (not done) & (not late)
        beyond = 2.0 * _EPSILON * x if lost else 0.0
        aim += beyond if upward else -beyond
        middle = math.sqrt(low * high) if late else 0.5 * (low + high)
        take = there | (near & done) | lost | (good & (not late))
        state[X + lane] = min(max(aim if take else middle, low), high)
        state[_LOW + lane], state[_HIGH + lane] = low, high
        state[_STRIDE + lane] = abs(step) if good & near else 0.0
        state[_STEPS + lane] = -1.0 if done else state[_STEPS + lane] + 1.0


@kernel("void(f8[::1], f8[::1], i8)")
def improve(state: FloatArray, coefficients: FloatArray, order: int) -> None:
    """Advance every lane by one step towards its zero; about 4 steps from a fair start.

    Parameters
    ----------
    state : (STATE_SIZE,)
        State of the search, kept between calls. A lane that has found its zero may go on.
    coefficients : (order * LANES,) or longer
        ``c_1`` of every lane, then ``c_2``: from 2^-106 to 4. In the last place of a recurrence
        with one step less, 0.
    order
        The number of steps of the recurrences, up to 64.

    Notes
    -----
    Costs about 11 operations a step of the recurrence and lane. After 24 steps the bracket is
    halved on a logarithmic scale, so that the search ends within 90, whatever roundings do.
    """
    for i in range(_EVEN_SLOPE):
        state[i] = 1.0
    for i in range(_EVEN_SLOPE, X):
        state[i] = 0.0
    _steps_in_pairs(state, coefficients, order // 2)
    if order % 2 == 1:
        _last_step(state, coefficients[(order - 1) * LANES :])
    _move(state)
