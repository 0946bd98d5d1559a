"""Base class of the drivers of six-axis force sensors: bias, overload, silence, stuck values."""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import SensorReading
from mmt.devices.reading_checks import RareWarning, StuckCheck
from mmt.devices.wrench import IMPOSSIBLE, Matrix, Six, WrenchConverter, WrenchOptions

Stamped = tuple[int, Six]
"""The sensor's time of a record (ns), and its raw values."""

_BROKEN_NS: Final = 100_000_000
"""How long data may come that gives no record."""
_BIAS_S: Final = 0.2
_BIAS_PATIENCE_S: Final = 2.0
_BIAS_RECORDS: Final = 20
"""Least number of records that make a bias."""


class WrenchSensor(ABC):
    """A `SampledSensor` of forces; a subclass receives the records.

    Parameters
    ----------
    name
        Name of the sensor in messages.
    options
        Mounting of the sensor, and when it is lost.
    """

    _first_s = 1.0
    """How long the first record may take."""

    def __init__(self, name: str, options: WrenchOptions) -> None:
        self.name = name
        self.latency_ns = 0
        self._mounting = options
        self._converter: WrenchConverter | None = None
        self._counts: Counter[str] = Counter()
        self._notice = RareWarning()
        self._all_impossible = False  # the newest records
        self._arrival_ns = 0
        self._useless_ns = 0  # when data came last that gave no record, noted by the subclass
        self._stuck = StuckCheck(1e6 * options.stuck_ms)
        self._silence_ns = round(options.silence_ms * 1e6)

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
        self._useless_ns = 0
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

    @abstractmethod
    def _receive(self, now_ns: int) -> list[Stamped]:
        """Return the received records, oldest first; never blocks."""

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
        self._take(time.monotonic_ns())  # discard older records: the tool may have moved then
        start = time.monotonic()
        records: list[Six] = []
        while (passed := time.monotonic() - start) < _BIAS_PATIENCE_S:
            if passed >= _BIAS_S and len(records) >= _BIAS_RECORDS:
                converter.take_bias(records, self.name)
                self._arrival_ns = time.monotonic_ns()
                return
            records += [raw for _, raw in self._take(time.monotonic_ns()) if isfinite(sum(raw))]
            time.sleep(0.001)
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

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""
        return {reason: count for reason, count in dict(self._counts).items() if count}

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
            f"{self.name} is overloaded: beyond the range of its calibration what it says is not "
            "to be trusted, and a transducer can be destroyed; press more gently"
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

    @abstractmethod
    def _explain_absence(self) -> str:
        """Return why no record may have come since it was connected."""

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

    def _await_record(self) -> None:
        came = False
        start = time.monotonic()
        while time.monotonic() - start < self._first_s:
            records = self._receive(time.monotonic_ns())
            if self._stuck.recovers(raw for _, raw in records):
                self._arrival_ns = time.monotonic_ns()
                return
            came = came or bool(records)
            time.sleep(0.001)
        raise MmtError(self._explain_stuck() if came else self._explain_absence())

    def _explain_stuck(self) -> str:
        return (
            f"{self.name}: the very same values for {self._mounting.stuck_ms:.0f} ms or more, "
            "which no gauge gives: check the transducer's cable, and switch the device off and on"
        )
