"""Errors of level over many points."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.metrics import power_error_db

LARGEST_ERROR_DB: Final = 60.0
"""Errors count as no larger, so that one silent point does not make a mean infinite."""


def output_power_at(model: TextureModel, inputs: FloatArray) -> FloatArray:
    """Return the exact power of what a model renders at inputs (k, d), shape (k,), (m/s2)^2."""
    lsf, variance = model.at(*inputs.T)
    return output_power(variance, lsf_to_reflection(lsf))


def level_error_db(model: TextureModel, inputs: FloatArray, power: FloatArray) -> FloatArray:
    """Return the error of a model's power at inputs (k, d) against `power` (k,), bounded, in dB."""
    return bounded_error_db(output_power_at(model, inputs), power)


def bounded_error_db(values: FloatArray, reference: FloatArray) -> FloatArray:
    """Return 10 log10 of powers or densities over their reference, of any shape, bounded."""
    return np.clip(power_error_db(values, reference), -LARGEST_ERROR_DB, LARGEST_ERROR_DB)


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
