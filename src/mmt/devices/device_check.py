"""Check one device: read it for a while, and report values, rate, jitter and faults."""

import inspect
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np

from mmt.core.errors import MmtError, located, short_message
from mmt.core.frames import missing_band
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.protocols import SensorReading, SetupRemarks, fault_explanation, fault_table

UNITS: Final = {
    "robot": "mm",
    "handle": "mm",
    "force_sensor": "N",
    "accelerometer": "m/s2",
    "board": "V",
    "actuator": "",
    "device": "",
}
"""Unit of a device's values in each role; "device" is for a driver that does not tell its role."""

Values = tuple[float, ...]
"""Three values, or one for each input of a board."""

_LONGEST_WAIT_S: Final = 1.5
_STUCK_S: Final = 1.0
_KEPT: Final = 1_000_000
_BUSY_MS: Final = 5.0
_BURST_MS: Final = 10.0
_RATE_HZ: Final = 1000
_PACE: Final = 0.2
_PACED_NS: Final = 500_000_000
"""Stamps may pass faster or slower than this machine's clock by this share, over so long."""


@dataclass
class DeviceCheck:
    """Result of a check of one device."""

    role: str
    driver: str
    samples_hz: int = _RATE_HZ
    """Samples a second that the scene needs."""
    readings: int = 0
    duration_s: float = 0.0
    newest: Values | None = None
    mean: Values | None = None
    deviation: Values | None = None
    least: Values | None = None
    most: Values | None = None
    rate_hz: float | None = None
    """Readings a second of a sensor with its own clock, by this machine's clock."""
    spacing_p50_ms: float | None = None
    spacing_p99_ms: float | None = None
    """Median and 99th percentile of the time between its stamps."""
    arrival_p99_ms: float | None = None
    """99th percentile of the wait for its next readings."""
    latency_ms: float | None = None
    pace: float | None = None
    """Time by its stamps over that by this machine's clock, None if it was read too shortly."""
    waited_p99_ms: float | None = None
    """99th percentile of the check's own loop time, which is long on a busy machine."""
    played: dict[str, float | int | None] = field(default_factory=dict)
    """Statistics of an actuator that played silence."""
    faults: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    """Sentences that say what is wrong and what to do."""

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return UNITS[self.role]


_THREE: Final = {"robot", "handle", "force_sensor", "accelerometer"}
"""Roles whose readings are three numbers."""

_NO_CALLS: Final = (
    "it has neither read() nor write(), so that it is no device that a scene can use; give it the "
    "calls of its role (docs/how-to/devices.md), or name with --role what it is meant to be"
)


def check_device(
    role: str,
    driver: str,
    device: Any,
    *,
    duration_s: float,
    calibrate: bool = False,
    samples_hz: int = _RATE_HZ,
    show: Callable[[DeviceCheck], None] = lambda _: None,
) -> DeviceCheck:
    """Connect a device, read it once a millisecond, close it; nothing moves or sounds.

    Parameters
    ----------
    role
        A key of `UNITS`.
    driver
        Name of the driver.
    device
        Any device or board of `mmt.devices.protocols`; an actuator plays silence.
    duration_s
        How long to read it.
    calibrate
        Whether to take biases first; the tool must be free and at rest.
    samples_hz
        Samples a second that the scene needs.
    show
        Called once a second with the results so far.

    Returns
    -------
    check
        Returned even if the device failed: `problems` then says how.
    """
    seen = DeviceCheck(role, driver, samples_hz=samples_hz)
    watching = _Observation(seen, device)
    try:
        device.connect()
        if calibrate and hasattr(device, "calibrate"):
            device.calibrate()
        if hasattr(device, "read") or hasattr(device, "write"):
            watching.run(duration_s, show)
        elif role == "device":
            seen.problems.append(_NO_CALLS)
    except Exception as error:  # noqa: BLE001 - whatever a driver raises is what is wrong
        seen.problems.append(located(error))
    finally:
        for ends, failed in ((watching.finish, "checked to the end"), (device.close, "closed")):
            try:
                ends()
            except Exception as error:  # noqa: BLE001 - as above
                seen.problems.append(f"it cannot be {failed}: {located(error)}")
    seen.problems += _judge(seen, watching)
    return seen


