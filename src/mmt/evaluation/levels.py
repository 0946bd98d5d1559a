"""Errors of level over many points, as a whole and by bands of frequency."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.metrics import power_error_db

LARGEST_ERROR_DB: Final = 60.0
"""Errors are limited to this, so that one silent point does not make a mean infinite."""

BANDS: Final = 9

BAND_EDGES_HZ: Final[FloatArray] = np.geomspace(10.0, 500.0, BANDS + 1)
"""Nine bands of equal ratio, 0.63 octaves each. The width of the critical bands of touch is not
settled; that they widen with frequency, and that nine cover the rendered range, is from the
literature, the equal ratio is our choice."""


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


def band_membership(frequencies_hz: FloatArray) -> FloatArray:
    """Return which band each frequency belongs to, shape (f, 9); none below 10 Hz."""
    band = np.searchsorted(BAND_EDGES_HZ, frequencies_hz, side="right") - 1
    band = np.where(frequencies_hz >= BAND_EDGES_HZ[-1], BANDS - 1, band)
    member: FloatArray = (band[:, None] == np.arange(BANDS)).astype(np.float64)
    return member


def band_errors_db(
    density: FloatArray, reference: FloatArray, frequencies_hz: FloatArray
) -> FloatArray:
    """Return 10 log10 of the power in each band over that of the reference, shape (k, 9).

    Parameters
    ----------
    density, reference
        Power spectral densities, shape (k, f).
    frequencies_hz
        Evenly spaced from 10 to 500 Hz, shape (f,).
    """
    weights = band_membership(frequencies_hz)
    return bounded_error_db(density @ weights, reference @ weights)
