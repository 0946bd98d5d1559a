"""The trial of a surface that was just found: it may turn out to be a known one.

Until that is settled the tool may be on a surface that nobody knows or on any of the known ones.
Each of these has the weight that the blocks of the trial leave it, half of it the former's before
any block, and what comes next is expected as their mixture expects it. So a surface of which a few
blocks are known is not left for what a known one, that it may well be, would have told.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.posterior import SurfacePosterior

LONGEST: Final = 60
"""Blocks for which a new surface may still turn out to be a known one."""


class Candidate:
    """All blocks of a stay on a surface that was new.

    Parameters
    ----------
    blocks
        The first of them, oldest first.
    """

    def __init__(self, blocks: Sequence[SurfaceBlock] = ()) -> None:
        self.blocks = list(blocks)
        self._unknown = np.zeros(1)
        self._known: dict[int, FloatArray] = {}

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.blocks)

    def ask(self, unknown: SurfacePosterior, known: Mapping[int, SurfacePosterior]) -> None:
        """Ask surfaces by number, and one that nobody knows, how likely they make the blocks.

        Costs what one prediction of all blocks costs with each of them.
        """
        heard = PreparedBlocks.of(self.blocks, unknown.settings)
        self._unknown, *each = (
            np.concatenate([[0.0], surface.log_likelihood(heard)])
            for surface in (unknown, *known.values())
        )
        self._known = dict(zip(known, each, strict=True))

    def after(self, alone: FloatArray) -> FloatArray:
        """Return how likely the newest block is, the newest two, and so on, given those before.

        Under the mixture of what the surface may be, as it was when `ask` was called.

        Parameters
        ----------
        alone
            The same under what the surface on trial has told by itself, shape (n,).
        """
        if not self._known:
            return alone
        before = len(self.blocks) - 1 - np.arange(len(alone))
        each = np.array(list(self._known.values()))
        weights = np.vstack([self._unknown, each - math.log(len(each))])[:, before]
        expected = np.vstack([alone, each[:, -1:] - each[:, before]])
        total = np.logaddexp.reduce(weights + expected) - np.logaddexp.reduce(weights)
        return np.asarray(total, dtype=np.float64)

    def gains(self) -> dict[int, float]:
        """Return how much likelier than one that nobody knows each known surface makes all blocks.

        Natural logarithms.
        """
        return {n: float(each[-1] - self._unknown[-1]) for n, each in self._known.items()}

    def leading(self) -> tuple[int, float]:
        """Return the known surface that the blocks speak for most, and by how much.

        That is against one that nobody knows and every other known one, as a natural logarithm.
        """
        gains = self.gains()
        first = max(gains, key=lambda n: gains[n])
        return first, gains[first] - max([0.0, *(g for n, g in gains.items() if n != first)])

    @property
    def asked(self) -> bool:
        """Whether there was a known surface to ask."""
        return bool(self._known)
