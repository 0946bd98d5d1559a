"""Segments: stationary stretches of a stream, with their mean inputs and their vibration."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.dft321 import dft321
from mmt.texture.space import InputSpace


class SampleRange(NamedTuple):
    """Frames by absolute number, `start` included and `stop` not."""

    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Segment:
    """One stationary stretch.

    ``start`` and ``stop`` are absolute numbers of frames, half-open. ``speed_mm_s``,
    ``velocity_mm_s`` (x, y in the plane of the surface) and ``force_n`` are means.
    ``vibration_m_s2`` (k (stop - start),) is a copy, one axis or DFT321, k samples a frame.
    ``time_ns`` is the time of the last frame. ``final`` is False if a later update may still
    replace the segment. ``measured`` (k (stop - start),) says which samples of the vibration
    are measured and not filled, None if all are.
    """

    start: int
    stop: int
    speed_mm_s: float
    velocity_mm_s: tuple[float, float]
    force_n: float
    vibration_m_s2: FloatArray
    time_ns: int
    final: bool
    measured: BoolArray | None = None

    @classmethod
    def from_block(cls, part: AlignedBlock, span: SampleRange, *, final: bool) -> Self:
        """Return the segment of the samples `span`, which `part` holds."""
        _, per_frame, axes = part.vibration_m_s2.shape
        vibration = part.vibration_m_s2.reshape(-1, axes)
        measured = np.repeat(part.measured, per_frame)
        return cls(
            start=span.start,
            stop=span.stop,
            speed_mm_s=float(part.speed_mm_s.mean()),
            velocity_mm_s=(
                float(part.velocity_mm_s[:, 0].mean()),
                float(part.velocity_mm_s[:, 1].mean()),
            ),
            force_n=float(part.normal_force_n.mean()),
            vibration_m_s2=dft321(vibration) if axes == 3 else vibration[:, 0].copy(),
            time_ns=int(part.time_ns[-1]),
            final=final,
            measured=None if measured.all() else measured,
        )

    @property
    def span(self) -> SampleRange:
        """Range of frames of the segment."""
        return SampleRange(self.start, self.stop)

    @property
    def measured_count(self) -> int:
        """How many samples of the vibration are measured."""
        every = len(self.vibration_m_s2)
        return every if self.measured is None else int(np.count_nonzero(self.measured))

    @property
    def measured_gain(self) -> float:
        """Ratio of the power of the measured samples to that of all; filled ones have less."""
        if self.measured is None:
            return 1.0
        square = np.square(self.vibration_m_s2)
        mean = float(square.mean())
        return float(square[self.measured].mean()) / mean if mean > 0.0 else 1.0

    def inputs(self, space: InputSpace) -> tuple[float, ...]:
        """Return the segment's inputs in the input space of a model, shape (d,)."""
        if space.directed:
            return (*self.velocity_mm_s, self.force_n)
        return self.speed_mm_s, self.force_n
