"""Aligned channels: the output of the filters, sample by sample, and the noise floor in it.

While the tool is in the air or at rest, the signal behind the high-pass is the sensor's own noise,
and now and then a knock or the robot's motion. The lower quartile of the power of short windows is
the noise to some tenths (25th percentile of 50 squares of white noise: 0.87 of its power), as long
as a quarter of the windows holds nothing else. It is too low rather than too high.
"""

import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray

WINDOW: Final = 50
"""Frames of a window, which is used whole or not at all."""

LEAST_WINDOWS: Final = 4
"""Least windows from which the noise is estimated."""

WINDOWS_KEPT: Final = 200
"""Number of newest windows from which the noise is estimated."""

_IN_AIR_N: Final = 0.05
_AT_REST_MM_S: Final = 3.0


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


class NoiseFloor:
    """Noise power of an accelerometer, from its newest windows without contact or motion."""

    def __init__(self) -> None:
        self._powers: deque[float] = deque(maxlen=WINDOWS_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Add a block of the stream."""
        count = len(block) // WINDOW
        if not count:
            return
        part = block[: count * WINDOW]
        power = np.square(part.vibration_m_s2).sum(axis=2).reshape(count, -1).mean(axis=1)
        still = part.normal_force_n.reshape(count, WINDOW).max(axis=1) < _IN_AIR_N
        still |= part.speed_mm_s.reshape(count, WINDOW).max(axis=1) < _AT_REST_MM_S
        still &= part.valid.reshape(count, WINDOW).all(axis=1) & np.isfinite(power)
        self._powers.extend(power[still].tolist())

    @property
    def power(self) -> float:
        """Noise power in (m/s2)^2, 0 with fewer than `LEAST_WINDOWS` windows."""
        if len(self._powers) < LEAST_WINDOWS:
            return 0.0
        return statistics.quantiles(self._powers, n=4, method="inclusive")[0]
