"""Gathering what is felt of a surface in blocks, for the field of its level."""

from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from mmt.texture.field.blocks import BlockCutter, Blocks
from mmt.texture.field.cells import FieldCells
from mmt.texture.online.work import Work
from mmt.texture.segmentation.segments import SampleRange
from mmt.texture.settings import ModellingSettings

WITHDRAWN_S: Final = 10.0
"""Blocks of so long at least are kept singly: they may prove to be of another surface, or lie in a
segment that is held out. Longer than a segment and the detection of a change take."""


class _Step(NamedTuple):
    """What an update does: new blocks, ranges of samples and the first sample to withdraw."""

    blocks: Blocks
    held_out: tuple[SampleRange, ...]
    forget_from: int | None


class Gathering:
    """Sum the blocks of a stream, less what is withdrawn.

    Parameters
    ----------
    settings
        Settings of the modelling.
    deferred
        Whether the sums of an update may be asked for later: every step is kept then, and carried
        out again; who asks in the order of the stream pays for each once.
    """

    def __init__(self, settings: ModellingSettings, *, deferred: bool = False) -> None:
        self._cutter = BlockCutter(settings)
        kept_samples = round(WITHDRAWN_S * settings.rate_hz)
        self._new = partial(_Sums, self._cutter.cut([]), self._cutter.length, kept_samples)
        self._sums = self._new()
        self._steps: list[_Step] | None = [] if deferred else None
        self._done, self._again = 0, self._new()

    def add(self, work: Work) -> bool:
        """Add what an update has observed; return whether that changes anything."""
        step = _Step(self._cutter.cut(work.observed), tuple(work.held_out), work.forget_from)
        if self._steps is not None:
            self._steps.append(step)
        return self._sums.add(step)

    def cells(self) -> Callable[[], FieldCells]:
        """Return what gives the sums of all blocks up to now: at once, or if deferred whenever."""
        if self._steps is None:
            return self._sums.cells
        return partial(self._after, self._steps, len(self._steps))

    def _after(self, steps: list[_Step], count: int) -> FieldCells:
        """Return the sums after the first steps."""
        if count < self._done:
            self._done, self._again = 0, self._new()
        for step in steps[self._done : count]:
            self._again.add(step)
        self._done = count
        return self._again.cells()


class _Sums:
    """Sums of blocks of some samples each, without those of the last ones that were withdrawn."""

    def __init__(self, none: Blocks, length: int, kept_samples: int) -> None:
        self._recent = none
        self._settled = self._cells(none)
        self._length, self._kept_samples = length, kept_samples

    def add(self, step: _Step) -> bool:
        """Add blocks, withdraw others; return whether that changes anything."""
        before = self._recent.start
        recent = Blocks.concatenate([self._recent, step.blocks])
        gone = np.zeros(len(recent.start), np.bool_)
        stop = recent.start + self._length
        for first, last in step.held_out:
            gone |= (recent.start < last) & (stop > first)
        if step.forget_from is not None:
            gone |= stop > step.forget_from
        self._recent = recent[~gone]
        changed = not np.array_equal(self._recent.start, before)
        self._settle()
        return changed

    def _settle(self) -> None:
        """Sum old blocks for good; seldom, since that touches every row of the sums."""
        start = self._recent.start
        if len(start) and start[-1] - start[0] > 2 * self._kept_samples:
            old = start < start[-1] - self._kept_samples
            self._settled = self._settled.joined(self._cells(self._recent[old]))
            self._recent = self._recent[~old]

    def cells(self) -> FieldCells:
        """Return the sums of all blocks."""
        return self._settled.joined(self._cells(self._recent))

    def _cells(self, blocks: Blocks) -> FieldCells:
        return FieldCells.of(blocks.points, blocks.power, blocks.number)
