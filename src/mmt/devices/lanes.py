"""Lanes: what one device has measured lately, and its value at an instant.

The value comes from the line between two readings, or from more of them
(`mmt.devices.vibration_lane`). Where no readings lie around the instant there is none.
"""

from collections import deque
from collections.abc import Sequence
from typing import Final

from mmt.devices.protocols import SensorReading, Vector
from mmt.devices.sensor_clock import SensorClock

SPACING_NS: Final = 1_000_000
"""Spacing of readings that is assumed until a sensor has shown its own."""

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
        self.period_ns = 0.0
        """Usual time between readings, 0 before there are two."""

    def reset(self) -> None:
        """Discard all readings: the device has restarted."""
        self._kept.clear()
        self.newest = None
        self.clock.reset()

    def add(self, readings: Sequence[SensorReading], arrival_ns: int) -> None:
        """Take what a sensor has given, with the host's time of the call.

        A stamp that is not after the last one restarts the lane: the sensor's clock was set back.
        """
        kept = self._kept
        for reading in readings:
            if kept:
                step = reading.time_ns - kept[-1].time_ns
                if step <= 0:
                    self.reset()
                elif not self.period_ns:
                    self.period_ns = float(step)
                else:
                    limited = min(step, 3.0 * self.period_ns)  # a gap is not the usual spacing
                    self.period_ns += 0.01 * (limited - self.period_ns)
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

    @property
    def ahead_ns(self) -> int:
        """How much longer frames wait than for the reading after their instant."""
        return 0

    def at(self, host_ns: int) -> "tuple[float, ...] | Waiting | None":
        """Return the value of a physical instant by the host's clock: x, y, z.

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
            max(LONGEST_GAP_NS, 1.5 * self.period_ns),
        )

    def _interpolate(self, time_ns: int, longest_ns: float) -> "tuple[float, ...] | Waiting | None":
        kept = self._kept
        if not kept or kept[-1].time_ns < time_ns:
            return WAITING
        while len(kept) > 1 and kept[1].time_ns <= time_ns:
            kept.popleft()
        return on_line(kept[0], kept[1 if len(kept) > 1 else 0], time_ns, longest_ns)


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

    def record(self, value: Vector, now_ns: int) -> None:
        """Take one measurement."""
        x, y, z = value
        self.last = (x, y, z)
        self._kept.append(SensorReading(now_ns, self.last))
        self.readings += 1

    def at(self, host_ns: int) -> "tuple[float, ...] | Waiting | None":
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
