"""Base classes of the drivers of sensors: stuck values, overload, rest, silence."""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import hypot, isfinite
from statistics import fmean
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.output.logs import RepeatLimit
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.axes import Axis, signed_axes
from mmt.devices.protocols import SensorReading
from mmt.devices.reading_checks import LOG, QUIET_S, StuckCheck, gathered, measured
from mmt.devices.wrench import IMPOSSIBLE, Matrix, Six, WrenchConverter, WrenchOptions

_REST_S: Final = 0.2
"""Time over which a mean at rest is taken."""
_REST_SAMPLES: Final = 20
"""Fewer make no mean."""
_REST_PAUSE_S: Final = 1.0
"""A busy machine may read samples this much later."""


class SensorDriver(ABC):
    """A `SampledSensor` that counts the faults it tolerates, and is lost if its value is stuck.

    Parameters
    ----------
    name
        Name of the sensor in messages.
    stuck_s
        Time with exactly the same values after which it counts as stuck; 0 for never.
    """

    _first_s = 1.0
    """How long the first record may take."""

    def __init__(self, name: str, stuck_s: float) -> None:
        self.name = name
        self.latency_ns = 0
        self._counts: Counter[str] = Counter()
        self._notice = RepeatLimit(QUIET_S)
        self._stuck_s = stuck_s
        self._stuck = StuckCheck(1e9 * stuck_s)

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""
        return {reason: count for reason, count in dict(self._counts).items() if count}

    def connect(self) -> None:
        """Open and set up the device, then wait for a record; if it was stuck, for another value.

        Raises
        ------
        InputError
            The sensor or its calibration is not the one that the options expect.
        MmtError
            The device does not answer correctly, gives no record, or is still stuck; the message
            says what to do.
        """
        self.close()
        try:
            self._open()
            self._await_record()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def close(self) -> None:
        """Release the device; calling it twice is harmless."""

    @abstractmethod
    def _open(self) -> None:
        """Open and set up the device, whose records come from then on."""

    def _await_record(self) -> None:
        came = False
        start = time.monotonic()
        while time.monotonic() - start < self._first_s:
            records = self._received()
            if self._stuck.recovers(raw for _, raw in records):
                return
            came = came or bool(records)
            time.sleep(0.001)
        raise MmtError(self._explain_stuck() if came else self._explain_absence())

    @abstractmethod
    def _received(self) -> Sequence[tuple[int, tuple[float, ...]]]:
        """Return the received records as (time_ns, raw values), oldest first; never blocks."""

    @abstractmethod
    def _explain_absence(self) -> str:
        """Return why no record may have come since it was connected."""

    @abstractmethod
    def _explain_stuck(self) -> str:
        """Return that the value stays the same, and what to do."""


