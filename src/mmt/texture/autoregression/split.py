"""Kernels between reflection coefficients and line spectral frequencies, in both directions.

Neither goes through the coefficients of a polynomial. In the variable ``t = 2 cos(w/2)``, with
the linear phase taken out, the polynomials P and Q of every order obey three-term recurrences
(Delsarte and Genin, "The split Levinson algorithm", IEEE Trans. ASSP 34 (1986), 470-478)::

    p_(j+1) = t p_j - (1 - k_j) (1 + k_(j-1)) p_(j-1)      k_0 = 1
    q_(j+1) = t q_j - (1 + k_j) (1 - k_(j-1)) q_(j-1)      from j = 2, without the zero at w = 0

so that their zeros are the eigenvalues of symmetric tridiagonal matrices with a zero diagonal,
in plus and minus pairs. From reflection coefficients, bisection finds the eigenvalues. The other
way, they are the singular values of bidiagonal matrices, whose squared entries are a qd array:
alternately `q` and `e`, the coefficients of the recurrence.

A qd array ``q[0], e[0], q[1], e[1], ...`` of positive numbers is the matrix ``B B^T``, B
bidiagonal with the square roots of `q` on the diagonal and of `e` beside it (Rutishauser 1954;
Fernando and Parlett, "Accurate singular values and differential qd algorithms", Numer. Math. 67
(1994), 191-229). It is built from nodes and masses at O(size) a node, without subtractions, so
that every result is accurate relative to itself.

The coefficients are products of positive numbers, so that roundings only cause small relative
changes of them. Hence small frequencies, frequencies near pi and reflection coefficients near one
keep their relative accuracy. Cost: O(m^2) either way.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.burg import LARGEST_REFLECTION


@kernel("void(f8[::1], f8[::1], i8, f8)", inner=True)
def _move_origin(q: FloatArray, e: FloatArray, size: int, distance: float) -> None:
    """Move all nodes up by `distance`: the stationary qd step with a positive shift."""
    t = distance
    for i in range(size):
        old = q[i]
        q[i] = old + t
        if i + 1 < size:
            share = e[i] / q[i]
            e[i] = share * old
            t = distance + share * t


@kernel("void(f8[::1], f8[::1], i8, f8, f8)", inner=True)
def _add_mass(q: FloatArray, e: FloatArray, size: int, mass: float, added: float) -> None:
    """Add a node of mass `added` at zero to nodes of total `mass`; the size grows by one."""
    d = q[0] * (added / (mass + added))
    q[0] *= mass / (mass + added)
    for i in range(size - 1):
        beside = d + e[i]
        following = q[i + 1] / beside
        q[i + 1] = following * e[i]
        d *= following
        e[i] = beside
    e[size - 1] = d
    q[size] = 0.0


_LEAST_FREQUENCY: Final = 2.0**-100
_BINARY_DIGITS: Final = 58


@kernel("void(f8[::1])", inner=True)
def separate(lsf: FloatArray) -> None:
    """Make the frequencies ascend strictly inside (0, pi), moving those that do not by roundings.

    Zeros of P and Q come arbitrarily close to each other as reflection coefficients near one.
    """
    apart = lsf[0] >= _LEAST_FREQUENCY and lsf[len(lsf) - 1] < math.pi
    for i in range(1, len(lsf)):
        apart = apart and lsf[i - 1] < lsf[i]
    if apart:
        return
    least = _LEAST_FREQUENCY
    for i in range(len(lsf)):
        lsf[i] = max(lsf[i], least)
        least = np.nextafter(lsf[i], 4.0)
    most = np.nextafter(math.pi, 0.0)
    for i in range(len(lsf) - 1, -1, -1):
        lsf[i] = min(lsf[i], most)
        most = np.nextafter(lsf[i], 0.0)


@kernel("void(f8[::1], i8, f8[::1], f8[::1], f8[::1])", inner=True)
def _bisect(
    reflection: FloatArray, first: int, t: FloatArray, pivot: FloatArray, above: FloatArray
) -> None:
    """Write ``2 cos(w/2)`` of each zero of P (first 0), or of Q of negated `reflection` (first 1).

    The values descend. The number of eigenvalues above a value is the number of negative pivots of
    the value times the identity minus the tridiagonal matrix (Sturm). Roundings amount to small
    changes of the entries (Barth, Martin and Wilkinson, "Calculation of the eigenvalues of a
    symmetric tridiagonal matrix by the method of bisection", Numer. Math. 9 (1967), 386-393). The
    zeros are searched together, a binary digit at a time.
    """
    order = len(reflection)
    count = (order + 1 - first) // 2
    for i in range(count):
        t[i] = 0.0
    width = 2.0
    for _ in range(_BINARY_DIGITS):
        width *= 0.5
        for i in range(count):
            pivot[i], above[i] = t[i] + width, 0.0
        for j in range(first, order):
            c = (1.0 - reflection[j]) * (1.0 + (reflection[j - 1] if j > 0 else 1.0))
            for i in range(count):
                pivot[i] = t[i] + width - c / pivot[i]
                above[i] += 1.0 if pivot[i] < 0.0 else 0.0
        for i in range(count):
            t[i] += width if above[i] > i else 0.0


@kernel("void(f8[:, ::1], f8[:, ::1])")
def reflection_to_lsf_each_into(reflection: FloatArray, lsf: FloatArray) -> None:
    """Write the line spectral frequencies (n, m) of reflection coefficients (n, m), m to 64.

    The upper half of (0, pi) is searched in cos(w/2), the lower half in sin(w/2), by the mirrored
    filter A(-z), whose frequencies are pi - w: the arc sine is exact where either is small. That
    magnitudes are below one is not checked. Cost: some 240 m^2 operations a row.
    """
    order = reflection.shape[1]
    signed, t, pivot, above = np.empty(order), np.empty(order), np.empty(order), np.empty(order)
    zeros = np.empty((2, order))
    for row in range(len(lsf)):
        for mirrored in range(2):
            for first in range(2):
                sign = 1.0 - 2.0 * first
                for j in range(order):
                    sign = -sign if mirrored == 1 else sign
                    signed[j] = sign * reflection[row, j]
                _bisect(signed, first, t, pivot, above)
                for i in range((order + 1 - first) // 2):
                    zeros[mirrored, 2 * i + first] = t[i]
        for number in range(order):
            cosine, sine = zeros[0, number], zeros[1, order - 1 - number]
            low = 2.0 * math.asin(0.5 * sine)
            lsf[row, number] = low if sine < cosine else math.pi - 2.0 * math.asin(0.5 * cosine)
        separate(lsf[row])


@kernel("f8(f8, f8)", inner=True)
def _distance(left: float, right: float) -> float:
    """Return ``2 |cos(left) - cos(right)|`` with the digits of the difference."""
    return 4.0 * math.sin(0.5 * (left + right)) * math.sin(0.5 * abs(right - left))


@kernel("f8(f8[::1], i8, f8[::1])", inner=True)
def _weigh(lsf: FloatArray, first: int, weights: FloatArray) -> float:
    """Write the masses at the zeros of P (first 0) or Q (first 1); return the mass at w = pi.

    They are the residues of the order below over this order, times ``1 + k_m`` for P and
    ``1 - k_m`` for Q: positive, since the zeros of P and Q interlace.
    """
    order = len(lsf)
    other = 1 - first
    zero_at_pi = (order + first) % 2 == 0
    at_pi = 2.0 if first == 0 else 0.5
    for i in range(first, order, 2):
        sine, cosine = math.sin(0.5 * lsf[i]), math.cos(0.5 * lsf[i])
        mass = 2.0 * sine * sine if first == 0 else 0.5
        if zero_at_pi:
            mass /= 4.0 * cosine * cosine
            at_pi /= 4.0 * cosine * cosine
        for j in range(0, order, 2):  # in pairs, so that nothing overflows on the way
            same, opposite = j + first, j + other
            if opposite < order:
                mass *= _distance(lsf[i], lsf[opposite])
            if same < order and same != i:
                mass /= _distance(lsf[i], lsf[same])
        weights[i // 2] = mass
    for i in range(other, order, 2):
        cosine = math.cos(0.5 * lsf[i])
        at_pi *= 4.0 * cosine * cosine
    return at_pi if zero_at_pi else 0.0


@kernel("f8(f8[::1], i8, f8[::1], f8[::1], f8[::1])", inner=True)
def _recover(
    lsf: FloatArray, first: int, weights: FloatArray, q: FloatArray, e: FloatArray
) -> float:
    """Write the qd array of P (first 0) or Q (first 1), highest order first; return its mass.

    Laurie, "Accurate recovery of recursion coefficients from Gaussian quadrature formulas",
    J. Comput. Appl. Math. 112 (1999), 165-180: nodes 4 cos^2(w/2) are inserted from the
    largest down, each at the origin, which then moves on to the next.
    """
    order = len(lsf)
    at_pi = _weigh(lsf, first, weights)
    if first >= order:
        return at_pi
    mass = weights[0]
    q[0] = 0.0
    size = 1
    for i in range(first + 2, order, 2):
        _move_origin(q, e, size, _distance(lsf[i - 2], lsf[i]))
        _add_mass(q, e, size, mass, weights[i // 2])
        mass += weights[i // 2]
        size += 1
    last = order - 1 - (order - 1 - first) % 2
    cosine = math.cos(0.5 * lsf[last])
    _move_origin(q, e, size, 4.0 * cosine * cosine)
    if at_pi > 0.0:
        _add_mass(q, e, size, mass, at_pi)
    return float(mass + at_pi)


@kernel("void(f8[::1], f8[::1], f8[::1])", inner=True)
def lsf_to_reflection_into(lsf: FloatArray, reflection: FloatArray, work: FloatArray) -> None:
    """Write the reflection coefficients (m,) of line spectral frequencies (m,).

    The recurrences of P and Q are recovered from the frequencies, and give the ratios
    ``(1 + k_j) / (1 - k_j)`` from the highest order down by products alone. The frequencies ascend
    within (0, pi), which is not checked; the coefficients are of magnitude below one. `work` holds
    5 (m // 2 + 2) numbers or more.
    """
    order = len(lsf)
    half = order // 2 + 2
    p_q, p_e, q_q = work[:half], work[half : 2 * half], work[2 * half : 3 * half]
    q_e, weights = work[3 * half : 4 * half], work[4 * half : 5 * half]
    ratio = _recover(lsf, 0, weights, p_q, p_e) / _recover(lsf, 1, weights, q_q, q_e)
    for done in range(order):
        k = (ratio - 1.0) / (ratio + 1.0)
        reflection[order - 1 - done] = min(max(k, -LARGEST_REFLECTION), LARGEST_REFLECTION)
        if done == order - 1:
            break
        if done % 2 == 0:
            ratio *= p_q[done // 2] / q_q[done // 2]
        else:
            ratio *= p_e[done // 2] / q_e[done // 2]


@kernel("void(f8[:, ::1], f8[:, ::1])")
def lsf_to_reflection_each_into(lsf: FloatArray, reflection: FloatArray) -> None:
    """Do `lsf_to_reflection_into` for every row (n, m)."""
    work = np.empty(5 * (lsf.shape[1] // 2 + 2))
    for row in range(len(lsf)):
        lsf_to_reflection_into(lsf[row], reflection[row], work)
