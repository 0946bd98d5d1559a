"""A candidate surface: one just detected as new, which may prove to be a known one.

Until that is decided the tool may be on an unknown surface or on any known one. Each hypothesis is
weighted by the likelihood of the candidate's blocks, with half of the prior weight on the unknown
one, and further blocks are predicted by their mixture. So a candidate of which a few blocks are
known is not left because of blocks that one of the known surfaces would have predicted.
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
"""Number of blocks after which a candidate is taken to be a new surface."""


class Candidate:
    """A surface detected as new, with all blocks of its stay.

    Parameters
    ----------
    blocks
        First blocks, oldest first.
    """

    def __init__(self, blocks: Sequence[SurfaceBlock] = ()) -> None:
        self.blocks = list(blocks)
        self._unknown = np.zeros(1)
        self._known: dict[int, FloatArray] = {}

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.blocks)

    def compare(self, unknown: SurfacePosterior, known: Mapping[int, SurfacePosterior]) -> None:
        """Evaluate the likelihood of the blocks under known surfaces and an unknown one.

        Costs one prediction of all blocks with each of them.
        """
        heard = PreparedBlocks.of(self.blocks, unknown.settings)
        self._unknown, *each = (
            np.concatenate([[0.0], surface.log_likelihood(heard)])
            for surface in (unknown, *known.values())
        )
        self._known = dict(zip(known, each, strict=True))

    def after(self, alone: FloatArray) -> FloatArray:
        """Return the log likelihoods of the newest block, the newest two, ..., given those before.

        Under the mixture of all hypotheses, as of the last call of `compare`.

        Parameters
        ----------
        alone
            The same under the posterior of the candidate alone, shape (n,).
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
        """Return the log Bayes factor of each known surface against an unknown one, by number.

        Natural logarithms, over all blocks.
        """
        return {n: float(each[-1] - self._unknown[-1]) for n, each in self._known.items()}

    def leading(self) -> tuple[int, float]:
        """Return the number of the likeliest known surface, and its lead.

        The lead is over an unknown surface and every other known one, as a natural logarithm.
        """
        gains = self.gains()
        first = max(gains, key=lambda n: gains[n])
        return first, gains[first] - max([0.0, *(g for n, g in gains.items() if n != first)])

    @property
    def is_compared(self) -> bool:
        """Whether the candidate was compared with any known surface."""
        return bool(self._known)
