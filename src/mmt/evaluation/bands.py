"""Errors of a spectrum by bands, as wide as what is felt apart."""

from typing import Final

import numpy as np

from mmt.arrays import FloatArray
from mmt.evaluation.levels import bounded_error_db

BANDS: Final = 9

BAND_EDGES_HZ: Final[FloatArray] = np.geomspace(10.0, 500.0, BANDS + 1)
"""Nine bands of equal ratio, 0.63 octaves each. How wide critical bands of touch are is not
settled; that they widen with the frequency, and that nine of them cover what is rendered, is
taken over, that their ratio is the same everywhere is our choice."""


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
    place = np.searchsorted(BAND_EDGES_HZ, frequencies_hz, side="right") - 1
    member = np.clip(place, 0, BANDS - 1)[:, None] == np.arange(BANDS)
    weights = member.astype(np.float64)
    return bounded_error_db(density @ weights, reference @ weights)
