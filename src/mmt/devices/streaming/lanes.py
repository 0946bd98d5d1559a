"""Lanes: the recent readings of one device, and its value at an instant.

The value is interpolated on the line between two readings, or from more of them
(`mmt.devices.streaming.vibration_lane`). Without readings around the instant there is no value.
Readings that are not finite, or whose stamp is not or is that of the reading before, are left out
and counted.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.quaternions import Quaternion, unit_quaternion
from mmt.devices.protocols import SensorReading
from mmt.devices.reading_checks import measured
from mmt.devices.streaming.sensor_clock import SensorClock

SPACING_NS: Final = 1_000_000
"""Spacing of readings that is assumed until a sensor has shown its own."""

LONGEST_GAP_NS: Final = 1_500_000
"""Longest gap between readings that is interpolated; for a slow sensor, 1.5 of its periods."""

POLLED_GAP_NS: Final = 5_000_000
"""Longest gap between two polls of a device that is interpolated."""
ORIENTATION_GAP_NS: Final = 50_000_000
"""Longest gap between two orientations that is interpolated: at 100 rad/s2 it is off by 1.8
degrees, and by 0.02 degrees between ticks that are 5 ms apart."""
_FEW: Final = 10
"""Fewer readings than this do not tell a sensor's rate."""
_KEPT: Final = 4096
"""Readings that a lane holds at most: half a second at 8 kHz."""
_NEVER: Final = -(1 << 63)


