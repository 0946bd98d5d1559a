"""Sums of a surface's blocks, for the field of its level."""

from typing import Final

import numpy as np

from mmt.texture.field.blocks import BlockCutter, Blocks
from mmt.texture.field.cells import FieldCells
from mmt.texture.settings import ModellingSettings

WITHDRAWN_S: Final = 10.0
"""Least time for which blocks are kept singly, as they may prove to be of another surface: longer
than the detection of a change takes."""


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
        return FieldCells.from_blocks(blocks.points, blocks.power, blocks.number)