class _Observation:
    """Reads the device and keeps the values and times for the figures."""

    def __init__(self, seen: DeviceCheck, device: Any) -> None:
        self.seen = seen
        self.sampled = hasattr(device, "latency_ns")
        self.values: deque[Values] = deque(maxlen=_KEPT)
        self.stamps_ns: deque[int] = deque(maxlen=_KEPT)
        self.arrivals_ns: deque[int] = deque(maxlen=_KEPT)
        self._device = device
        self._read = _reader(device) if hasattr(device, "read") else None
        self._waits_ms: deque[float] = deque(maxlen=_KEPT)
        self._written = 0
        self._first_ns: tuple[int, int] | None = None  # arrival and stamp of the first look
        self._waiting = 0  # readings that waited before the first look, over an unknown time

    def run(self, duration_s: float, show: Callable[[DeviceCheck], None]) -> None:
        begun = time.monotonic()
        next_s = 1.0
        looked = begun
        while (passed_s := time.monotonic() - begun) < duration_s:
            now = time.monotonic()
            self._waits_ms.append(1e3 * (now - looked))
            looked = now
            self._look(passed_s)
            self.seen.duration_s = passed_s
            if self._read is not None and not self.values and passed_s > _LONGEST_WAIT_S:
                raise MmtError(
                    fault_explanation(self._device)
                    or "it is connected but gives no reading: check its cable, its power and the "
                    "rate or baud rate that is set"
                )
            if passed_s >= next_s:
                next_s += 1.0
                self._glance()
                show(self.seen)
            time.sleep(0.001)

    def _look(self, passed_s: float) -> None:
        if self._read is None:
            due = int(passed_s * _RATE_HZ) - self._written
            if due > 0:
                self._device.write([0.0] * due)
                self._written += due
            return
        readings = self._read()
        now_ns = time.monotonic_ns()
        for time_ns, value in readings:
            self.values.append(self._numbers(value))
            self.stamps_ns.append(time_ns)
        if readings:
            self._first_ns = self._first_ns or (now_ns, readings[-1].time_ns)
            self._waiting = self._waiting or len(readings)
            self.seen.readings += len(readings)
            self.arrivals_ns.append(now_ns)

    def _numbers(self, value: Any) -> Values:
        """Return a reading as numbers; a stranger's driver may give anything."""
        try:
            numbers = tuple(float(0.0 + each) for each in value)  # a text is no number
        except (TypeError, ValueError, OverflowError):
            numbers = ()
        if len(numbers) != 3 and (self.seen.role in _THREE or not numbers):
            raise MmtError(
                f"its read() gives {short_message(repr(value))}: a reading is three numbers, x, y, "
                "z, or from a driver with latency_ns a list of SensorReading"
            )
        return numbers

    def _glance(self) -> None:
        """Update the figures that are cheap to compute."""
        if self.values:
            self.seen.newest = self.values[-1]
        if self._read is None and hasattr(self._device, "statistics"):
            self.seen.played = asdict(self._device.statistics)
        if self.sampled and len(self.arrivals_ns) >= 3:
            span_s = (self.arrivals_ns[-1] - self.arrivals_ns[0]) / 1e9
            came = self.seen.readings - self._waiting
            self.seen.rate_hz = came / span_s if span_s > 0 else None

    def finish(self) -> None:
        """Compute the final figures."""
        seen = self.seen
        seen.faults = fault_table(self._device).get("faults", {})
        if isinstance(self._device, SetupRemarks):
            seen.problems += self._device.remarks()
        if self._waits_ms:
            seen.waited_p99_ms = float(np.percentile(np.array(self._waits_ms), 99))
        self._glance()
        if not self.values:
            return
        values = np.array(self.values)
        with np.errstate(invalid="ignore", over="ignore"):
            seen.mean, seen.deviation, seen.least, seen.most = (
                _vector(figure(values, axis=0)) for figure in (np.mean, np.std, np.min, np.max)
            )
        if not self.sampled or len(self.arrivals_ns) < 3:
            return
        seen.latency_ms = self._device.latency_ns / 1e6
        first_ns, stamp_ns = self._first_ns or (0, 0)
        if (span_ns := self.arrivals_ns[-1] - first_ns) >= _PACED_NS:
            seen.pace = float(self.stamps_ns[-1] - stamp_ns) / span_ns
        spacing_ms = np.diff(np.array(self.stamps_ns)) / 1e6
        seen.spacing_p50_ms, seen.spacing_p99_ms = np.percentile(spacing_ms, [50, 99]).tolist()
        waits_ms = np.diff(np.array(self.arrivals_ns)) / 1e6
        seen.arrival_p99_ms = float(np.percentile(waits_ms, 99))


