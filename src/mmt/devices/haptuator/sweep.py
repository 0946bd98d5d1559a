"""Play a sweep on an actuator and record the acceleration of its handle.

The right voltage is not known beforehand: quiet sweeps, each twice as loud as the last, are played
until the accelerometer measures one, and the wanted level follows by proportion.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, MmtError
from mmt.devices.haptuator.equaliser import sweep
from mmt.devices.protocols import SensorReading, VoltageActuator
from mmt.devices.streaming.lanes import Lane

_BEFORE: Final = 400
"""Samples of silence before a sweep, to learn the sensor's value at rest and its clock."""
_AFTER: Final = 300
_PROBE_S: Final = 1.0
_PROBE_SHARE: Final = 1.0 / 32.0
"""Share of the largest voltage at which the first probe is played."""
_HEARD: Final = 8.0
"""Least ratio of a sweep's peak to the noise; a smaller peak may be noise."""
_HEADROOM: Final = 0.8
_BEYOND: Final = 1.6
"""A sweep is ended if the handle is shaken this many times harder than asked for."""
_TRIES: Final = 3
_PAUSE_S: Final = 0.0005
_SILENT_NS: Final = 200_000_000
_LEAST_READINGS_PER_HZ: Final = 2.2


@dataclass(frozen=True)
class SweepSettings:
    """Settings of a sweep.

    Parameters
    ----------
    low_hz, high_hz
        Lowest and highest frequency of the sweep.
    duration_s
        Duration of the sweep, 2 to 60.
    largest_m_s2
        Largest acceleration of the handle, about.
    level_v
        Peak of the sweep; None finds the voltage that causes `largest_m_s2`, within the actuator's
        limit.
    """

    low_hz: float = 60.0
    high_hz: float = 490.0
    duration_s: float = 8.0
    largest_m_s2: float = 15.0
    level_v: float | None = None

    def __post_init__(self) -> None:
        for name, least, most in (("largest_m_s2", 0.1, 200.0), ("duration_s", 2.0, 60.0)):
            value = getattr(self, name)
            if not least <= value <= most:
                raise InputError(f"{name} is {value:g}; allowed are {least:g} to {most:g}")
        if self.level_v is not None and not self.level_v > 0.0:
            raise InputError(f"level_v is {self.level_v:g}; it must be above 0")


class SweepRecording(NamedTuple):
    """Voltage played and acceleration measured, at 1 kHz by one clock."""

    volts: FloatArray
    """Shape (n,), V."""
    acceleration_m_s2: FloatArray
    """Shape (n,), along the direction in which the handle was shaken most."""
    level_v: float
    """Peak of the sweep."""
    peak_m_s2: float
    """Largest measured acceleration."""


def record_sweep(
    actuator: Any,
    accelerometer: Any,
    settings: SweepSettings,
    say: Callable[[str], None] = lambda _: None,
) -> SweepRecording:
    """Connect both devices, play a sweep and record it, and close both in any case.

    Parameters
    ----------
    actuator
        A `VoltageActuator`.
    accelerometer
        A `SampledSensor` or an `Accelerometer`, on the handle.
    settings
        Settings of the sweep.
    say
        Called with a sentence before each sweep.

    Raises
    ------
    InputError
        The actuator takes no voltages or not so large ones, or the accelerometer is too slow.
    MmtError
        A device fails, the accelerometer measures nothing, or the handle is shaken too hard.
    """
    with contextlib.closing(accelerometer), contextlib.closing(actuator):
        actuator.connect()
        accelerometer.connect()
        if not isinstance(actuator, VoltageActuator):
            raise InputError(
                f"{type(actuator).__name__} cannot be given voltages (it has no 'write_volts'): "
                "record a sweep by other means and give the file"
            )
        rig = _Rig(actuator, accelerometer, settings)
        level_v = settings.level_v or rig.find_level(say)
        if level_v > actuator.largest_v:
            raise InputError(
                f"level_v is {level_v:g} V; the actuator may get {actuator.largest_v:g} V at most"
            )
        return rig.record(level_v, say)


