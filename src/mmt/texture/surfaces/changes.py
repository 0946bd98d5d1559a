"""Detected changes of surface, and the estimate of their change-points."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from mmt.texture.surfaces.blocks import SurfaceBlock


@dataclass(frozen=True)
class SurfaceChange:
    """A detected change of the surface under the tool.

    ``kind``: ``"new"`` one, a known one ``"recalled"``, or the new one on trial ``"identified"``
    as a known one. ``before`` and ``surface`` are the numbers of the two surfaces.
    ``from_sample``: the first sample that is no longer the former one's; ``since_sample``: the
    first of the blocks that are taken to be the other one's alone; ``at_sample``: the sample
    at which it was detected. ``evidence``: natural logarithm of the Bayes factor.
    """

    kind: Literal["new", "recalled", "identified"]
    before: int
    surface: int
    from_sample: int
    since_sample: int
    at_sample: int
    evidence: float


def change_point(blocks: Sequence[SurfaceBlock], first: int) -> int:
    """Return the change-point, as a sample number, if block `first` is the first after it.

    After a lift-off this is where contact began; within contact it is the start of the block
    before, which may belong to both surfaces.
    """
    block = blocks[first]
    if block.touchdown or first == 0:
        return min(block.start, max(block.contact_start, 0))
    return blocks[first - 1].start