class Lane:
    """Recent readings of one device, found by the host's clock.

    Parameters
    ----------
    latency_ns
        Time from the physical instant to the stamp.
    """

    def __init__(self, latency_ns: int = 0) -> None:
        self.latency_ns = latency_ns
        self.clock = SensorClock()
        self.readings = 0
        """Number of readings received."""
        self.invalid = 0
        """Number of readings that were left out."""
        self.missed_frames = 0
        """Number of frames, since the first, that were skipped because it had no value."""
        self.on_invalid: Callable[[], None] = lambda: None
        """Called when readings are left out."""
        self._invalid_ns = _NEVER
        self.newest: SensorReading | None = None
        self._kept: deque[SensorReading] = deque(maxlen=_KEPT)
        self.period_ns = 0.0
        """Usual time between readings, 0 before there are two."""

    def reset(self) -> None:
        """Discard all readings: the device has restarted."""
        self._kept.clear()
        self.newest, self._invalid_ns = None, _NEVER
        self.clock.reset()

    def add(self, readings: Sequence[SensorReading], arrival_ns: int) -> bool:
        """Add the new readings of a sensor, with their arrival time by the host's clock.

        A reading with the stamp of the last one is left out. An earlier stamp restarts the lane:
        the sensor's clock was set back.
        Return whether any is valid.
        """
        kept, before = self._kept, self.invalid
        for reading in readings:
            time_ns, last_ns = reading.time_ns, kept[-1].time_ns if kept else None
            if time_ns == last_ns or measured(reading.value) is None or not math.isfinite(time_ns):
                self._leave_out(time_ns)
                continue
            if last_ns is not None:
                step = time_ns - last_ns
                if step < 0:
                    self.reset()
                elif not self.period_ns:
                    self.period_ns = float(step)
                else:
                    limited = min(step, 3.0 * self.period_ns)  # a gap is not the usual spacing
                    self.period_ns += 0.01 * (limited - self.period_ns)
            kept.append(reading)
        self.readings += len(readings)
        valid = self.invalid - before < len(readings)
        if valid:
            self.newest = kept[-1]
            self.clock.add(arrival_ns, kept[-1].time_ns)
        return valid

    def _leave_out(self, time_ns: int) -> None:
        self.invalid += 1
        self._invalid_ns = time_ns if math.isfinite(time_ns) else _NEVER
        self.on_invalid()

    @property
    def spacing_ns(self) -> int:
        """Mean time between the kept readings."""
        kept = self._kept
        if len(kept) < _FEW:
            return SPACING_NS
        return (kept[-1].time_ns - kept[0].time_ns) // (len(kept) - 1)

    @property
    def ahead_ns(self) -> int:
        """Extra time that frames wait, beyond the first reading after their instant."""
        return 0

    def at(self, host_ns: int) -> "tuple[float, ...] | Waiting | None":
        """Return the value (x, y, z) at a physical instant by the host's clock.

        Returns
        -------
        value
            None if nothing was measured around the instant, `WAITING` if its readings may still
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
            return self._lack(time_ns)
        while len(kept) > 1 and kept[1].time_ns <= time_ns:
            kept.popleft()
        return on_line(kept[0], kept[1 if len(kept) > 1 else 0], time_ns, longest_ns)

    def _lack(self, time_ns: int) -> "Waiting | None":
        """Return `WAITING`, or None if the reading that the instant lacks was left out."""
        return None if self._invalid_ns >= time_ns else WAITING


class PolledLane(Lane):
    """Recent readings of a device without a clock, polled at the ticks and stamped by the host."""

    def __init__(self, longest_gap_ns: int = POLLED_GAP_NS) -> None:
        super().__init__()
        self.last: Vector | None = None
        """The newest reading, None if it was left out."""
        self._longest_gap_ns = longest_gap_ns

    @property
    def spacing_ns(self) -> int:
        """0: frames wait for no reading, since each tick has its own."""
        return 0

    def record(self, value: Vector, now_ns: int) -> None:
        """Add one reading."""
        self.last = measured(value)
        self.readings += 1
        if self.last is None:
            self._leave_out(now_ns)
        else:
            self._kept.append(SensorReading(now_ns, self.last))

    def at(self, host_ns: int) -> "tuple[float, ...] | Waiting | None":
        """Return the value of an instant; see `Lane`."""
        return self._interpolate(host_ns, self._longest_gap_ns)


class OrientationLane(Lane):
    """Recent orientations of the robot's tool, polled with its position.

    Between two of them the value is interpolated on the line, and normalised. Up to 20 degrees
    apart it is within 0.01 degrees of the rotation at constant speed.
    """

    def __init__(self) -> None:
        super().__init__()
        self.last: Quaternion | None = None
        """The newest orientation, None if that was no unit quaternion, and is left out."""
        self._turns: deque[tuple[int, Quaternion | None]] = deque(maxlen=_KEPT)

    @property
    def spacing_ns(self) -> int:
        """0, as of `PolledLane`."""
        return 0

    def record(self, value: Quaternion, now_ns: int) -> None:
        """Add one orientation."""
        self.last = unit_quaternion(value)
        if self.last is None:
            self._leave_out(now_ns)
        self._turns.append((now_ns, self.last))

    def at(self, host_ns: int) -> "Quaternion | Waiting | None":
        """Return the orientation at an instant; see `Lane`."""
        turns = self._turns
        if not turns or turns[-1][0] < host_ns:
            return WAITING
        while len(turns) > 1 and turns[1][0] <= host_ns:
            turns.popleft()
        (start_ns, start), (end_ns, end) = turns[0], turns[1 if len(turns) > 1 else 0]
        span_ns = end_ns - start_ns
        if start_ns == host_ns:
            return start
        if start_ns > host_ns or span_ns > ORIENTATION_GAP_NS or start is None or end is None:
            return None
        share = (host_ns - start_ns) / span_ns
        if sum(a * b for a, b in zip(start, end, strict=True)) < 0.0:
            end = (-end[0], -end[1], -end[2], -end[3])
        w, x, y, z = (a + share * (b - a) for a, b in zip(start, end, strict=True))
        norm = math.hypot(w, x, y, z)
        return (w / norm, x / norm, y / norm, z / norm)


def on_line(
    start: SensorReading, end: SensorReading, time_ns: int, longest_ns: float
) -> Vector | None:
    """Return the value on the straight line between two readings, which may be the same.

    None before the first reading, or if the second is more than `longest_ns` later.
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
    """Type of `WAITING`: the readings for an instant may still come."""


WAITING: Final = Waiting()
