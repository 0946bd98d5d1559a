"""Concealment of gaps: continues a vibration until samples come again.

An autoregressive model is fitted to the newest samples (Burg), and its normalised lattice
continues from the state in which these samples leave it. The predictable part of the next samples
is predicted, the rest is white noise at the level of the newest prediction errors. So the joint
has no step but the excitation's own, and the spectrum stays that of the surface. Janssen,
Veldhuis and Vries, "Adaptive interpolation of discrete-time signals that can be modeled as
autoregressive processes", IEEE Trans. ASSP 34 (1986), 317-330, treat the case in which the
samples after the gap are known too.

Stability: whatever the past, no sample exceeds its largest magnitude, and no step its largest
step or a sixteenth of that magnitude. Where the gain is zero, the output is exactly zero after
16 samples at most. Cost: one fit, and 4 multiplications an order and sample; about 10 us for
100 samples of order 16.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression import Order
from mmt.texture.autoregression.burg import burg_into, largest_magnitude
from mmt.texture.autoregression.lsf import lattice_step

ORDER: Final = 16
_LEVEL_SAMPLES: Final = 32
"""Number of newest prediction errors that set the excitation's level: few, as the level follows
the hand's speed faster than a spectrum can be fitted."""

_STEEPEST: Final = 1.0 / 16.0


def continuation(
    past: FloatArray, gain: FloatArray, noise: FloatArray, order: int = ORDER
) -> FloatArray:
    """Return a plausible continuation (n,) of a vibration, in its unit.

    Parameters
    ----------
    past : (k,)
        The newest samples, the last one newest; k at least ``order + 32``.
    gain : (n,)
        Gain of each sample, from 0 to 1.
    noise : (n,)
        Standard normal numbers, the excitation.
    order
        Order of the model, from 1 to 64.

    Raises
    ------
    InputError
        A value is not finite, the order is out of range, or a shape does not fit.
    """
    samples, gains, excitation = (
        np.ascontiguousarray(values, dtype=np.float64) for values in (past, gain, noise)
    )
    check("order", order, Order)
    if samples.ndim != 1 or len(samples) < order + _LEVEL_SAMPLES:
        raise InputError(
            f"past has shape {samples.shape}: order {order} needs one row of at least"
            f" {order + _LEVEL_SAMPLES} samples"
        )
    if gains.ndim != 1 or gains.shape != excitation.shape:
        raise InputError(f"gain {gains.shape} and noise {excitation.shape}: one row each is needed")
    if not all(np.isfinite(values).all() for values in (samples, gains, excitation)):
        raise InputError("past, gain or noise has a value that is not finite")
    output = np.empty(len(gains))
    _continue(samples, gains, excitation, order, output)
    return output


@kernel("void(f8[::1], f8[::1], f8[::1])")
def _follow(reflection: FloatArray, errors: FloatArray, backward: FloatArray) -> None:
    """Replace samples (k,) by their forward errors of the full order.

    `backward` (m,) receives the backward errors of orders 0 ... m-1 at the last sample. Both
    are right from the m-th sample on; before it, earlier samples are missing.
    """
    order = len(reflection)
    backward[:] = 0.0
    for i in range(len(errors)):
        forward = errors[i]
        entering = forward
        for j in range(order):
            before = backward[j]
            backward[j] = entering
            entering = before + reflection[j] * forward
            forward += reflection[j] * before
        errors[i] = forward


@kernel("void(f8[::1], f8[::1], f8[::1], i8, f8[::1])")
def _continue(
    past: FloatArray, gain: FloatArray, noise: FloatArray, order: int, output: FloatArray
) -> None:
    """Write the continuation (n,)."""
    peak = largest_magnitude(past)
    count = len(past)
    exponent = math.frexp(peak)[1]
    scaled = np.empty(count)
    for i in range(count):
        scaled[i] = math.ldexp(past[i], -exponent)
    reflection, variances = np.empty(order), np.empty(order + 1)
    burg_into(scaled, reflection, variances, np.empty(2 * count))
    errors = scaled[count - order - _LEVEL_SAMPLES :].copy()
    memory, complement = np.empty(order), np.empty(order)
    _follow(reflection, errors, memory)
    level = 0.0
    for error in errors[order:]:
        level += error * error / _LEVEL_SAMPLES
    for j in range(order):
        complement[j] = math.sqrt((1.0 - reflection[j]) * (1.0 + reflection[j]))
        memory[j] = memory[j] / math.sqrt(variances[j]) if variances[j] > 0.0 else 0.0
    excitation = math.sqrt(level / variances[order]) if variances[order] > 0.0 else 0.0
    amplitude = math.sqrt(variances[0])
    peak = math.ldexp(peak, -exponent)
    steepest = _STEEPEST * peak
    for i in range(1, count):  # np.diff takes the compiler two seconds
        steepest = max(steepest, abs(scaled[i] - scaled[i - 1]))
    last = scaled[-1]
    for i in range(len(output)):
        value = amplitude * lattice_step(
            reflection, complement, memory, order, excitation * noise[i]
        )
        value = gain[i] * min(max(value, -peak), peak)
        last = min(max(value, last - steepest), last + steepest)
        output[i] = math.ldexp(last, exponent)