class AccelerometerDriver(SensorDriver):
    """A `SampledSensor` of accelerations; a subclass gives the raw values."""

    _axes: Sequence[tuple[int, float, float, float]] = ()
    """For x, y, z of the scene: the sensor's axis, its scale, its value at a raw value of zero,
    and the magnitude from which it is overloaded."""

    @abstractmethod
    def samples(self) -> Sequence[tuple[int, tuple[float, ...]]]:
        """Return the new samples as (time_ns, raw values along the sensor's own axes).

        Raises
        ------
        DeviceLost
            The sensor is gone.
        """

    def _received(self) -> Sequence[tuple[int, tuple[float, ...]]]:
        return self.samples()

    @abstractmethod
    def _doubt(self) -> tuple[float, str]:
        """Return the largest error of gravity at rest, relative, and what a larger one means."""

    def read(self) -> Sequence[SensorReading]:
        """Return the new readings, in m/s2 along the scene's axes.

        Raises
        ------
        DeviceLost
            The sensor was unplugged, or its value is stuck.
        """
        convert, stuck = self._convert, self._stuck
        readings = []
        for time_ns, raw in self.samples():
            if stuck.add(raw, time_ns):
                raise DeviceLost(self._explain_stuck())
            readings.append(convert(time_ns, raw))
        return readings

    def calibrate(self) -> None:
        """Compare the value at rest with gravity, and warn if they differ.

        No bias is subtracted: an accelerometer measures gravity too, and modelling and rendering
        leave out constant parts.

        Raises
        ------
        MmtError
            Too few samples came.
        """
        values = self._rest(lambda: (reading.value for reading in self.read()), _REST_S)
        felt = hypot(*map(fmean, zip(*values, strict=True)))
        error, meaning = self._doubt()
        if not abs(felt / GRAVITY_M_S2 - 1.0) <= error:
            LOG.warning(
                "%s measures %.2f m/s2 at rest, gravity is %.2f: %s",
                self.name,
                felt,
                GRAVITY_M_S2,
                meaning,
            )

    def _rest(self, take: Callable[[], Iterable[Vector]], duration_s: float) -> list[Vector]:
        """Return what `take` gives at rest, without values that are none."""
        longest_s = duration_s + _REST_PAUSE_S
        values = gathered(
            lambda: [value for value in take() if measured(value) is not None],
            _REST_SAMPLES,
            duration_s,
            longest_s,
        )
        if len(values) < _REST_SAMPLES:
            raise MmtError(
                f"{self.name}: {len(values)} samples came in {longest_s:g} s, too few; check its "
                "cable and its rate"
            )
        return values

    def _set_axes(
        self, axes: Sequence[Axis], scale: Vector, zero: Vector, ends_m_s2: Sequence[float]
    ) -> None:
        """Set scale, raw value at zero and end of each of the sensor's axes."""
        self._axes = [
            (i, sign * scale[i], -sign * scale[i] * zero[i], ends_m_s2[i])
            for i, sign in signed_axes(axes)
        ]

    def _convert(self, time_ns: int, raw: Sequence[float]) -> SensorReading:
        """Return the acceleration for the raw values of one sample."""
        (i, a, p, x_end), (j, b, q, y_end), (k, c, r, z_end) = self._axes
        x, y, z = a * raw[i] + p, b * raw[j] + q, c * raw[k] + r
        if abs(x) >= x_end or abs(y) >= y_end or abs(z) >= z_end:
            self._counts["overload"] += 1
            self._notice.warn(
                LOG,
                f"{self.name} is overloaded: beyond {x_end / GRAVITY_M_S2:.3g} g along an axis it "
                "may cut off what it feels; touch the surface and move more gently",
            )
        return SensorReading(time_ns, (x, y, z))

    def _explain_stuck(self) -> str:
        return (
            f"{self.name}: its value has not changed for {self._stuck_s:g} s or more, and even at "
            "rest it is never quite still: check its supply and its wires"
        )


Stamped = tuple[int, Six]
"""The sensor's time of a record (ns), and its raw values."""

_BROKEN_NS: Final = 100_000_000
"""How long data may come that gives no record."""
_BIAS_PATIENCE_S: Final = 2.0


