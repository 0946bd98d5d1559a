"""Robustness of the evidence for a change when some of the blocks are left out.

The Bayes factor is exact only for the model assumed: a detection must not rest on the blocks that
the model describes worst.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.posterior import SurfacePosterior

LAST_BLOCKS: Final = 8
"""Number of blocks just before a change without which the evidence must hold."""

LEARNED: Final = 20
"""Least number of learned blocks of a surface before blocks are left out."""

_SAME_HEADING: Final = math.cos(math.radians(30.0))


class RobustnessCheck:
    """Check of the evidence that the tool has been on another surface in the last blocks.

    Parameters
    ----------
    blocks
        The newest blocks, oldest first.
    since
        Number of last blocks assumed to be of the other surface.
    current, other
        Posteriors of both surfaces.
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
        """Return whether the evidence exceeds a threshold under every check.

        Parameters
        ----------
        threshold
            Evidence, as a natural logarithm.
        at_any_heading
            Whether blocks at headings new to the current surface are included.
        """
        return (
            all(self._evidence(kept) > threshold for kept in self._without_one())
            and (self._current.blocks < LEARNED or self._without_last_blocks() > threshold)
            and (at_any_heading or self._at_known_headings(threshold))
        )

    def _without_one(self) -> list[BoolArray]:
        """Leave out each block of the other surface in turn: one knock is no surface."""
        places = np.arange(len(self._blocks))
        return [places != left_out for left_out in places[self._first :]]

    def _without_last_blocks(self) -> float:
        """Return the evidence without the blocks just before the change.

        These may be an undetected short contact with another surface, after which the current one
        looks different from what those blocks predict.
        """
        kept = np.ones(len(self._blocks), dtype=np.bool_)
        kept[max(self._first - LAST_BLOCKS, 0) : self._first] = False
        return self._evidence(kept)

    def _at_known_headings(self, threshold: float) -> bool:
        """Return whether the evidence holds without blocks at headings not touched before.

        A texture may be rough along one heading and smooth along another, so contact along one does
        not determine the other.
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
