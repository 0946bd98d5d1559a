"""Aligned channels: the output of the filters, sample by sample."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Columns:
    """Arrays of one length, (n, ...) each; an index takes the same part of every array."""

    def __getitem__(self, part: slice | BoolArray) -> Self:
        return type(self)(*(getattr(self, field.name)[part] for field in fields(self)))

    @classmethod
    def concatenate(cls, blocks: Sequence[Self]) -> Self:
        """Join successive blocks, at least one."""
        columns = ([getattr(block, field.name) for block in blocks] for field in fields(cls))
        return cls(*(np.concatenate(column) for column in columns))


@dataclass(frozen=True, eq=False)
class AlignedBlock(Columns):
    """Filtered channels that belong to the same instants, one element a frame.

    ``index`` (n,) is the frame's sequence number, strictly ascending, with jumps where
    frames are missing; ``time_ns`` (n,) its time. ``position_mm`` (n, 3) is low-passed.
    ``velocity_mm_s`` (n, 2) is the velocity in the plane orthogonal to the normal axis,
    along its two axes in their order, ``speed_mm_s`` (n,) its magnitude.
    ``normal_force_n`` (n,) is positive when pressing, else 0. ``vibration_m_s2`` is high-
    passed, k samples a frame: (n, k, 1) for an axis and (n, k, 3) for DFT321, which is applied to
    whole segments.
    ``valid`` (n,) is False while the filters settle after a gap, and where the acceleration is no
    measurement and is not filled. ``measured`` (n,) is False where it is no measurement, filled or
    not; filled samples are valid, but count for nothing.
    """

    index: IntArray
    time_ns: IntArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    speed_mm_s: FloatArray
    normal_force_n: FloatArray
    vibration_m_s2: FloatArray
    valid: BoolArray
    measured: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def empty(cls) -> Self:
        """Return a block of no samples."""
        number, none = np.zeros(0, np.int64), np.zeros(0)
        rows = (np.zeros((0, 3)), np.zeros((0, 2)), none, none, np.zeros((0, 1, 1)))
        return cls(number, number, *rows, none > 0.0, none > 0.0)
