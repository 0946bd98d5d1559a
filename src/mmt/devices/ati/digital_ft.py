"""Force through ATI's Digital F/T: settings by Modbus, then a stream on RS-485."""

from typing import Final, Literal

from pydantic import Field

from mmt.core.errors import MmtError
from mmt.devices.ati.calibration import AtiOptions, check_calibration
from mmt.devices.ati.digital_line import DigitalLine
from mmt.devices.ati.digital_wire import (
    CALIBRATION_REGISTERS,
    CALIBRATIONS,
    GAINS,
    LOCK,
    OFFSETS,
    SIZE,
    START_STREAM,
    STATUS,
    UNLOCK,
    Gauges,
    NoFrame,
    RecordStream,
    StoredCalibration,
    calibration_start,
    explain_status,
    parse_calibration,
)
from mmt.devices.record_clocks import CountingClock
from mmt.devices.sensor_drivers import Stamped, WrenchSensor

NOMINAL_HZ: Final = 7000.0
_READINGS_HZ: Final = 3500.0
"""Target rate of readings. A reading waits for its last record, and an adapter passes records on in
bundles: a rate in step with the bundles would hide the drift of the sensor's clock."""
_BITS: Final = 11 * SIZE
"""Bits of a record on the line: start, eight data bits, parity and stop for each byte."""
_HIGHEST, _LOWEST = 32767, -32768


class DigitalFtOptions(AtiOptions):
    """Options of ``ati-digital-ft``."""

    port: str = Field(min_length=1)
    """Serial port, as ``/dev/serial/by-id/usb-...``."""
    baud: Literal[1_250_000, 115_200, 19_200] = 1_250_000
    """Bits a second that the sensor is set to."""
    calibration_number: int = Field(default=1, ge=1, le=CALIBRATIONS)
    """Which of its stored calibrations to use."""
    average: int | None = Field(default=None, ge=1, le=100)
    """Records averaged into one reading; None gives about 3500 readings a second."""


def record_rate_hz(baud: int) -> float:
    """Return the rate of records (Hz): the sensor's own, or less if the line is slower."""
    return min(NOMINAL_HZ, baud / _BITS)


class DigitalFt(WrenchSensor):
    """A `SampledSensor` of forces on an RS-485 line."""

    OPTIONS = DigitalFtOptions

    def __init__(self, options: DigitalFtOptions) -> None:
        super().__init__(f"Digital F/T at {options.port}", options)
        self._options = options
        self._line = DigitalLine(self.name, options.port, options.baud)
        self._stream = RecordStream(self._counts)
        rate_hz = record_rate_hz(options.baud)
        self._clock = CountingClock(rate_hz, self._counts, "lost record")
        self._average = options.average or max(1, round(rate_hz / _READINGS_HZ))
        self._sums = [0.0] * 6
        self._summed = 0
        self._set_latency(
            (self._average - 1) / 2 * self._clock.period_ns + _BITS * 1e9 / options.baud
        )

    def _open(self) -> None:
        """Open the port, read and check the calibration, then start the stream."""
        self._line.open()
        self._settle(self._line)
        self._line.command(START_STREAM, "stream")
        self._stream.reset()
        self._clock.interrupt()
        self._summed = 0
        self._sums = [0.0] * 6

    def close(self) -> None:
        """Stop the stream and close the port; calling it twice is harmless."""
        self._line.close()

    def _settle(self, line: DigitalLine) -> None:
        try:
            status = line.read_registers(STATUS, 1)[0]
        except NoFrame:  # perhaps it still streams
            line.stop_stream()
            status = line.read_registers(STATUS, 1)[0]
        if status:
            raise MmtError(
                f"{self.name}: it reports {explain_status(status)}; check its supply and the "
                "transducer's cable, and switch it off and on"
            )
        start = calibration_start(self._options.calibration_number)
        stored = parse_calibration(line.read_registers(start, CALIBRATION_REGISTERS), self.name)
        check_calibration(self.name, stored, self._options)
        self._amplify(line, stored)
        self._set_matrix(stored.matrix, stored.limits)

    def _amplify(self, line: DigitalLine, stored: StoredCalibration) -> None:
        """Write the calibration's gains and offsets to the sensor if its own differ."""
        wanted = {GAINS: stored.gains, OFFSETS: stored.offsets}
        differing = {
            start: values
            for start, values in wanted.items()
            if tuple(line.read_registers(start, 6)) != values
        }
        if not differing:
            return
        line.command(UNLOCK, "unlock its settings")
        for start, values in differing.items():
            line.write_registers(start, values)
        line.command(LOCK, "lock its settings")
        self._counts["gauge settings written"] += 1

    def _explain_absence(self) -> str:
        if self._useless_ns:
            return self._explain_unusable()
        return f"{self.name}: it accepts to stream, but no record comes; {self._where()}"

    def _where(self) -> str:
        return "check the sensor's power and cable, and the adapter's"

    def _receive(self, now_ns: int) -> list[Stamped]:
        content = self._line.read()
        if not content:
            return []
        gauges = self._stream.feed(content)
        self._clock.arrive(len(gauges), now_ns)
        records = self._averaged(gauges)
        if not records:
            self._useless_ns = now_ns
        return records

    def _explain_unusable(self) -> str:
        broken_ms = 1e-6 * (self._useless_ns - self._arrival_ns)
        return (
            f"{self.name}: for {broken_ms:.0f} ms no record was usable "
            f"({self._counts['error bit']} with the error bit, {self._counts['wrong sum']} with a "
            "wrong sum so far): check the transducer's cable, the line's ends and shield, and "
            "'baud'"
        )

    def _averaged(self, gauges: list[Gauges | None]) -> list[Stamped]:
        """Return means of successive records, with the time of the last one."""
        records: list[Stamped] = []
        count, next_ns = self._average, self._clock.next
        u, v, w, x, y, z = self._sums
        summed = self._summed
        for record in gauges:
            time_ns = next_ns()
            if record is None:
                u = v = w = x = y = z = 0.0
                summed = 0
                continue
            a, b, c, d, e, f = record
            if max(record) == _HIGHEST or min(record) == _LOWEST:
                self._saturate()
            u, v, w, x, y, z = u + a, v + b, w + c, x + d, y + e, z + f
            summed += 1
            if summed == count:
                records.append(
                    (time_ns, (u / count, v / count, w / count, x / count, y / count, z / count))
                )
                u = v = w = x = y = z = 0.0
                summed = 0
        self._sums = [u, v, w, x, y, z]
        self._summed = summed
        return records
