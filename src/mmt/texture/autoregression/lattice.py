"""The normalised lattice: an all-pole filter that stays bounded while it changes.

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

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.lsf import ar_to_reflection_into, lsf_to_ar_into
from mmt.texture.autoregression.split import lsf_to_reflection_into

_TRUSTED: Final = 1e10
"""Largest loss of accuracy through the polynomial's coefficients for which they are used: the
reflection coefficients are then right to 1e-5 of their distance from one."""


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1])")
def lsf_to_lattice_into(
    lsf: FloatArray, reflection: FloatArray, complement: FloatArray, work: FloatArray
) -> None:
    """Write the sines and cosines of the stages of a filter with these frequencies.

    It uses the polynomial's coefficients if these are accurate enough, else it converts directly,
    which takes some ten times longer.

    Parameters
    ----------
    lsf : (m,)
        Strictly ascending within (0, pi), not checked.
    reflection, complement : (m,)
        Receive k and ``sqrt(1 - k^2)`` of each stage.
    work : (5 * (m // 2 + 2),) or longer
        Scratch.
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
