"""Kernels between reflection coefficients and line spectral frequencies, in both directions.

Neither goes through the coefficients of a polynomial. In the variable ``t = 2 cos(w/2)``, with
the linear phase taken out, the polynomials P and Q of every order obey three-term recurrences
(Delsarte and Genin, "The split Levinson algorithm", IEEE Trans. ASSP 34 (1986), 470-478)::

    p_(j+1) = t p_j - (1 - k_j) (1 + k_(j-1)) p_(j-1)      k_0 = 1
    q_(j+1) = t q_j - (1 + k_j) (1 - k_(j-1)) q_(j-1)      from j = 2, without the zero at w = 0

so that their zeros are the eigenvalues of symmetric tridiagonal matrices with a zero diagonal,
that is plus and minus the singular values of bidiagonal ones, whose squared entries are a qd
array (see `mmt.texture.qd`): alternately `q` and `e`, the coefficients of the recurrence.

All steps add, multiply and divide positive numbers. Hence small frequencies, frequencies near
pi and reflection coefficients near one keep their relative accuracy. Cost: O(m^2) either way.
"""

import math
from typing import Final

import numpy as np

from mmt.arrays import FloatArray
from mmt.compiled import kernel
from mmt.texture.burg import LARGEST_REFLECTION
from mmt.texture.qd import add_mass, eigenvalues_up_to, move_origin

_LEAST_FREQUENCY: Final = 2.0**-100


@kernel("i8(f8[::1], b1, b1, f8[::1], f8[::1])")
def _recurrence(
    reflection: FloatArray, of_p: bool, mirrored: bool, q: FloatArray, e: FloatArray
) -> int:
    """Write the qd array of p (or q) whose eigenvalues are ``4 cos^2(w/2)``; return its size.

    Mirrored, it belongs to A(-z), whose frequencies are pi - w. A zero at w = pi, which an even
    number of coefficients has, is left out: the last `e` is beyond the last `q`.
    """
    order = len(reflection)
    size = 0
    beside = False
    before = 1.0
    for j in range(order):
        k = -reflection[j] if mirrored and j % 2 == 0 else reflection[j]
        value = (1.0 - k) * (1.0 + before) if of_p else (1.0 + k) * (1.0 - before)
        before = k
        if j == 0 and not of_p:
            continue
        if beside:
            e[size - 1] = value
        else:
            q[size], e[size] = value, 0.0
            size += 1
        beside = not beside
    return size


@kernel("void(f8[::1])")
def separate(lsf: FloatArray) -> None:
    """Make the frequencies ascend strictly inside (0, pi), moving what is closer by roundings.

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


@kernel("void(f8[::1], f8[::1], f8[::1])")
def reflection_to_lsf_into(reflection: FloatArray, lsf: FloatArray, work: FloatArray) -> None:
    """Write the line spectral frequencies (m,), ascending, of reflection coefficients (m,).

    The upper half of (0, pi) comes from the matrices in cos(w/2), the lower half from those
    of the mirrored filter, in sin(w/2): each is accurate relative to its own small values.

    Parameters
    ----------
    reflection : (m,)
        Each of magnitude below one, not checked.
    lsf : (m,)
        Receives radians in (0, pi), strictly ascending.
    work : (6 * (m // 2 + 1),) or longer
        Scratch.
    """
    order = len(reflection)
    half = order // 2 + 1
    q, e, values = work[:half], work[half : 2 * half], work[2 * half : 3 * half]
    rest = work[3 * half : 6 * half]
    for first in range(2):
        of_p = first == 0
        count = (order + 1 - first) // 2
        size = _recurrence(reflection, of_p, False, q, e)
        upper = eigenvalues_up_to(q, e, size, 2.0, values, rest)
        last = first + 2 * (count - 1)
        for i in range(upper):
            lsf[last - 2 * i] = math.pi - 2.0 * math.asin(0.5 * math.sqrt(values[i]))
        # A(-z) exchanges P and Q where the order is even. A little more than the other half,
        # so that a frequency at the middle is not lost between the two.
        size = _recurrence(reflection, of_p != (order % 2 == 0), True, q, e)
        eigenvalues_up_to(q, e, size, 2.1, values, rest)
        for i in range(count - upper):
            lsf[first + 2 * i] = 2.0 * math.asin(0.5 * math.sqrt(values[i]))
    separate(lsf)


@kernel("void(f8[:, ::1], f8[:, ::1])")
def reflection_to_lsf_each_into(reflection: FloatArray, lsf: FloatArray) -> None:
    """Do `reflection_to_lsf_into` for every row (n, m)."""
    work = np.empty(6 * (reflection.shape[1] // 2 + 1))
    for row in range(len(reflection)):
        reflection_to_lsf_into(reflection[row], lsf[row], work)


@kernel("f8(f8, f8)")
def _distance(left: float, right: float) -> float:
    """Return ``2 |cos(left) - cos(right)|`` with the digits of the difference."""
    return 4.0 * math.sin(0.5 * (left + right)) * math.sin(0.5 * abs(right - left))


@kernel("f8(f8[::1], i8, f8[::1])")
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


@kernel("f8(f8[::1], i8, f8[::1], f8[::1], f8[::1])")
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
        move_origin(q, e, size, _distance(lsf[i - 2], lsf[i]))
        add_mass(q, e, size, mass, weights[i // 2])
        mass += weights[i // 2]
        size += 1
    last = order - 1 - (order - 1 - first) % 2
    cosine = math.cos(0.5 * lsf[last])
    move_origin(q, e, size, 4.0 * cosine * cosine)
    if at_pi > 0.0:
        add_mass(q, e, size, mass, at_pi)
    return float(mass + at_pi)


@kernel("void(f8[::1], f8[::1], f8[::1])")
def lsf_to_reflection_into(lsf: FloatArray, reflection: FloatArray, work: FloatArray) -> None:
    """Write the reflection coefficients (m,) of line spectral frequencies (m,).

    The recurrences of P and Q are recovered from the frequencies, and give the ratios
    ``(1 + k_j) / (1 - k_j)`` from the highest order down by products alone.

    Parameters
    ----------
    lsf : (m,)
        Ascending within (0, pi), not checked.
    reflection : (m,)
        Receives numbers of magnitude below one.
    work : (5 * (m // 2 + 2),) or longer
        Scratch.
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
