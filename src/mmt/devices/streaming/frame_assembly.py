"""Assemble frames at the session's rate from sensors with their own clocks.

A frame takes the value of every lane (`mmt.devices.streaming.lanes`) at one physical instant.
Frames are held back: the instant lies before the tick, so that readings on both sides of it have
arrived. The ages of the newest readings tell how far. The age of the newest reading varies with the
sensor's period, the bundles in which readings are passed on, and their travel time; the upper end
of the ages is the least time by which frames can be held back.
"""

from collections.abc import Iterable, Mapping
from statistics import median
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import frame_struct
from mmt.core.sequence_numbers import SEQUENCES
from mmt.devices.streaming.lanes import Lane, Waiting

HOLD_BACK_NS: Final = 1_250_000
"""Time from the instant of a frame to its tick, so that the readings on both sides of it
have arrived: enough for a sensor of 1 kHz, or one that sends a bundle of readings each
millisecond. Less is taken if the sensors' readings were seen to come sooner."""

MARGIN_NS: Final = 250_000
"""Added to the spacing of a slower sensor's readings."""

AGE_MARGIN_NS: Final = 100_000
"""Added to the age: a tick reads some tens of microseconds after its start. A later reading is
found by a further look."""

_BLOCK_NS: Final = 20_000_000
_SHARE: Final = 0.98
"""Quantile of the ages in a block; the median over the blocks is used. Higher ages come from a
host that was held up."""
_FEW: Final = 20
"""A block with fewer looks than this is ignored."""


class FrameAssembler:
    """Form a frame of the lanes for each tick.

    The instant of frame k lies k periods after that of the first. Frames are held back by
    `HOLD_BACK_NS`, or what the slowest sensor needs at the first tick, plus the largest latency
    of the lanes and their filters; by less if `needed_ns` is less. A frame is formed at its tick,
    or later if a reading is late. If a lane has no value, the frame's number is skipped.

    Parameters
    ----------
    lanes
        Lanes by the name of their field, in the order of the frame.
    dtype
        Data type of the frames.
    period_ns
        Time from tick to tick.
    needed_ns
        How long frames must be held back, latencies included (`ReadingAges.hold_back_ns`); None
        if that is not known.
    """

    def __init__(
        self,
        lanes: Mapping[str, Lane],
        dtype: "np.dtype[np.void]",
        period_ns: int,
        needed_ns: int | None = None,
    ) -> None:
        self._lanes = list(lanes.values())
        self._dtype = dtype
        self._pack = frame_struct(dtype).pack
        self._period_ns = period_ns
        self._needed_ns = needed_ns
        self.hold_back_ns = 0
        """Time from the instant of a frame to its tick; 0 before the first tick."""
        self._origin_ns: int | None = None
        self._next = 0
        self._due = 0
        self._begun = False

    def tick(self, elapsed: int, now_ns: int) -> None:
        """Note that `elapsed` ticks have passed.

        The tick that is least late sets the grid of the instants; a later one shifts none.
        """
        if self._origin_ns is None:
            spacing_ns = max(lane.spacing_ns for lane in self._lanes)
            latency_ns = max(lane.latency_ns + lane.ahead_ns for lane in self._lanes)
            self.hold_back_ns = max(HOLD_BACK_NS, spacing_ns + MARGIN_NS) + latency_ns
            if self._needed_ns is not None:
                least_ns = spacing_ns + latency_ns
                self.hold_back_ns = min(self.hold_back_ns, max(least_ns, self._needed_ns))
        self._due += elapsed
        origin_ns = now_ns - self._due * self._period_ns
        if self._origin_ns is None or origin_ns < self._origin_ns:
            self._origin_ns = origin_ns

    def give_up(self) -> None:
        """Skip the frames that wait: a device is lost."""
        self._next = self._due

    @property
    def lacking(self) -> bool:
        """Whether a frame of a past tick waits for a reading."""
        return self._next < self._due

    def frames(self) -> RecordArray:
        """Return the complete frames (n,), oldest first."""
        rows = bytearray()
        start_ns = (self._origin_ns or 0) + self._period_ns - self.hold_back_ns
        while self._next < self._due:
            row = self._row(start_ns + self._next * self._period_ns)
            if row is None:
                break
            rows += row
            self._next += 1
        return np.frombuffer(rows, dtype=self._dtype)

    def _row(self, time_ns: int) -> bytes | None:
        """Return the next frame's bytes, empty if a lane has no value, None while it waits."""
        numbers: list[float] = []
        lacking = []
        for lane in self._lanes:
            value = lane.at(time_ns)
            if isinstance(value, Waiting):
                return None
            if value is None:
                lacking.append(lane)
            else:
                numbers += value
        if not lacking:
            self._begun = True
            return self._pack(self._next % SEQUENCES, time_ns, *numbers)
        if self._begun:  # a robot is first read at the first tick, after the first instants
            for lane in lacking:
                lane.missed_frames += 1
        return b""


class ReadingAges:
    """Collects the ages of the newest readings.

    Parameters
    ----------
    lanes
        Lanes of the sensors with clocks of their own.
    """

    def __init__(self, lanes: Iterable[Lane]) -> None:
        self._looks: list[tuple[Lane, list[tuple[int, int]]]] = [(lane, []) for lane in lanes]

    def record(self, now_ns: int) -> None:
        """Note the newest readings at a time of the host."""
        for lane, looks in self._looks:
            if lane.newest is not None:
                looks.append((now_ns, lane.newest.time_ns))

    def hold_back_ns(self) -> int | None:
        """Return how long to hold frames back (ns), latencies of the sensors included.

        None if there were too few looks.
        """
        oldest_ns = [_oldest_ns(lane, looks) for lane, looks in self._looks]
        known_ns = [age_ns for age_ns in oldest_ns if age_ns is not None]
        return (
            max(known_ns) + AGE_MARGIN_NS if oldest_ns and len(known_ns) == len(oldest_ns) else None
        )


def _oldest_ns(lane: Lane, looks: list[tuple[int, int]]) -> int | None:
    """Return the upper end of the ages in looks (host's time, stamp), None if there are too few."""
    ages: dict[int, list[int]] = {}
    behind_ns = lane.latency_ns + lane.ahead_ns
    for now_ns, stamp_ns in looks:
        age_ns = lane.clock.sensor_time(now_ns) + behind_ns - stamp_ns
        ages.setdefault(now_ns // _BLOCK_NS, []).append(age_ns)
    oldest = [
        sorted(block)[int(_SHARE * len(block))] for block in ages.values() if len(block) >= _FEW
    ]
    return round(median(oldest)) if oldest else None
