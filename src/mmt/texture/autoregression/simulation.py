"""Simulation of autoregressive models, stationary from the first sample."""

import math

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel


@kernel("void(f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def simulate_ar_into(
    reflection: FloatArray,
    variance: float,
    noise: FloatArray,
    output: FloatArray,
    past: FloatArray,
) -> None:
    """Write one simulated signal (n,) from standard normal noise (m + n,).

    The all-pole lattice, stable for every ``|k| < 1`` where a direct form is not. In the
    stationary state the backward errors of orders 0 ... m-1 are independent and have the
    residual variances of their orders (Markel and Gray, "Linear prediction of speech",
    1976, ch. 5): drawing them so leaves no transient. `past` (m,) is scratch. Cost: 4 m
    operations a sample.
    """
    order = len(reflection)
    error_variance = variance
    for j in range(order - 1, -1, -1):
        error_variance /= (1.0 - reflection[j]) * (1.0 + reflection[j])
        past[j] = math.sqrt(error_variance) * noise[j]
    deviation = math.sqrt(variance)
    for i in range(len(output)):
        forward = deviation * noise[order + i]
        for j in range(order - 1, -1, -1):
            forward -= reflection[j] * past[j]
            if j + 1 < order:
                past[j + 1] = past[j] + reflection[j] * forward
        past[0] = forward
        output[i] = forward


def simulate_ar(
    reflection: FloatArray, variance: float, samples: int, generator: np.random.Generator
) -> FloatArray:
    """Draw a stationary Gaussian signal from an autoregressive model.

    Parameters
    ----------
    reflection : (m,)
        Reflection coefficients, each of magnitude below one.
    variance
        Variance of the excitation.
    samples
        Length n of the signal.
    generator
        Source of the excitation; m + n numbers are drawn.

    Returns
    -------
    (n,)
        In the unit of the standard deviation of the excitation.
    """
    output = np.empty(samples)
    noise = generator.standard_normal(len(reflection) + samples)
    simulate_ar_into(
        np.ascontiguousarray(reflection, dtype=np.float64),
        float(variance),
        noise,
        output,
        np.empty(len(reflection)),
    )
    return output
