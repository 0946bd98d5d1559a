"""Stationary stretches of a stream: straight path, steady speed, steady force.

Two stages, bottom-up, on the input signals alone (Abdulali and Jeon, "Data-driven modeling of
anisotropic haptic textures: data segmentation and interpolation", EuroHaptics 2016; cited by
paper A, section V.A): pieces of path that stay within tau_1 of their chord, and inside them
pieces whose std/mean of speed and of normal force stay within tau_2. If the heading counts, the
velocity vector replaces the speed: the deviation of the vector from its mean, over the mean's
length, stays within tau_2. This deviation is at least that of the speed, so that such pieces are
steady in speed as well, and a heading that varies by tau_2 in rad (rms) ends a piece.

Online, the newest data is segmented together with earlier data that may still change (paper A,
section V.C, prepends the last 200 samples). While a stretch continues, these pieces are
provisional: its last one, every one that reaches into the last `overlap_samples`, and the one
before those. A provisional segment is used at once. The next update replaces it if a different
segment overlaps it, and keeps it otherwise. Final segments are never cut again, and no sample is
in two segments at a time.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.segmentation.bottom_up import (
    CELL,
    cell_moments,
    stationary_pieces,
    straight_pieces,
)
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, dft321
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


class SegmentChange(NamedTuple):
    """Result of an update: remove `removed` from the model first, then insert `added`."""

    added: list[Segment]
    removed: list[SampleRange]


class OnlineSegmenter:
    """Segment a stream of aligned blocks, update by update.

    Samples that are not valid, too slow or too light, and jumps in the index, end a stretch. The
    grid of `bottom_up.CELL` samples is absolute. A cell is used if all samples of it and of both
    neighbouring cells are usable: this keeps segments 10 to 20 samples away from the edges of
    contact, which the filters smear.

    At most about ``3 longest_samples + overlap_samples`` samples are remembered. Cost of an
    update: about 0.2 ms plus that of `straight_pieces` and `stationary_pieces` over the
    remembered and the new samples; 0.6 ms for 2400 samples.

    Parameters
    ----------
    settings
        Thresholds: below ``least_speed_mm_s`` or ``least_force_n`` nothing is segmented, since
        std/mean explodes near zero; over velocity and force the heading has to be steady too. With
        ``overlap_samples`` 0, only the piece that touches the newest sample and the one before stay
        provisional.
    """

    def __init__(self, settings: ModellingSettings | None = None) -> None:
        self._settings = settings or ModellingSettings()
        self._tail = AlignedBlock.empty()
        self._settled = 0  # pieces before this sample are final
        self._provisional: list[SampleRange] = []

    def update(self, block: AlignedBlock) -> SegmentChange:
        """Add the next aligned samples, any number of them, and return the changed segments."""
        change = SegmentChange([], [])
        cuts = np.flatnonzero(np.diff(block.index) != 1) + 1
        for start, stop in pairwise([0, *cuts.tolist(), len(block)] if len(block) else []):
            run, tail = block[start:stop], self._tail
            if len(tail) and run.index[0] == tail.index[-1] + 1:
                self._tail = AlignedBlock.concatenate([tail, run])
            else:
                self._tail = run
                self._settled = int(run.index[0])
                self._provisional = []
            self._segment(change, goes_on=stop == len(block))
        return change

    def _segment(self, change: SegmentChange, *, goes_on: bool) -> None:
        """Segment the unsettled part of the tail, a contiguous run, and shorten the tail."""
        oldest, newest = int(self._tail.index[0]), int(self._tail.index[-1]) + 1
        first_cell = -(-oldest // CELL)
        cells = newest // CELL - first_cell
        if cells < 3:
            return
        begin = first_cell * CELL - oldest
        grid = self._tail[begin : begin + cells * CELL]
        unsettled = max(self._settled // CELL - first_cell, 0)
        pieces = _find_pieces(grid, unsettled, self._settings)

        margin = (newest - self._settings.overlap_samples) // CELL - first_cell
        settled = pieces.settled(margin) if goes_on else cells
        self._settled = max(self._settled, (first_cell + settled) * CELL)
        found = [
            SampleRange((first_cell + start) * CELL, (first_cell + stop) * CELL)
            for start, stop in pieces.stationary(self._settings.shortest_samples)
        ]
        self._exchange(found, change)
        # Straightness is judged over the whole piece of path, though its settled part is not
        # segmented again. The cell before it is the left neighbour of the first one.
        line_start = max(
            first_cell + pieces.line_start(settled),
            (self._settled - self._settings.longest_samples) // CELL,
        )
        self._tail = self._tail[max((line_start - 1) * CELL - oldest, 0) :]

    def _exchange(self, found: list[SampleRange], change: SegmentChange) -> None:
        """Replace provisional segments that overlap a different segment found now."""
        tail = self._tail
        kept = []
        for old in self._provisional:
            overlaps = any(old.start < new.stop and new.start < old.stop for new in found)
            if overlaps and old not in found:
                change.removed.append(old)
            else:
                kept.append(old)
        fresh = [new for new in found if new not in kept]
        for new in fresh:
            begin = new.start - int(tail.index[0])
            part = tail[begin : begin + new.stop - new.start]
            change.added.append(Segment.from_block(part, new, final=new.stop <= self._settled))
        self._provisional = [span for span in kept + fresh if span.stop > self._settled]


def segment(block: AlignedBlock, settings: ModellingSettings | None = None) -> list[Segment]:
    """Segment a whole recording in one pass.

    O(n) for n samples in strokes of seconds; see `straight_pieces`.
    """
    return OnlineSegmenter(settings).update(block).added


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces that a grid of cells was cut into.

    ``usable`` (cells,): every sample of the cell and of its neighbours is usable. ``lines``
    (cells,): a piece of path begins. ``starts`` and ``stops`` (pieces,): cells of the pieces,
    also of single unusable cells.
    """

    usable: BoolArray
    lines: BoolArray
    starts: IntArray
    stops: IntArray

    def stationary(self, shortest_samples: int) -> list[tuple[int, int]]:
        """Return first and last cell (exclusive) of the pieces that are long enough."""
        kept = self.usable[self.starts] & (CELL * (self.stops - self.starts) >= shortest_samples)
        return list(zip(self.starts[kept].tolist(), self.stops[kept].tolist(), strict=True))

    def settled(self, margin: int) -> int:
        """Return the cell before which nothing is segmented again.

        The newest cell has no right neighbour yet and so belongs to no piece. A stretch that
        reaches up to it continues: its pieces that touch the end or reach beyond the cell
        `margin` can change, and so can the end of the piece before them.
        """
        newest = len(self.usable) - 1
        if not self.usable[newest - 1]:
            return newest
        stretch = int(np.flatnonzero(~self.usable[:newest])[-1]) + 1
        inside = self.starts >= stretch
        first_open = np.flatnonzero(inside & ((self.stops > margin) | (self.stops >= newest)))[0]
        return int(self.starts[max(first_open - 1, 0)])

    def line_start(self, cell: int) -> int:
        """Return where the piece of path begins that holds a cell."""
        return int(np.flatnonzero(self.lines[: cell + 1])[-1])


