"""Errors of a spectrum by bands, as wide as what is felt apart."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.levels import bounded_error_db

BANDS: Final = 9

BAND_EDGES_HZ: Final[FloatArray] = np.geomspace(10.0, 500.0, BANDS + 1)
"""Nine bands of equal ratio, 0.63 octaves each. How wide critical bands of touch are is not
settled; that they widen with the frequency, and that nine of them cover what is rendered, is
taken over, that their ratio is the same everywhere is our choice."""


def band_membership(frequencies_hz: FloatArray) -> FloatArray:
    """Return which band each frequency belongs to, shape (f, 9); none below 10 Hz."""
    place = np.searchsorted(BAND_EDGES_HZ, frequencies_hz, side="right") - 1
    place = np.where(frequencies_hz >= BAND_EDGES_HZ[-1], BANDS - 1, place)
    member: FloatArray = (place[:, None] == np.arange(BANDS)).astype(np.float64)
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
