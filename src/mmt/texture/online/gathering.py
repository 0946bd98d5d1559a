"""Gathering what is felt of a surface in blocks, for the field of its level."""

from typing import Final

import numpy as np

from mmt.texture.field.blocks import BlockCutter, Blocks
from mmt.texture.field.cells import FieldCells
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.work import Work
from mmt.texture.settings import ModellingSettings

WITHDRAWN_S: Final = 10.0
"""Blocks of the last seconds are kept singly: they may prove to be of another surface, or lie in a
segment that is held out. Longer than a segment and the detection of a change take."""


class Gathering:
    """Sum the blocks of a stream, less what is withdrawn.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        space = InputSpace(settings.inputs)
        self._cutter = BlockCutter(
            space,
            settings.least_speed_mm_s,
            settings.least_force_n,
            settings.rate_hz,
            settings.normal,
        )
        self._kept_samples = round(WITHDRAWN_S * settings.rate_hz)
        self._settled = FieldCells.empty(directed=space.directed)
        self._recent = self._cutter.cut([])

    def add(self, work: Work) -> bool:
        """Add what an update has observed; return whether that changes anything."""
        before = self._recent.start
        self._recent = self._recent.joined(self._cutter.cut(work.observed))
        self._withdraw(work)
        changed = not np.array_equal(self._recent.start, before)
        if len(self._recent.start):
            old = self._recent.start < self._recent.start[-1] - self._kept_samples
            self._settled = self._settled.joined(_sums(self._recent.kept(old)))
            self._recent = self._recent.kept(~old)
        return changed

    def cells(self) -> FieldCells:
        """Return the sums of all blocks."""
        return self._settled.joined(_sums(self._recent))

    def _withdraw(self, work: Work) -> None:
        start = self._recent.start
        stop = start + self._cutter.length
        gone = np.zeros(len(start), np.bool_)
        for first, last in work.held_out:
            gone |= (start < last) & (stop > first)
        if work.forget_from is not None:
            gone |= stop > work.forget_from
        self._recent = self._recent.kept(~gone)


def _sums(blocks: Blocks) -> FieldCells:
    return FieldCells.of(blocks.points, blocks.power, blocks.position_mm)
