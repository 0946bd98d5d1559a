"""Blocks of a twentieth of a second in contact: cut from a stream, and summed for the level.

A block is kept if the tool strokes during all of it and already pressed before it, as the knock of
a touch-down is not the texture's. A block in which speed or force changes by more than a factor of
two is left out, as its power belongs to no single stroke.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.field.cells import FieldCells
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, Columns
from mmt.texture.space import InputSpace

BLOCK_S: Final = 0.05
_LARGEST_CHANGE: Final = 2.0

WITHDRAWN_S: Final = 10.0
"""Least time for which blocks are kept singly, as they may prove to be of another surface: longer
than the detection of a change takes."""


@dataclass(frozen=True, eq=False)
class Blocks(Columns):
    """n blocks: first sample (n,), points (n, d), powers (n,).

    With a measure of c features, ``power`` holds these, (n, c).
    """

    start: IntArray
    points: FloatArray
    power: FloatArray


def mean_square(vibration_m_s2: FloatArray, measured: BoolArray) -> FloatArray:
    """Return the power of n blocks of m samples, (n, m, axes), in (m/s2)^2, (n,).

    Only `measured` samples (n, m) count; the power of a block without any is NaN.
    """
    square = np.square(vibration_m_s2).sum(axis=2)
    with np.errstate(invalid="ignore"):
        return np.asarray((square * measured).sum(axis=1) / measured.sum(axis=1))


class BlockCutter:
    """Cut a stream into blocks, part by part; the partition does not change the blocks.

    Parameters
    ----------
    settings
        Inputs of the model, rate of the stream, and least speed and force of samples in a block.
    measure
        Returns the powers (n,), or features (n, c), of n blocks of m samples, given the vibration
        (n, m, axes) and which samples are measured (n, m). A block is left out if a result is not
        finite, or if less than half of it is measured.
    """

    def __init__(
        self,
        settings: ModellingSettings,
        measure: Callable[[FloatArray, BoolArray], FloatArray] = mean_square,
    ) -> None:
        self._space = InputSpace(settings.inputs)
        self._measure, self._settings = measure, settings
        self.length = max(1, round(BLOCK_S * settings.rate_hz))
        self._rest = AlignedBlock.empty()
        self._pressed_until = -1

    def cut(self, parts: Iterable[AlignedBlock]) -> Blocks:
        """Add the next parts of the stream, and return the blocks that they complete."""
        parts = [part for part in (self._rest, *parts) if len(part)]
        if not parts:
            return self._blocks(AlignedBlock.empty())
        joined = AlignedBlock.concatenate(parts)
        open_from = joined.index[-1] + 1 - (joined.index[-1] + 1) % self.length
        whole = int(np.searchsorted(joined.index, open_from))
        self._rest = joined[whole:]
        return self._blocks(joined[:whole])

    def _blocks(self, part: AlignedBlock) -> Blocks:
        length, settings = self.length, self._settings
        starts = np.flatnonzero(part.index % length == 0)
        starts = starts[starts + length <= len(part)]
        starts = starts[part.index[starts + length - 1] - part.index[starts] == length - 1]
        rows = starts[:, None] + np.arange(length)
        first = part.index[starts]
        speed, force = part.speed_mm_s[rows], part.normal_force_n[rows]
        pressed = (force >= 0.5 * settings.least_force_n).all(axis=1)
        before = np.concatenate([[self._pressed_until], np.where(pressed, first + length, -1)])
        used = pressed & (before[:-1] == first) & part.valid[rows].all(axis=1)
        if len(before) > 1:
            self._pressed_until = int(before[-1])
        for values, least in ((speed, settings.least_speed_mm_s), (force, settings.least_force_n)):
            low, high = values.min(axis=1), values.max(axis=1)
            used &= (low >= least) & (high <= _LARGEST_CHANGE * low)
        measured = part.measured[rows]
        used &= 2 * measured.sum(axis=1) >= length
        _, per_frame, axes = part.vibration_m_s2.shape
        vibration = part.vibration_m_s2[rows].reshape(-1, length * per_frame, axes)
        power = self._measure(vibration, np.repeat(measured, per_frame, axis=1))
        used &= np.isfinite(power).all(axis=tuple(range(1, power.ndim)))
        velocity = part.velocity_mm_s[rows].mean(axis=1)
        mean = (
            (*velocity.T, force.mean(axis=1))
            if self._space.directed
            else (speed.mean(axis=1), force.mean(axis=1))
        )
        points = self._space.normalise(self._space.stack(*mean))
        return Blocks(first, points, power)[used]


class BlockSums:
    """Sums of blocks, of which the most recent can be withdrawn.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        cutter = BlockCutter(settings)
        self._length = cutter.length
        self._kept_samples = round(WITHDRAWN_S * settings.rate_hz)
        self._recent = cutter.cut([])
        self._settled = self._cells(self._recent)

    def add(self, blocks: Blocks, forget_from: int | None = None) -> bool:
        """Add blocks, withdraw those that reach beyond a sample; return whether any changed."""
        before = self._recent.start
        recent = Blocks.concatenate([self._recent, blocks])
        if forget_from is not None:
            recent = recent[recent.start + self._length <= forget_from]
        self._recent = recent
        changed = not np.array_equal(self._recent.start, before)
        self._settle()
        return changed

    def _settle(self) -> None:
        """Sum old blocks permanently; done rarely, since it touches every row of the sums."""
        start = self._recent.start
        if len(start) and start[-1] - start[0] > 2 * self._kept_samples:
            old = start < start[-1] - self._kept_samples
            self._settled = self._settled.joined(self._cells(self._recent[old]))
            self._recent = self._recent[~old]

    def cells(self) -> FieldCells:
        """Return the sums of all blocks."""
        return self._settled.joined(self._cells(self._recent))

    def _cells(self, blocks: Blocks) -> FieldCells:
        return FieldCells.from_blocks(blocks.points, blocks.power, blocks.start // self._length)