class WrenchSensor(SensorDriver):
    """A `SampledSensor` of forces; a subclass receives the records.

    Parameters
    ----------
    name
        Name of the sensor in messages.
    options
        Mounting of the sensor, and when it is lost.
    """

    def __init__(self, name: str, options: WrenchOptions) -> None:
        super().__init__(name, 1e-3 * options.stuck_ms)
        self._mounting = options
        self._converter: WrenchConverter | None = None
        self._all_impossible = False  # the newest records
        self._arrival_ns = 0
        self._useless_ns = 0  # when data came last that gave no record, noted by the subclass
        self._silence_ns = round(options.silence_ms * 1e6)

    def connect(self) -> None:
        """Connect it; see `SensorDriver.connect`."""
        self._useless_ns = 0
        super().connect()

    @abstractmethod
    def _receive(self, now_ns: int) -> list[Stamped]:
        """Return the received records, oldest first; never blocks."""

    def _received(self) -> list[Stamped]:
        now_ns = time.monotonic_ns()
        records = self._receive(now_ns)
        if records:
            self._arrival_ns = now_ns
        return records

    @abstractmethod
    def _where(self) -> str:
        """Return what to check if no record comes."""

    def calibrate(self) -> None:
        """Take the bias: the mean over 0.2 s.

        Raises
        ------
        MmtError
            The sensor is not connected, the force changes meanwhile, or too few records come.
        """
        converter = self._connected()
        records = gathered(
            lambda: [raw for _, raw in self._take(time.monotonic_ns()) if isfinite(sum(raw))],
            _REST_SAMPLES,
            _REST_S,
            _BIAS_PATIENCE_S,
        )
        if len(records) >= _REST_SAMPLES:
            converter.take_bias(records, self.name)
            self._arrival_ns = time.monotonic_ns()
            return
        raise MmtError(
            f"{self.name}: {len(records)} records came in {_BIAS_PATIENCE_S:g} s while the bias "
            f"was taken; {self._where()}"
        )

    def read(self) -> Sequence[SensorReading]:
        """Return the readings received since the last call; see `SampledSensor`."""
        converter = self._connected()
        now_ns = time.monotonic_ns()
        records = self._take(now_ns)
        if not records:
            self._check_silence(now_ns)
            return ()
        readings = []
        force, overloads = converter.force, self._counts["overload"]
        for time_ns, raw in records:
            if self._stuck.add(raw, time_ns):
                raise DeviceLost(self._explain_stuck())
            value = force(raw)
            if value is not None:
                readings.append(SensorReading(time_ns, value))
        self._all_impossible = not readings
        if self._counts["overload"] != overloads:
            self._tell_overload()
        return readings

    def _take(self, now_ns: int) -> list[Stamped]:
        """Receive records, and note their arrival.

        Raises
        ------
        DeviceLost
            What has come for a while gave no record.
        """
        records = self._receive(now_ns)
        if records:
            self._arrival_ns = now_ns
        elif self._useless_ns - self._arrival_ns > _BROKEN_NS:
            raise DeviceLost(self._explain_unusable())
        return records

    def _saturate(self) -> None:
        """Count a record with a value at the end of its scale."""
        self._counts["saturation"] += 1
        self._tell_overload()

    def _tell_overload(self) -> None:
        self._notice.warn(
            LOG,
            f"{self.name} is overloaded: beyond the range of its calibration what it says is not "
            "to be trusted, and a transducer can be destroyed; press more gently",
        )

    def explain_fault(self) -> str:
        """Return why the received data is unusable, empty if no data comes or all is well."""
        if self._useless_ns > self._arrival_ns:
            return self._explain_unusable()
        if not self._all_impossible:
            return ""
        return (
            f"{self.name}: its values are no numbers, or over {IMPOSSIBLE:g} times its range: "
            "check the transducer's cable, and that calibration and range are those of this sensor"
        )

    def _explain_unusable(self) -> str:
        """Return why what comes gives no record."""
        return self._explain_absence()

    def _set_latency(self, own_ns: float) -> None:
        """Set the latency: the driver's own figure, unless the options say another."""
        latency_ms = self._mounting.latency_ms
        self.latency_ns = round(own_ns if latency_ms is None else 1e6 * latency_ms)

    def _set_matrix(self, matrix: Matrix, limits: Six) -> None:
        """Convert by this calibration from now on; the bias stays. See `WrenchConverter`."""
        converter = WrenchConverter(matrix, limits, self._mounting, self._counts)
        if self._converter is not None:
            converter.bias = self._converter.bias
        self._converter = converter
        self._arrival_ns = time.monotonic_ns()

    def _connected(self) -> WrenchConverter:
        if self._converter is None:
            raise MmtError(f"{self.name} is not connected")
        return self._converter

    def _check_silence(self, now_ns: int) -> None:
        silent_ns = now_ns - self._arrival_ns
        if silent_ns > self._silence_ns:
            raise DeviceLost(
                f"{self.name}: no record for {silent_ns / 1e6:.0f} ms; {self._where()}"
            )

    def _explain_stuck(self) -> str:
        return (
            f"{self.name}: the very same values for {self._mounting.stuck_ms:.0f} ms or more, "
            "which no gauge gives: check the transducer's cable, and switch the device off and on"
        )
