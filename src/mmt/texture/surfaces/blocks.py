"""Blocks of a twentieth of a second in contact, by which surfaces are told apart.

The stream is cut by `mmt.texture.field.blocks`. Each block has its sample numbers, its stroke, the
components of its spectrum minus their prior means, and the start of its contact. The components are
the block's level, its tilt and coarser to finer features: its spectrum is estimated with sine
tapers (Riedel and Sidorenko, "Minimum bias multiple taper spectral estimation", IEEE Trans. Signal
Processing 43(1), 1995) and added up in eight bands of 60 Hz from 10 to 490 Hz. The logarithms of
the powers are close to normal, with a spread that does not depend on the level. An orthogonal
cosine transform turns them into their mean, the *level*, their *tilt*, and ever finer features of
the *shape*, of which the first `COMPONENTS` are kept: the finer ones are mostly scatter in so short
a time.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.fft import dct

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.field import blocks as field_blocks
from mmt.texture.field.blocks import mean_square
from mmt.texture.field.covariance import coordinates
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, NoiseFloor
from mmt.texture.surfaces.regression import MEANS

COMPONENTS: Final = 6
"""Number of components of a block's spectrum."""

_BANDS: Final = 8
_TAPERS: Final = 3
_BINS: Final = 3
"""Frequencies of a band: a block of a twentieth of a second resolves 20 Hz."""

_LEAST_POWER: Final = 1e-12
"""Least power in (m/s2)^2: a stuck sensor measures none at all."""

AUDIBLE: Final = 4.0
"""Least ratio of a block's power to the sensor's noise. In noise all surfaces are alike, and close
to it the spectrum of a texture changes faster than anywhere else."""


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


@dataclass(frozen=True, eq=False)
class SurfaceBlock:
    """Features of one block.

    ``start`` and ``stop`` are absolute sample numbers, half-open. ``stroke`` (3,): u, v and heading
    as in `mmt.texture.field.covariance`. ``values`` (`COMPONENTS`,): components of the
    spectrum less their prior means, in nepers of power.
    ``touchdown``: whether it is the first block after the tool met a surface. ``contact_start``:
    the sample number at which this contact began.
    """

    start: int
    stop: int
    stroke: FloatArray
    values: FloatArray
    touchdown: bool
    contact_start: int


class SurfaceBlockCutter:
    """Cut a stream of aligned samples into blocks, update by update.

    Parameters
    ----------
    modelling
        Settings of the modelling: axes, least speed and force, inputs.
    """

    def __init__(self, modelling: ModellingSettings) -> None:
        self._pressed_n = 0.5 * modelling.least_force_n
        self._cutter = field_blocks.BlockCutter(modelling, self._measure)
        self._noise = NoiseFloor()
        self._rest = AlignedBlock.empty()
        self._lifted = True
        self._contact_start = 0
        self._fresh = False

    def cut(self, aligned: AlignedBlock) -> list[SurfaceBlock]:
        """Add the next samples, any number of them, and return the blocks they complete.

        The partition of the stream does not change the blocks.
        """
        if not len(aligned):
            return []
        joined = AlignedBlock.concatenate([self._rest, aligned]) if len(self._rest) else aligned
        number = joined.index // self._cutter.length
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist()]
        if joined.index[-1] % self._cutter.length == self._cutter.length - 1:
            edges.append(len(joined))
        found: list[SurfaceBlock] = []
        for start, stop in pairwise(edges):
            found += self._cut(joined[start:stop])
        self._rest = joined[edges[-1] :]
        return found

    def _cut(self, part: AlignedBlock) -> list[SurfaceBlock]:
        """Return the block of samples of one block's time, if they hold one."""
        self._watch(part)
        blocks = self._cutter.cut([part])
        self._noise.update(part)
        if not len(blocks.start):
            return []
        touchdown, self._fresh = self._fresh, False
        start, at = int(blocks.start[0]), coordinates(blocks.points)
        values = blocks.power[0] - MEANS
        values[0] -= at.law[0]
        return [
            SurfaceBlock(
                start=start,
                stop=start + self._cutter.length,
                stroke=np.column_stack(at)[0],
                values=values,
                touchdown=touchdown,
                contact_start=self._contact_start,
            )
        ]

    def _measure(self, vibration_m_s2: FloatArray, measured: BoolArray) -> FloatArray:
        """Return the components of blocks' spectra, NaN for blocks of nothing but noise."""
        found = spectrum_components(vibration_m_s2)
        found[mean_square(vibration_m_s2, measured) < AUDIBLE * self._noise.power] = np.nan
        return found

    def _watch(self, part: AlignedBlock) -> None:
        """Record the beginning of a contact."""
        pressed = np.concatenate([[not self._lifted], part.normal_force_n > self._pressed_n])
        begun = np.flatnonzero(pressed[1:] & ~pressed[:-1])
        if len(begun):
            self._contact_start, self._fresh = int(part.index[begun[-1]]), True
        self._lifted = not bool(pressed[-1])