class _Rig:
    """Actuator and accelerometer on one handle."""

    def __init__(
        self, actuator: VoltageActuator, accelerometer: Any, settings: SweepSettings
    ) -> None:
        self._actuator = actuator
        self._settings = settings
        self._sampled = hasattr(accelerometer, "latency_ns")
        self._sensor = accelerometer

    def find_level(self, say: Callable[[str], None]) -> float:
        """Return the voltage at which the handle is shaken as hard as wanted."""
        most_v, wanted = self._actuator.largest_v, self._settings.largest_m_s2
        level_v = _PROBE_SHARE * most_v
        while True:
            say(f"listening to a sweep of {_PROBE_S:g} s at {level_v:.3g} V")
            _, felt = self._play(level_v, _PROBE_S)
            peak, noise = _peak(felt), float(np.std(felt[: _BEFORE // 2]))
            if peak > _HEARD * noise:
                return min(most_v, _HEADROOM * level_v * wanted / peak)
            if level_v >= most_v:
                raise MmtError(
                    f"the accelerometer feels nothing of {level_v:.3g} V: check that it sits on "
                    "the handle, that the amplifier is on, and the actuator's wires and channel"
                )
            level_v = min(2.0 * level_v, most_v)

    def record(self, level_v: float, say: Callable[[str], None]) -> SweepRecording:
        """Play the sweep, again if it had gaps; return the one with the fewest gaps."""
        settings = self._settings
        best: SweepRecording | None = None
        fewest = 0
        for _ in range(_TRIES):
            say(f"playing {settings.duration_s:g} s at {level_v:.3g} V; keep the handle still")
            before = self._gaps()
            volts, felt = self._play(level_v, settings.duration_s)
            missed = self._gaps() - before
            if best is None or missed < fewest:
                best, fewest = SweepRecording(volts, felt, level_v, _peak(felt)), missed
            if not fewest:
                break
            say(f"gaps: {missed}; raise the actuator's 'buffer_ms', or end what loads this machine")
        assert best is not None  # noqa: S101 - it was played at least once
        return best

    def _gaps(self) -> int:
        """Return the number of gaps in the playback so far."""
        counts = asdict(self._actuator.statistics)
        return sum(int(counts.get(name, 0)) for name in ("underruns", "slips", "lost_frames"))

    def _play(self, level_v: float, duration_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the volts played (n,) and the acceleration along its main direction (n,)."""
        settings = self._settings
        signal = sweep(level_v, settings.low_hz, settings.high_hz, duration_s)
        volts = np.concatenate([np.zeros(_BEFORE), signal, np.zeros(_AFTER)])
        hearing = _AccelerationLog(self._sensor, sampled=self._sampled)
        begun_ns = time.monotonic_ns()
        written = 0
        while written < len(volts):
            due = min(len(volts), (time.monotonic_ns() - begun_ns) // 1_000_000 + 1)
            if due > written:
                self._actuator.write_volts(volts[written:due])
                written = due
            hearing.listen()
            if written <= _BEFORE:
                hearing.rest()
            elif not hearing.beyond <= _BEYOND * settings.largest_m_s2:
                raise MmtError(
                    f"ended: the handle is shaken by {hearing.beyond:.3g} m/s2, "
                    f"{settings.largest_m_s2:g} were allowed: give a smaller --level-v, or a "
                    "larger --largest-m-s2 if your accelerometer measures that"
                )
            time.sleep(_PAUSE_S)
        return volts, _main(hearing.at(begun_ns, len(volts), settings.high_hz))


class _AccelerationLog:
    """Records the accelerometer's readings."""

    def __init__(self, sensor: Any, *, sampled: bool) -> None:
        self._sensor = sensor
        self._lane = Lane(sensor.latency_ns) if sampled else None
        self._kept: list[SensorReading] = []
        self._rest: FloatArray | None = None
        self._heard_ns = time.monotonic_ns()
        self.beyond = 0.0
        """Largest magnitude (m/s2) of the newest readings, less the value at rest."""

    def listen(self) -> None:
        """Take the new readings; raise if none has come for long, since a sweep needs its limit."""
        if self._lane is None:
            fresh = [SensorReading(time.monotonic_ns(), self._sensor.read())]
        else:
            fresh = list(self._sensor.read() or ())
            self._lane.add(fresh, time.monotonic_ns())
        self._kept += fresh
        if fresh:
            self._heard_ns = time.monotonic_ns()
        elif time.monotonic_ns() - self._heard_ns > _SILENT_NS:
            raise MmtError(
                "ended: the accelerometer gives no reading for 0.2 s; test it by 'mmt device test'"
            )
        if fresh and self._rest is not None:
            values = np.array([reading.value for reading in fresh]) - self._rest
            self.beyond = float(np.sqrt((values**2).sum(axis=1)).max())

    def rest(self) -> None:
        """Take the mean of the readings so far as the value at rest."""
        if self._kept:
            self._rest = np.array([reading.value for reading in self._kept]).mean(axis=0)

    def at(self, begun_ns: int, count: int, high_hz: float) -> FloatArray:
        """Return the acceleration at each millisecond, shape (count, 3)."""
        from scipy.interpolate import CubicSpline

        times = np.array([reading.time_ns for reading in self._kept], dtype=np.int64)
        if np.any(np.diff(times) <= 0):
            raise MmtError("the accelerometer's clock was set back while it was read: try again")
        rate_hz = 1e9 * (len(times) - 1) / float(times[-1] - times[0])
        if rate_hz < _LEAST_READINGS_PER_HZ * high_hz:
            raise InputError(
                f"the accelerometer gives {rate_hz:.0f} readings a second, too few for "
                f"{high_hz:g} Hz: raise its rate, or lower --high-hz"
            )
        grid = [begun_ns + tick * 1_000_000 for tick in range(count)]
        if self._lane is not None:
            clock, latency_ns = self._lane.clock, self._lane.latency_ns
            grid = [clock.sensor_time(time_ns) + latency_ns for time_ns in grid]
        values = np.array([reading.value for reading in self._kept], dtype=np.float64)
        origin = times[0]
        places = np.clip(np.array(grid, dtype=np.int64), times[0], times[-1]) - origin
        felt: FloatArray = CubicSpline(1e-9 * (times - origin), values)(1e-9 * places)
        return felt


def _main(felt: FloatArray) -> FloatArray:
    """Return vectors (n, 3) along the direction in which they vary most, without their mean."""
    centred = felt - felt.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    along: FloatArray = centred @ vectors[:, -1]
    return along


def _peak(felt: FloatArray) -> float:
    """Return the largest magnitude, without one sample in a thousand."""
    return float(np.quantile(np.abs(felt), 0.999))