def _find_pieces(grid: AlignedBlock, unsettled: int, settings: ModellingSettings) -> _Pieces:
    """Cut a grid of whole cells; stationary pieces only from the cell `unsettled` on."""
    good = grid.valid & (grid.speed_mm_s >= settings.least_speed_mm_s)
    good &= grid.normal_force_n >= settings.least_force_n
    whole = np.logical_and.reduce(good.reshape(-1, CELL), axis=1)
    usable = np.zeros_like(whole)
    usable[1:-1] = whole[:-2] & whole[1:-1] & whole[2:]
    edges = ~usable | ~np.roll(usable, 1)
    lines = straight_pieces(edges, grid.position_mm, settings.straightness_mm)

    by_heading = settings.inputs == "anisotropic"
    motion = grid.velocity_mm_s if by_heading else grid.speed_mm_s[:, None]
    vector = 2 if by_heading else 0
    moments = cell_moments(np.column_stack([grid.normal_force_n, motion])[unsettled * CELL :])
    longest_cells = settings.longest_samples // CELL
    begins = stationary_pieces(
        lines[unsettled:], moments, settings.stationarity, longest_cells, vector
    )
    starts = np.flatnonzero(begins) + unsettled
    return _Pieces(usable, lines, starts, np.append(starts, len(whole))[1:])
