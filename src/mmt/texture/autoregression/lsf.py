"""Kernels from line spectral frequencies to filter coefficients, gains and the lattice filter.

Conventions, here and in the whole package: ``x[n] + sum_j a[j] x[n-1-j] = e[n]``; `ar` holds
the m coefficients a without the leading 1; reflection coefficients k satisfy
``A_j(z) = A_{j-1}(z) + k_j z^-j A_{j-1}(1/z)``, the last coefficient of A_j being k_j. The
line spectral frequencies are the angles in (0, pi), ascending, of the zeros of
``P(z) = A(z) + z^-(m+1) A(1/z)`` (first, third, ...) and
``Q(z) = A(z) - z^-(m+1) A(1/z)`` (second, fourth, ...), without the zeros at 0 and pi
(Itakura 1975; Soong and Juang 1984).

Kernels may also be called from other kernels: they write into arrays of the caller. `work` is a
scratch array of at least the stated length, never shared by two threads.

Each stage turns the pair of forward and backward prediction error by a rotation, cosine
``sqrt(1 - k^2)``, sine k (Gray and Markel, "A normalized digital filter structure", IEEE
Trans. ASSP 23 (1975), 268-277). All stages together rotate (memory, excitation) into (new
memory, backward error of the full order); the output is the first number of the new memory.
This holds for all reflection coefficients, also if they change with time. So the memory grows
by no more than the input, and white noise of variance one gives an output of variance one at
every sample, even during a change of filter. The direct form has neither property: it diverges
if stable filters alternate, and loses accuracy near the unit circle.

Cost: 4 multiplications a stage and sample.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.split import lsf_to_reflection_into


def _leja_orders(largest: int) -> IntArray:
    """Return, in row h, the numbers 0 ... h-1 in the Leja order of h evenly spread angles.

    Each next point is the one whose distances to the points before it, on the cosine's
    scale, have the greatest product; ties go to the lower number.
    """
    orders = np.zeros((largest + 1, largest), dtype=np.int64)
    for count in range(1, largest + 1):
        x = np.cos((np.arange(count) + 0.5) * np.pi / count)
        product = np.ones(count)
        for place in range(1, count):
            product *= 2.0 * np.abs(x - x[orders[count, place - 1]])
            orders[count, place] = np.argmax(np.round(product / product.max(), 9))
    return orders


_PRODUCT_ORDERS: Final = _leja_orders((LARGEST_ORDER + 1) // 2)


@kernel("void(f8[::1], i8, i8, f8[::1])", inner=True)
def _half_product(lsf: FloatArray, first: int, count: int, half: FloatArray) -> None:
    """Multiply out ``prod (1 - 2 cos(w) z^-1 + z^-2)`` over every second frequency.

    The product is a palindrome of degree 2 * count; its coefficients 0 ... count are written
    to `half`. Partial products over neighbours grow far beyond the final coefficients and lose
    their digits; in the order of Leja points they do not (Calvetti and Reichel, "On the
    evaluation of polynomial coefficients", Numer. Algorithms 33 (2003), 153-161).
    """
    half[0] = 1.0
    for done in range(count):
        middle = -2.0 * math.cos(lsf[first + 2 * _PRODUCT_ORDERS[count, done]])
        beyond = half[done - 1] if done > 0 else 0.0
        half[done + 1] = beyond + middle * half[done] + beyond
        for j in range(done, 1, -1):
            half[j] += middle * half[j - 1] + half[j - 2]
        if done > 0:
            half[1] += middle


@kernel("void(f8[::1], f8[::1], f8[::1])", inner=True)
def lsf_to_ar_into(lsf: FloatArray, ar: FloatArray, work: FloatArray) -> None:
    """Write the coefficients (m,) of the filter with line spectral frequencies (m,), m to 64.

    These ascend within (0, pi), which is not checked. `work` holds m + 3 numbers or more. Costs
    about m^2/2 multiplications and m cosines.
    """
    order = len(lsf)
    symmetric_count = (order + 1) // 2
    antisymmetric_count = order // 2
    symmetric = work[: symmetric_count + 1]
    antisymmetric = work[symmetric_count + 1 : symmetric_count + antisymmetric_count + 2]
    _half_product(lsf, 0, symmetric_count, symmetric)
    _half_product(lsf, 1, antisymmetric_count, antisymmetric)
    if order % 2 == 0:  # P = (1 + z^-1) times its product, Q = (1 - z^-1) times its own
        for j in range(1, symmetric_count + 1):
            p = symmetric[j] + symmetric[j - 1]
            q = antisymmetric[j] - antisymmetric[j - 1]
            ar[j - 1] = 0.5 * (p + q)
            ar[order - j] = 0.5 * (p - q)
        return
    for j in range(1, symmetric_count):  # P is its product, Q = (1 - z^-2) times its own
        q = antisymmetric[j] - (antisymmetric[j - 2] if j > 1 else 0.0)
        ar[j - 1] = 0.5 * (symmetric[j] + q)
        ar[order - j] = 0.5 * (symmetric[j] - q)
    ar[symmetric_count - 1] = 0.5 * symmetric[symmetric_count]


@kernel("b1(f8[:, ::1])")
def are_lsf(rows: FloatArray) -> bool:
    """Return whether the values of every row (n, m) ascend strictly inside (0, pi)."""
    for row in range(len(rows)):
        last = 0.0
        for each in range(rows.shape[1]):
            if not last < rows[row, each] < np.pi:
                return False
            last = rows[row, each]
    return True


@kernel("void(f8[:, ::1], f8[:, ::1])")
def lsf_to_ar_each_into(lsf: FloatArray, ar: FloatArray) -> None:
    """Do `lsf_to_ar_into` for every row (n, m)."""
    work = np.empty(lsf.shape[1] + 3)
    for row in range(len(lsf)):
        lsf_to_ar_into(lsf[row], ar[row], work)


@kernel("f8(f8, f8, f8, f8)", inner=True)
def _cosine_difference(low: float, high: float, low_mirror: float, high_mirror: float) -> float:
    """Return ``(cos(w_low) - cos(w_high)) / 2`` from sin^2(w/2) and cos^2(w/2) of both.

    Each form keeps the digits at its own end of (0, pi).
    """
    if low_mirror < 0.5 and high_mirror < 0.5:
        return low_mirror - high_mirror
    return high - low


@kernel("f8(f8[::1], f8[::1])", inner=True)
def lsf_inverse_gain(lsf: FloatArray, work: FloatArray) -> float:
    """Return ``prod (1 - k_i^2)``, the excitation's variance over the output's power.

    The frequencies (m,) ascend within (0, pi), which is not checked. `work` holds 2 m numbers or
    more.

    The output's power is the integral of ``1/|A|^2``, which the Szego quadrature on the
    zeros of P sums exactly: the weights ``2 / |P'(w_i) Q(w_i)|`` (with the linear phase taken
    out) are positive, so that nothing cancels and the result is good to about m roundings,
    however near the poles are to the unit circle, unlike a step-down of the coefficients.
    Reference: Jones, Njastad and Thron, Bull. London Math. Soc. 21 (1989), 113-152. Costs
    m^2/2 multiplications.
    """
    order = len(lsf)
    for i in range(order):
        sine = math.sin(0.5 * lsf[i])
        cosine = math.cos(0.5 * lsf[i])
        work[2 * i] = sine * sine
        work[2 * i + 1] = cosine * cosine
    even = order % 2 == 0
    gain = 0.0
    for i in range(0, order, 2):
        low, mirror = work[2 * i], work[2 * i + 1]
        # |P' Q| is 16 sin^2(w/2) cos^2(w/2) times the products, for either parity; -w
        # carries the same weight as w.
        product = 4.0 * low * mirror
        for j in range(0, order, 2):
            if j != i:
                product *= 4.0 * _cosine_difference(low, work[2 * j], mirror, work[2 * j + 1])
        for j in range(1, order, 2):
            product *= 4.0 * _cosine_difference(low, work[2 * j], mirror, work[2 * j + 1])
        gain += 1.0 / abs(product)
    if even:  # P has a zero at pi as well
        product = 1.0
        for i in range(order):
            product *= 4.0 * work[2 * i + 1]
        gain += 1.0 / product
    return 1.0 / gain


@kernel("void(f8[:, ::1], f8[::1])")
def lsf_inverse_gain_each_into(lsf: FloatArray, gain: FloatArray) -> None:
    """Do `lsf_inverse_gain` for every row (n, m), into (n,)."""
    work = np.empty(2 * lsf.shape[1])
    for row in range(len(lsf)):
        gain[row] = lsf_inverse_gain(lsf[row], work)


@kernel("void(f8[::1], f8[::1])", inner=True)
def reflection_to_ar_into(reflection: FloatArray, ar: FloatArray) -> None:
    """Write the coefficients (m,) of the filter with the reflection coefficients (m,).

    The step-up of the Levinson recursion, in place; m^2 operations.
    """
    for stage in range(len(reflection)):
        k = reflection[stage]
        for j in range(stage // 2):
            left, right = ar[j], ar[stage - 1 - j]
            ar[j] = left + k * right
            ar[stage - 1 - j] = right + k * left
        if stage % 2 == 1:
            ar[stage // 2] *= 1.0 + k
        ar[stage] = k


@kernel("void(f8[:, ::1], f8[:, ::1])")
def reflection_to_ar_each_into(reflection: FloatArray, ar: FloatArray) -> None:
    """Do `reflection_to_ar_into` for every row (n, m)."""
    for row in range(len(reflection)):
        reflection_to_ar_into(reflection[row], ar[row])


@kernel("f8(f8[::1], f8[::1])", inner=True)
def ar_to_reflection_into(ar: FloatArray, reflection: FloatArray) -> float:
    """Write the reflection coefficients (m,) of the coefficients `ar` (m,).

    The step-down of the Levinson recursion, in place; m^2 operations. Returns the factor
    ``prod (1 + |k_i|)/(1 - |k_i|)`` by which it may have multiplied the rounding of `ar`: if
    reflection coefficients are known, do not compute them from the polynomial. Returns
    infinity, with unusable numbers left in `reflection`, if some ``|k| >= 1`` or is not a
    number.
    """
    order = len(ar)
    for j in range(order):
        reflection[j] = ar[j]
    loss = 1.0
    for stage in range(order - 1, -1, -1):
        k = reflection[stage]
        complement = (1.0 - k) * (1.0 + k)
        if not complement > 0.0:
            return np.inf
        loss *= (1.0 + abs(k)) / (1.0 - abs(k))
        scale = 1.0 / complement
        for j in range(stage // 2):
            left, right = reflection[j], reflection[stage - 1 - j]
            reflection[j] = (left - k * right) * scale
            reflection[stage - 1 - j] = (right - k * left) * scale
        if stage % 2 == 1:
            reflection[stage // 2] /= 1.0 + k
    return loss


@kernel("void(f8[:, ::1], f8[:, ::1])")
def ar_to_reflection_each_into(ar: FloatArray, reflection: FloatArray) -> None:
    """Do `ar_to_reflection_into` for every row (n, m); NaN for a filter that is not stable."""
    for row in range(len(ar)):
        if ar_to_reflection_into(ar[row], reflection[row]) == np.inf:
            reflection[row, :] = np.nan


_TRUSTED: Final = 1e10
"""Largest loss of accuracy through the polynomial's coefficients for which they are used: the
reflection coefficients are then right to 1e-5 of their distance from one."""


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1])")
def lsf_to_lattice_into(
    lsf: FloatArray, reflection: FloatArray, complement: FloatArray, work: FloatArray
) -> None:
    """Write k and ``sqrt(1 - k^2)``, both (m,), of the stages of a filter with frequencies (m,).

    These ascend strictly within (0, pi), which is not checked. It uses the polynomial's
    coefficients if these are accurate enough, else it converts directly, which takes some ten times
    longer. `work` holds 5 (m // 2 + 2) numbers or more.
    """
    order = len(lsf)
    lsf_to_ar_into(lsf, complement, work)
    if not ar_to_reflection_into(complement, reflection) <= _TRUSTED:
        lsf_to_reflection_into(lsf, reflection, work)
    for i in range(order):
        complement[i] = math.sqrt((1.0 - reflection[i]) * (1.0 + reflection[i]))


@kernel("f8(f8[::1], f8[::1], f8[::1], i8, f8)", inner=True)
def lattice_step(
    reflection: FloatArray,
    complement: FloatArray,
    past: FloatArray,
    order: int,
    excitation: float,
) -> float:
    """Return the next output for an excitation; both have variance one.

    Parameters
    ----------
    reflection, complement : (order,) or longer
        Reflection coefficients of the stages and their complements; they may differ from those
        of the last call.
    past : (order,) or longer
        The memory: the backward errors of orders 0 ... order-1. In the stationary state, the
        best one to start in, they are independent and of variance one.
    order
        Order of this filter, at least 1; it too may differ from the last one.
    excitation
        A sample of white noise.
    """
    before = past[order - 1]
    forward = complement[order - 1] * excitation - reflection[order - 1] * before
    for j in range(order - 2, -1, -1):
        before = past[j]
        past[j + 1] = reflection[j] * forward + complement[j] * before
        forward = complement[j] * forward - reflection[j] * before
    past[0] = forward
    return float(forward)