def _reader(device: Any) -> Callable[[], list[SensorReading]]:
    """Return a function that reads any device as if it had a clock."""
    if hasattr(device, "latency_ns"):
        return lambda: [SensorReading(*reading) for reading in device.read() or ()]
    if inspect.signature(device.read).parameters:  # a leader's interface takes the elapsed ticks

        def read() -> list[SensorReading]:
            return [SensorReading(time.monotonic_ns(), device.read(1).position_mm)]

        return read
    return lambda: [SensorReading(time.monotonic_ns(), device.read())]


def _vector(values: Any) -> Values:
    return tuple(values.tolist())


def _judge(seen: DeviceCheck, watching: _Observation) -> list[str]:
    """Return the problems of the readings or the playback."""
    busy = seen.waited_p99_ms is not None and seen.waited_p99_ms > _BUSY_MS
    problems = _judge_played(seen) + _judge_values(seen, watching)
    if seen.rate_hz is not None and seen.rate_hz < 800:
        problems.append(
            f"it gives {seen.rate_hz:.0f} readings a second, less than the session's thousand: "
            "raise its rate or its baud rate"
        )
    elif seen.samples_hz > _RATE_HZ and seen.readings:
        band = missing_band(seen.rate_hz or _RATE_HZ, seen.samples_hz)
        problems += [f"it {band}: raise its rate, or lower acceleration_rate_hz"] if band else []
    if seen.pace is not None and not abs(seen.pace - 1.0) <= _PACE:
        problems.append(
            f"its stamps pass {seen.pace:.3g} times as fast as this machine's clock: a driver of "
            "your own gives time_ns in nanoseconds, the oldest reading first"
        )
    if seen.arrival_p99_ms is not None and seen.arrival_p99_ms > _BURST_MS and not busy:
        problems.append(
            f"its readings come in bursts, up to {seen.arrival_p99_ms:.0f} ms apart: lower the "
            "latency timer of a serial adapter, connect a network's box without a switch between"
        )
    problems += [f"{_often(count)}: {what}" for what, count in seen.faults.items() if count]
    if busy and (problems or (seen.arrival_p99_ms or 0.0) > _BURST_MS):
        problems.append(
            f"this machine is busy, the test itself had to wait up to {seen.waited_p99_ms:.0f} ms "
            "for its turn: end other programs and test again before you look for a fault"
        )
    return problems


def _judge_values(seen: DeviceCheck, watching: _Observation) -> list[str]:
    if seen.mean is None:
        return []
    finite = all(map(math.isfinite, seen.mean))
    problems = []
    if not finite:
        problems.append("it gives values that are no numbers: check its calibration and range")
    elif seen.duration_s >= _STUCK_S and watching.sampled and seen.least == seen.most:
        problems.append(
            "its value never changes, as no real sensor's does: check that it is wired and powered"
        )
    if seen.role == "accelerometer" and finite:
        gravity = math.hypot(*seen.mean)
        if not 0.7 * GRAVITY_M_S2 < gravity < 1.3 * GRAVITY_M_S2:
            unit = " (it may be in g)" if 0.7 < gravity < 1.3 else ""
            problems.append(
                f"at rest it must feel 9.8 m/s2 and feels {gravity:.3g}{unit}: keep it still, "
                "calibrate it, check its supply and its unit"
            )
    return problems


def _judge_played(seen: DeviceCheck) -> list[str]:
    underruns = seen.played.get("underruns")
    if not underruns:
        return []
    return [
        f"it ran out of samples {underruns} times in {seen.duration_s:.0f} s: raise 'buffer_ms', "
        "or take load off this machine"
    ]


def _often(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
