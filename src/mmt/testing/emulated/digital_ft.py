"""A Digital F/T sensor in software, on a pseudo terminal."""

import time
from typing import Any, Final

import numpy as np

from mmt.devices.ati.digital_ft import record_rate_hz
from mmt.devices.ati.digital_wire import (
    CALIBRATION_REGISTERS,
    DEVICE,
    READ_REGISTERS,
    SIZE,
    STATUS,
    WRITE_REGISTERS,
    Gauges,
    calibration_start,
    checksum,
    frame,
    pack_calibration,
    pack_record,
)
from mmt.testing.emulated import Truth
from mmt.testing.emulated.serial_port import EmulatedSerialSensor

_COUNTS: Final = 1_000_000
_COUNTS_A_NEWTON: Final = 1000.0
_TIMER_NS: Final = 1_000_000
_ADAPTER_BYTES: Final = 62
"""A common adapter of USB to serial passes on this many bytes together, or what it has after a
millisecond."""
_JAM: Final = 14
_GAINS = (500, 501, 502, 503, 504, 505)
_OFFSETS = (2000, 2001, 2002, 2003, 2004, 2005)


class EmulatedDigitalFt(EmulatedSerialSensor):
    """Answer and stream as the sensor does, with faults on demand.

    Parameters
    ----------
    truth, baud
        As for `EmulatedSerialSensor`; the truth is the force (N).
    clock_ppm
        How much too fast its clock runs.
    noise_counts
        Standard deviation of a gauge's noise.
    """

    def __init__(
        self,
        truth: Truth,
        baud: int = 1_250_000,
        *,
        clock_ppm: float = 0.0,
        noise_counts: float = 2.0,
    ) -> None:
        self._rate = record_rate_hz(baud) * (1.0 + 1e-6 * clock_ppm) * 1e-9
        full_ns = round(_ADAPTER_BYTES / SIZE / self._rate)
        super().__init__(truth, baud, 1, min(full_ns, _TIMER_NS))
        self.registers: dict[int, int] = {STATUS: 0}
        """Registers by number; change them to emulate another sensor."""
        self.error = False
        """Set the error bit of the records that follow."""
        self._noise = noise_counts
        self._on_line_ns = round(11 * SIZE * 1e9 / baud)
        self._sent = 0
        self._began_ns: int | None = None  # start of its stream; None while it listens
        self._gauges: Gauges = (0, 0, 0, 0, 0, 0)
        self._unlocked = False
        self._store(_mixing_matrix())

    def _store(self, matrix: "np.ndarray[Any, np.dtype[np.float64]]") -> None:
        """Store a calibration: rows of counts of force and torque per gauge count."""
        ranges = (12.0, 12.0, 17.0, 120.0, 120.0, 120.0)
        registers = pack_calibration(
            "FT00018", "SI-12-0.12", matrix.tolist(), (2, 4), ranges, (_COUNTS, _COUNTS), _GAINS,
            _OFFSETS,
        )  # fmt: skip
        start = calibration_start(1)
        self.registers |= dict(
            zip(range(start, start + CALIBRATION_REGISTERS), registers, strict=True)
        )
        self._to_gauges = (np.linalg.inv(matrix)[:, :3] * _COUNTS).tolist()

    def unplug(self) -> None:
        """Remove the port; without power the sensor stops its stream."""
        super().unplug()
        self._began_ns = None

    def stream(self) -> None:
        """Stream as if a program had asked for it."""
        self._sent, self._began_ns = 0, time.monotonic_ns()

    def _step(self, due_ns: int, received: bytes) -> None:
        if self._began_ns is not None:
            if len(received) >= _JAM:
                self._began_ns = None
            else:
                self._stream(self._began_ns, due_ns)
            return
        if received and not self._understands():
            self._received = b""
            return
        self._received += received
        while len(self._received) >= 5:
            length = _request_length(self._received)
            if len(self._received) < length:
                break
            request, self._received = self._received[:length], self._received[length:]
            if request[0] != DEVICE or checksum(request[:-2]) != request[-2:]:
                self._received = b""
            elif not self.deaf:
                self._answer(request, due_ns)

    def _answer(self, request: bytes, now_ns: int) -> None:
        function = request[1]
        start, count = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
        if function == READ_REGISTERS:
            values = [self.registers.get(start + i, 0) for i in range(count)]
            content = b"".join(value.to_bytes(2, "big") for value in values)
            answer = bytes([2 * count]) + content
        elif function == WRITE_REGISTERS and self._unlocked:
            for i in range(count):
                self.registers[start + i] = int.from_bytes(request[7 + 2 * i : 9 + 2 * i], "big")
            answer = request[2:6]
        elif function == 0x6A:
            self._unlocked = request[2] == 0xAA
            answer = b"\x01"
        elif function == 0x46 and request[2] == 0x55:
            self._sent, self._began_ns = 0, now_ns
            answer = b"\x01"
        else:
            function, answer = function | 0x80, b"\x01"
        self.write(frame(DEVICE, function, answer))

    def _stream(self, began_ns: int, now_ns: int) -> None:
        due = max(0, int((now_ns - began_ns) * self._rate))
        numbers, self._sent = range(self._sent, due), due
        if self._silent or not numbers:
            return
        packet = b"".join(
            self._record(self.truth(began_ns + round((number + 1) / self._rate) - self._on_line_ns))
            for number in numbers
        )
        if self._garbage:
            packet, self._garbage = self._garbage + packet, b""
        self._send(packet)

    def _record(self, force: tuple[float, float, float]) -> bytes:
        if not self.stuck:
            x, y, z = force
            noise = self._random.gauss
            a, b, c, d, e, f = (
                max(min(round(p * x + q * y + r * z + noise(0, self._noise)), 32767), -32768)
                for p, q, r in self._to_gauges
            )
            self._gauges = (a, b, c, d, e, f)
        return self._spoil(pack_record(self._gauges, error=self.error))


def _request_length(received: bytes) -> int:
    if received[1] == READ_REGISTERS:
        return 8
    if received[1] == WRITE_REGISTERS:
        return 9 + (received[6] if len(received) > 6 else 0)
    return 5


def _mixing_matrix() -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Return a matrix like that of a Nano17: every gauge feels forces and torques."""
    geometry = np.array(
        [
            [0.0, 0.0, 0.0, 1.7, 0.0, -1.7],
            [0.0, -2.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 0.0, 1.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 7.0, 0.0, -7.0, 0.0],
            [-8.0, 0.0, 4.0, 0.0, 4.0, 0.0],
            [0.0, -4.0, 0.0, -4.0, 0.0, -4.0],
        ]
    )
    return geometry * (_COUNTS / _COUNTS_A_NEWTON)
