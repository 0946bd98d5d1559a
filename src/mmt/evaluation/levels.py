"""Errors of level over many points, as a whole and by bands of frequency."""

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.metrics import power_error_db

LARGEST_ERROR_DB: Final = 60.0
"""Errors are limited to this, so that one silent point does not make a mean infinite."""

WORST: Final = 5
"""Sessions whose mean stands for the worst that may happen."""

LEAST_POWER: Final = 1e-4
"""Power that smaller ones count as, (m/s2)^2: 0.01 m/s2 rms, less than a hand feels or an
accelerometer measures. Two such are alike, however many dB are between them."""

LEAST_DENSITY: Final = LEAST_POWER / 500.0
"""The same of densities, (m/s2)^2 per hertz: so much power, evenly over 0 to 500 Hz."""

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
    """Return the error of a model's power at inputs (k, d) against `power` (k,), in dB."""
    return power_level_error_db(output_power_at(model, inputs), power)


def power_level_error_db(power: FloatArray, reference: FloatArray) -> FloatArray:
    """Return 10 log10 of powers over their reference, (k,), bounded, none below `LEAST_POWER`."""
    return bounded_error_db(np.maximum(power, LEAST_POWER), np.maximum(reference, LEAST_POWER))


def bounded_error_db(values: FloatArray, reference: FloatArray) -> FloatArray:
    """Return 10 log10 of powers or densities over their reference, of any shape, bounded."""
    return np.clip(power_error_db(values, reference), -LARGEST_ERROR_DB, LARGEST_ERROR_DB)


class Across(NamedTuple):
    """One figure across sessions.

    ``worst`` is the mean of the `WORST` worst ones, ``below_half`` how many are below 0.5.
    """

    sessions: int
    median: float
    mean: float
    worst: float
    below_half: int


def across(values: Iterable[float], *, larger_is_better: bool = True) -> Across:
    """Gather one figure across sessions, at least one."""
    ordered = np.sort(np.fromiter(values, np.float64))
    worst = ordered[:WORST] if larger_is_better else ordered[-WORST:]
    return Across(
        len(ordered),
        float(np.median(ordered)),
        float(ordered.mean()),
        float(worst.mean()),
        int(np.count_nonzero(ordered < 0.5)),
    )


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
