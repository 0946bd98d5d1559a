"""Spectrum of a short block in a few numbers: its level, its tilt and coarser to finer features.

A block's spectrum is estimated with sine tapers (Riedel and Sidorenko, "Minimum bias multiple taper
spectral estimation", IEEE Trans. Signal Processing 43(1), 1995) and added up in eight bands of
60 Hz from 10 to 490 Hz. The logarithms of the powers are close to normal, with a spread that does
not depend on the level. An orthogonal cosine transform turns them into their mean, the *level*,
their *tilt*, and ever finer features of the *shape*, of which the first `COMPONENTS` are kept: the
finer ones are mostly scatter in so short a time.
"""

from typing import Final

import numpy as np
from scipy.fft import dct

from mmt.core.arrays import FloatArray

COMPONENTS: Final = 6
"""Number of components of a block's spectrum."""

_BANDS: Final = 8
_TAPERS: Final = 3
_BINS: Final = 3
"""Frequencies of a band: a block of a twentieth of a second resolves 20 Hz."""

_LEAST_POWER: Final = 1e-12
"""Least power in (m/s2)^2: a stuck sensor measures none at all."""


def spectrum_components(vibration_m_s2: FloatArray) -> FloatArray:
    """Return the components of blocks' spectra, (n, `COMPONENTS`), in nepers of power.

    Parameters
    ----------
    vibration_m_s2
        Shape (n, m, axes): n blocks of `mmt.texture.field.blocks.BLOCK_S`, at 1 kHz or more. The
        powers of several axes are added.
    """
    samples = vibration_m_s2.shape[1]
    turns = np.outer(np.arange(1, _TAPERS + 1), np.arange(1, samples + 1)) / (samples + 1)
    tapers = np.sqrt(2.0 / (samples + 1)) * np.sin(np.pi * turns)
    spectra = np.fft.rfft(tapers[:, :, None] * vibration_m_s2[:, None], axis=2)
    chosen = spectra[:, :, 1 : 1 + _BANDS * _BINS]
    density = (chosen.real**2 + chosen.imag**2).sum(axis=3).mean(axis=1)
    power = 2.0 / samples * density.reshape(-1, _BANDS, _BINS).sum(axis=2)
    logarithm = np.log(np.maximum(power, _LEAST_POWER))
    return np.asarray(dct(logarithm, norm="ortho")[:, :COMPONENTS] / np.sqrt(_BANDS))
