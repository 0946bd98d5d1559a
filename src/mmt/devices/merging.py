"""Form frames at the session's rate from sensors that run on clocks of their own.

Each lane holds what one device has measured; a frame takes all of them at one physical
instant: from the line between two readings, or from more of them (`vibration_lane`). Where there
are none, there is no frame.
"""

import struct
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.devices.clocks import SensorClock
from mmt.devices.protocols import SensorReading, Vector

HOLD_BACK_NS: Final = 1_250_000
"""A frame is of the instant so long before its tick, so that the readings on both sides of it
have arrived: enough for a sensor of 1 kHz, or one whose readings come in a bundle each
millisecond. Less where the sensors' readings were seen to come sooner."""

MARGIN_NS: Final = 250_000
"""Of a slower sensor, beyond the spacing of its readings."""

SPACING_NS: Final = 1_000_000
"""Of a sensor that has not shown it yet."""

LONGEST_GAP_NS: Final = 1_500_000
"""Between two readings with a value in between; one and a half of a slow sensor's periods."""

POLLED_GAP_NS: Final = 5_000_000
"""Between two ticks at which a device was polled, with a value in between."""
_FEW: Final = 10
"""Fewer readings than this do not tell a sensor's rate."""
_KEPT: Final = 4096
"""Readings that a lane holds at most: half a second at 8 kHz."""


class Lane:
    """What one device has measured lately, by the host's clock.

    Parameters
    ----------
    latency_ns
        From the physical instant to the stamp.
    """

    def __init__(self, latency_ns: int = 0) -> None:
        self.latency_ns = latency_ns
        self.clock = SensorClock()
        self.readings = 0
        """How many have come."""
        self.newest: SensorReading | None = None
        self._kept: deque[SensorReading] = deque(maxlen=_KEPT)
        self._spacing_ns = 0.0  # usual time between readings, 0 before there are two

    def reset(self) -> None:
        """Forget what has come: the device begins anew."""
        self._kept.clear()
        self.newest = None
        self.clock.reset()

    def take(self, readings: Sequence[SensorReading], arrival_ns: int) -> None:
        """Take what a sensor has given, with the host's time of the call.

        A stamp that is not after the last one begins anew: the sensor's clock was set back.
        """
        kept = self._kept
        for reading in readings:
            if kept:
                step = reading.time_ns - kept[-1].time_ns
                if step <= 0:
                    self.reset()
                elif not self._spacing_ns:
                    self._spacing_ns = float(step)
                else:
                    limited = min(step, 3.0 * self._spacing_ns)  # a gap is not the usual spacing
                    self._spacing_ns += 0.01 * (limited - self._spacing_ns)
            kept.append(reading)
        if readings:
            self.readings += len(readings)
            newest = self.newest = readings[-1]
            _, _, _ = newest.value  # else it is the sensor's fault, and found here
            self.clock.add(arrival_ns, newest.time_ns)

    @property
    def spacing_ns(self) -> int:
        """Mean time between the readings that are kept."""
        kept = self._kept
        if len(kept) < _FEW:
            return SPACING_NS
        return (kept[-1].time_ns - kept[0].time_ns) // (len(kept) - 1)

    def at(self, host_ns: int) -> "Vector | Waiting | None":
        """Return the value of a physical instant by the host's clock.

        Returns
        -------
        value
            None where nothing was measured around it, `WAITING` where its readings may still
            come. Instants must not go back.
        """
        if not self.clock.known:
            return WAITING
        return self._interpolate(
            self.clock.sensor_time(host_ns) + self.latency_ns,
            max(LONGEST_GAP_NS, 1.5 * self._spacing_ns),
        )

    def _interpolate(self, time_ns: int, longest_ns: float) -> "Vector | Waiting | None":
        kept = self._kept
        if not kept or kept[-1].time_ns < time_ns:
            return WAITING
        while len(kept) > 1 and kept[1].time_ns <= time_ns:
            kept.popleft()
        return on_line(kept[0], kept[min(1, len(kept) - 1)], time_ns, longest_ns)


class PolledLane(Lane):
    """What a device without a clock has measured at the ticks, stamped by the host."""

    def __init__(self, longest_gap_ns: int = POLLED_GAP_NS) -> None:
        super().__init__()
        self.last: Vector = (0.0, 0.0, 0.0)
        """The newest measurement."""
        self._longest_gap_ns = longest_gap_ns

    @property
    def spacing_ns(self) -> int:
        """Nothing is waited for: a tick has its measurement."""
        return 0

    def note(self, value: Vector, now_ns: int) -> None:
        """Take one measurement."""
        x, y, z = value
        self.last = (x, y, z)
        self._kept.append(SensorReading(now_ns, self.last))
        self.readings += 1

    def at(self, host_ns: int) -> "Vector | Waiting | None":
        """Return the value of an instant; see `Lane`."""
        return self._interpolate(host_ns, self._longest_gap_ns)


def on_line(
    start: SensorReading, end: SensorReading, time_ns: int, longest_ns: float
) -> Vector | None:
    """Return the value on the straight line from one reading to another, or to itself.

    None before the first one, and where the second comes longer than `longest_ns` after it.
    """
    start_ns, first = start
    end_ns, last = end
    if start_ns >= time_ns:
        return first if start_ns == time_ns else None
    span = end_ns - start_ns
    if span > longest_ns:
        return None
    share = (time_ns - start_ns) / span
    x, y, z = first
    u, v, w = last
    return (x + share * (u - x), y + share * (v - y), z + share * (w - z))


class Waiting:
    """The readings for an instant may still come."""


WAITING: Final = Waiting()


class FrameMerger:
    """Put the lanes together, a frame for each tick.

    Frame k is of the instant k periods after the first, held back by `HOLD_BACK_NS`, or what the
    slowest sensor needs at the first tick, and the largest latency of the lanes, or by less where
    the sensors need less. It is formed at its tick, or at a later one where a reading is late.
    Where a lane has no value its number is left out.

    Parameters
    ----------
    lanes
        By the name of their field, in the order of the frame.
    dtype
        Of the frames.
    period_ns
        From tick to tick.
    needed_ns
        How long frames must be held back, latencies included (`mmt.devices.holding_back`); None
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
        number = dtype[-1].base.char
        self._pack = struct.Struct(f"<Iq{3 * len(self._lanes)}{number}").pack
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
        """Note that so many ticks have passed.

        The quickest tick sets the grid of the instants: a late one shifts none of them.
        """
        if self._origin_ns is None:
            spacing_ns = max(lane.spacing_ns for lane in self._lanes)
            latency_ns = max(lane.latency_ns for lane in self._lanes)
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
        try:  # several times as quick as an array of tuples
            return self._pack(self._next, time_ns, *numbers) if complete else b""
        except OverflowError:  # larger than a frame's numbers: no sensor measures that
            return b""
