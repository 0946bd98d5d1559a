"""Blocks of a twentieth of a second in contact, by which surfaces are told apart.

The stream is cut by `mmt.texture.field.blocks`. Each block has its sample numbers, its stroke, the
components of its spectrum (`mmt.texture.surfaces.bands`) minus their prior means, and the start of
its contact.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.field import blocks as field_blocks
from mmt.texture.field.blocks import mean_square
from mmt.texture.field.covariance import coordinates
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.noise_floor import NoiseFloor
from mmt.texture.surfaces.bands import spectrum_components
from mmt.texture.surfaces.regression import MEANS

AUDIBLE: Final = 4.0
"""Least ratio of a block's power to the sensor's noise. In noise all surfaces are alike, and close
to it the spectrum of a texture changes faster than anywhere else."""


@dataclass(frozen=True, eq=False)
class SurfaceBlock:
    """Features of one block.

    ``start`` and ``stop`` are absolute sample numbers, half-open. ``stroke`` (3,): u, v and heading
    as in `mmt.texture.field.covariance`. ``values`` (`bands.COMPONENTS`,): components of the
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
