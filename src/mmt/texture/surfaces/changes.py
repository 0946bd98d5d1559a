"""A change of surface that was found, and where it is taken to have been."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from mmt.texture.surfaces.blocks import SurfaceBlock


@dataclass(frozen=True)
class SurfaceChange:
    """The tool was found to be on another surface.

    ``kind``: ``"new"`` one, a known one ``"recalled"``, or the new one on trial ``"identified"``
    as a known one. ``before`` and ``surface`` are the numbers of the two surfaces.
    ``from_sample``: the first sample that is no longer the former one's; ``since_sample``: the
    first of the blocks that are taken to be the other one's alone; ``at_sample``: where it was
    found. ``evidence``: the Bayes factor's natural logarithm.
    """

    kind: Literal["new", "recalled", "identified"]
    before: int
    surface: int
    from_sample: int
    since_sample: int
    at_sample: int
    evidence: float


def change_point(blocks: Sequence[SurfaceBlock], first: int) -> int:
    """Return where the change is taken to be that block `first` is the first one behind.

    Behind a lift-off, where contact began; within contact the block before, which may be of
    both, is neither's.
    """
    block = blocks[first]
    if block.touchdown or first == 0:
        return min(block.start, max(block.contact_start, 0))
    return blocks[first - 1].start
