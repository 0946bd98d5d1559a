"""A picture of a texture, drawn from its model alone.

What a tool hears at a frequency f when it strokes at speed v comes from a wavelength of v/f along
the stroke. So the model's spectra at one speed and all headings, read as powers of spatial
frequencies, are the spectrum of a relief that would sound like this; a relief of random phases
with that spectrum is the picture. Its grain lies as the texture's does. It is no photograph.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.model.texture_model import TextureModel

SIZE: Final = 96
"""Pixels along each edge."""
_WIDTH_MM: Final = 24.0
_SPEED_MM_S: Final = 100.0
_FORCE_N: Final = 1.0
_HEADINGS: Final = 72
_LONGEST_MM: Final = 8.0


def picture(model: TextureModel, seed: int = 0) -> FloatArray:
    """Return a relief of zero mean and unit variance, shape (96, 96), y downwards.

    Parameters
    ----------
    model
        Of the texture.
    seed
        Of the phases.
    """
    per_mm = np.fft.fftfreq(SIZE, _WIDTH_MM / SIZE)
    across, down = np.meshgrid(per_mm, -per_mm)
    radius = np.hypot(across, down)
    powers = _powers(model, radius, np.arctan2(down, across))
    powers[radius < 1.0 / _LONGEST_MM] = 0.0
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((SIZE, SIZE)))
    relief = np.real(np.fft.ifft2(noise * np.sqrt(powers)))
    spread = float(relief.std())
    return np.asarray(relief / spread if spread > 0.0 else relief, dtype=np.float64)


def _powers(model: TextureModel, per_mm: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the powers of spatial frequencies (n, n) along headings (n, n)."""
    frequencies = np.linspace(0.0, model.rate_hz / 2.0, 257)
    angles = np.arange(_HEADINGS) * (2.0 * np.pi / _HEADINGS)
    motion = model.space.from_motion(
        _SPEED_MM_S * np.cos(angles), _SPEED_MM_S * np.sin(angles), _FORCE_N
    )
    spectra = model.spectrum(*motion.T, frequencies_hz=frequencies)
    # a relief looks the same from both sides, and a ring has more pixels the wider it is
    spectra = spectra + np.roll(spectra, _HEADINGS // 2, axis=0)
    row = np.round(heading / (2.0 * np.pi) * _HEADINGS).astype(int) % _HEADINGS
    column = per_mm * _SPEED_MM_S / (frequencies[1] - frequencies[0])
    inside = column < len(frequencies) - 1
    powers = spectra[row, np.where(inside, np.round(column), 0).astype(int)]
    return np.asarray(np.where(inside, powers, 0.0) / np.maximum(per_mm, 1e-9))
