"""Assemble frames at the session's rate from sensors that run on clocks of their own.

A frame takes the value of every lane (`mmt.devices.lanes`) at one physical instant. That instant
lies so far before the tick that readings on both sides of it have arrived: how far, the ages of
the newest readings tell. The age of the newest one goes up and down with the sensor's period, the
bundles in which its readings are handed on, and the time that they are under way; its upper end is
the least by which frames can be held back.
"""

from collections.abc import Iterable, Mapping
from statistics import median
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import frame_struct
from mmt.devices.lanes import Lane, Waiting

HOLD_BACK_NS: Final = 1_250_000
"""Time from the instant of a frame to its tick, so that the readings on both sides of it
have arrived: enough for a sensor of 1 kHz, or one whose readings come in a bundle each
millisecond. Less where the sensors' readings were seen to come sooner."""

MARGIN_NS: Final = 250_000
"""Margin of a slower sensor, beyond the spacing of its readings."""

AGE_MARGIN_NS: Final = 100_000
"""Beyond the age: a tick reads some tens of microseconds after it began, and a reading that is
later still is looked for again."""

_BLOCK_NS: Final = 20_000_000
_SHARE: Final = 0.98
"""Quantile of the ages in a block, of which the median over the blocks is taken: what is older
comes from a host that was held up."""
_FEW: Final = 20
"""A block with fewer looks than this does not tell."""


class FrameAssembler:
    """Put the lanes together, a frame for each tick.

    Frame k is of the instant k periods after the first, held back by `HOLD_BACK_NS`, or what the
    slowest sensor needs at the first tick, and the largest latency of the lanes and their filters,
    or by less where the sensors need less. It is formed at its tick, or at a later one where a
    reading is late. Where a lane has no value its number is left out.

    Parameters
    ----------
    lanes
        By the name of their field, in the order of the frame.
    dtype
        Data type of the frames.
    period_ns
        From tick to tick.
    needed_ns
        How long frames must be held back, latencies included (`ReadingAges.hold_back_ns`); None
        where that was not seen.
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
        """From the instant of a frame to its tick, once there was one."""
        self._origin_ns: int | None = None
        self._next = 0
        self._due = 0
        self.left_out = 0
        """Frames that a lane had no value for."""

    def tick(self, elapsed: int, now_ns: int) -> None:
        """Note that `elapsed` ticks have passed.

        The quickest tick sets the grid of the instants: a late one shifts none of them.
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
        """Leave out the frames that wait: a device is lost."""
        self.left_out += self._due - self._next
        self._next = self._due

    @property
    def lacking(self) -> bool:
        """Whether a frame of a tick that has passed waits for a reading."""
        return self._next < self._due

    def frames(self) -> RecordArray:
        """Return the frames (n,) that are complete, the oldest first."""
        rows = bytearray()
        start_ns = (self._origin_ns or 0) + self._period_ns - self.hold_back_ns
        while self._next < self._due:
            row = self._row(start_ns + self._next * self._period_ns)
            if row is None:
                break
            self.left_out += not row
            rows += row
            self._next += 1
        return np.frombuffer(rows, dtype=self._dtype)

    def _row(self, time_ns: int) -> bytes | None:
        """Return the next frame's bytes, empty where a lane has no value, None while it waits."""
        numbers: list[float] = []
        complete = True
        for lane in self._lanes:
            value = lane.at(time_ns)
            if value is None:
                complete = False
            elif isinstance(value, Waiting):
                return None
            else:
                numbers += value
        try:
            return self._pack(self._next, time_ns, *numbers) if complete else b""
        except OverflowError:  # larger than a frame's numbers: no sensor measures that
            return b""


class ReadingAges:
    """Collect the ages of the newest readings.

    Parameters
    ----------
    lanes
        Lanes of the sensors with clocks of their own.
    """

    def __init__(self, lanes: Iterable[Lane]) -> None:
        self._looks: list[tuple[Lane, list[tuple[int, int]]]] = [(lane, []) for lane in lanes]

    def look(self, now_ns: int) -> None:
        """Note how old the newest readings are, at a time of the host."""
        for lane, looks in self._looks:
            if lane.newest is not None:
                looks.append((now_ns, lane.newest.time_ns))

    def hold_back_ns(self) -> int | None:
        """Return how long to hold frames back, latencies of the sensors included.

        None where there were too few looks to tell.
        """
        oldest_ns = [_oldest_ns(lane, looks) for lane, looks in self._looks]
        known_ns = [age_ns for age_ns in oldest_ns if age_ns is not None]
        return (
            max(known_ns) + AGE_MARGIN_NS if oldest_ns and len(known_ns) == len(oldest_ns) else None
        )


def _oldest_ns(lane: Lane, looks: list[tuple[int, int]]) -> int | None:
    """Return the upper end of the ages that looks (host's time, stamp) have found."""
    ages: dict[int, list[int]] = {}
    behind_ns = lane.latency_ns + lane.ahead_ns
    for now_ns, stamp_ns in looks:
        age_ns = lane.clock.sensor_time(now_ns) + behind_ns - stamp_ns
        ages.setdefault(now_ns // _BLOCK_NS, []).append(age_ns)
    oldest = [
        sorted(block)[int(_SHARE * len(block))] for block in ages.values() if len(block) >= _FEW
    ]
    return round(median(oldest)) if oldest else None
