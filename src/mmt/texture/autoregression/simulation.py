"""Simulation of autoregressive models, stationary from the first sample."""

import math

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.forms import output_power
from mmt.texture.autoregression.lattice import lattice_step


@kernel("void(f8[::1], f8[::1], f8[::1])")
def _simulate_into(reflection: FloatArray, noise: FloatArray, output: FloatArray) -> None:
    """Write a signal (n,) of variance one from standard normal noise (m + n,).

    The memory's stationary state is drawn first, so that no transient is left.
    """
    order = len(reflection)
    past, complement = noise[:order].copy(), np.empty(order)
    for j in range(order):
        complement[j] = math.sqrt((1.0 - reflection[j]) * (1.0 + reflection[j]))
    for i in range(len(output)):
        output[i] = lattice_step(reflection, complement, past, order, noise[order + i])


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
    k = np.ascontiguousarray(reflection, dtype=np.float64)
    output = np.empty(samples)
    _simulate_into(k, generator.standard_normal(len(k) + samples), output)
    return np.asarray(np.sqrt(output_power(variance, k)) * output)
