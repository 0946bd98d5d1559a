"""Whether the evidence for a change holds with some of the blocks left out.

The Bayes factor is exact for the model assumed, and no model is: an alarm must not rest on what it
knows least.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.posterior import SurfacePosterior

VISIT: Final = 8
"""Blocks just before a change without which the evidence must hold."""

LEARNED: Final = 20
"""Blocks that a surface must have been learned from before any can be done without."""

_SAME_HEADING: Final = math.cos(math.radians(30.0))


class RobustnessCheck:
    """The evidence that the tool has been on another surface in the last blocks.

    Parameters
    ----------
    blocks
        The newest ones, oldest first.
    since
        How many of them are taken to be of the other surface.
    current, other
        What is known of either.
    """

    def __init__(
        self,
        blocks: Sequence[SurfaceBlock],
        since: int,
        current: SurfacePosterior,
        other: SurfacePosterior,
    ) -> None:
        self._blocks = blocks
        self._first = len(blocks) - since
        self._current = current
        self._other = other

    def above(self, threshold: float, *, at_any_heading: bool) -> bool:
        """Say whether it is above a threshold, whatever may be left out.

        Parameters
        ----------
        threshold
            As a natural logarithm.
        at_any_heading
            Whether blocks count at headings at which the current surface was never touched.
        """
        return (
            all(self._evidence(kept) > threshold for kept in self._without_one())
            and (self._current.blocks < LEARNED or self._without_a_visit() > threshold)
            and (at_any_heading or self._at_known_headings(threshold))
        )

    def _without_one(self) -> list[BoolArray]:
        """Leave out each block of the other surface in turn, for a knock is no surface."""
        places = np.arange(len(self._blocks))
        return [places != left_out for left_out in places[self._first :]]

    def _without_a_visit(self) -> float:
        """Leave out what was heard just before.

        That may have been a short visit to another surface, which was not found: what is heard
        behind it is the current one again, though not what the visit makes one expect.
        """
        kept = np.ones(len(self._blocks), dtype=np.bool_)
        kept[max(self._first - VISIT, 0) : self._first] = False
        return self._evidence(kept)

    def _at_known_headings(self, threshold: float) -> bool:
        """Say whether it holds without blocks at headings not touched before.

        A texture may be rough along one heading and smooth along another, and one that was touched
        along the former alone does not tell.
        """
        inputs = np.array([block.inputs for block in self._blocks])
        if inputs.shape[1] < 4:
            return True
        before = np.concatenate([self._current.headings, inputs[: self._first, 2:]])
        kept = np.ones(len(inputs), dtype=np.bool_)
        cosines = np.abs(inputs[self._first :, 2:] @ before.T)
        kept[self._first :] = cosines.max(axis=1, initial=0.0) > _SAME_HEADING
        return bool(kept[self._first :].any()) and self._evidence(kept) > threshold

    def _evidence(self, kept: BoolArray) -> float:
        """Return the evidence from some of the blocks."""
        blocks = [block for block, keep in zip(self._blocks, kept, strict=True) if keep]
        after = int(kept[self._first :].sum())
        settings = self._current.settings
        there = self._other.log_likelihood(PreparedBlocks.of(blocks[-after:], settings))[-1]
        stayed = self._current.log_likelihood_after(PreparedBlocks.of(blocks, settings))
        return float(there - stayed[-after])
