"""An emulated LabJack U6: a backend of pyusb, without libusb and without a device."""

import errno
import random
import struct
import threading
import time
from array import array
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final

import usb.core

from mmt.devices.labjack.board import BoardOptions, U6Voltages
from mmt.devices.labjack.packets import (
    BAD_CHECKSUM,
    BAD_STREAM,
    CONFIG_U6,
    DUMMY,
    GAINS,
    READ_CALIBRATION,
    RECOVERED,
    START_STREAM,
    STOP_STREAM,
    STREAM_CONFIG,
    STREAM_IS_ACTIVE,
    STREAM_NOT_RUNNING,
    StreamPacket,
    checksum8,
    command,
    encode_stream,
    is_sound,
)
from mmt.devices.labjack.scans import nominal_lines, write_lines
from mmt.devices.labjack.usb_link import PRODUCT, VENDOR
from mmt.testing.emulated import FaultySending
from mmt.testing.emulated.usb_backend import OneDeviceBackend, UsbHandle

ENDPOINTS: Final = (0x01, 0x82, 0x83)
_SLICE_S: Final = 0.0002


class EmulatedU6(OneDeviceBackend, FaultySending):
    """An emulated U6, given to the driver as its `backend`.

    Parameters
    ----------
    volts
        Voltages of the 14 inputs at a monotonic time (ns).
    serial
        Serial number.
    clock_ppm
        How much too fast its clock runs.
    """

    def __init__(
        self,
        volts: Callable[[int], Sequence[float]],
        *,
        serial: int = 360_000_001,
        clock_ppm: float = 0.0,
    ) -> None:
        super().__init__(VENDOR, PRODUCT, ENDPOINTS)
        self._volts = volts
        self._serial = serial
        self._lines = nominal_lines()
        self._blocks = write_lines(self._lines)
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._random = random.Random(serial)  # noqa: S311 - faults, no secret
        self._lock = threading.Lock()
        self._replies: list[bytes] = []
        self.table: list[tuple[int, int]] = []
        self._per_packet = 1
        self._period_s = 0.001
        self.streaming = False
        self._reset_stream()

    def unplug(self) -> None:
        """Take it away while it is open; its stream ends."""
        with self._lock:
            super().unplug()
            self.streaming = False
            self._replies.clear()

    def erase(self) -> None:
        """Lose the calibration memory."""
        self._blocks = [b"\xff" * 32 for _ in self._blocks]

    def overflow(self, scans: int) -> None:
        """Discard scans as after a full buffer, and report it."""
        self._overflow = scans

    def bulk_write(self, dev_handle: UsbHandle, ep: int, intf: int, data: Any, timeout: int) -> int:  # noqa: ARG002
        """Take a command and prepare its reply."""
        self.check(dev_handle)
        packet = bytes(data)
        with self._lock:
            self._replies.append(self._answer(packet))
        return len(packet)

    def bulk_read(self, dev_handle: UsbHandle, ep: int, intf: int, buff: Any, timeout: int) -> int:  # noqa: ARG002
        """Give a reply, or the stream's next packet, when it is due."""
        end = time.monotonic() + timeout / 1000.0
        while True:
            self.check(dev_handle)
            with self._lock:
                packet = self._next(ep)
                wait_s = self._until_due_s() if ep == ENDPOINTS[2] else _SLICE_S
            if packet:
                buff[: len(packet)] = array("B", packet)
                return len(packet)
            if time.monotonic() >= end:
                raise usb.core.USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)
            time.sleep(min(max(wait_s, 0.0), _SLICE_S))

    def _reset_stream(self) -> None:
        self._counter = self._scan = 0
        self._begun_ns = time.monotonic_ns()
        self._overflow = 0
        self.stall(silent=False)
        self.flip(0)
        self.cut()

    def _answer(self, packet: bytes) -> bytes:
        if packet in {START_STREAM, STOP_STREAM}:
            starting = packet == START_STREAM
            error = 0
            if starting == self.streaming:
                error = STREAM_IS_ACTIVE if starting else STREAM_NOT_RUNNING
            self.streaming = starting
            self._reset_stream()
            body = bytes((packet[1] + 1, error, 0))
            return bytes((checksum8(body),)) + body
        if len(packet) < 8 or not is_sound(packet):
            return BAD_CHECKSUM
        number, payload = packet[3], packet[6:]
        if number == CONFIG_U6:
            return command(number, bytes(9) + struct.pack("<IH", self._serial, 6) + bytes(17))
        if number == READ_CALIBRATION:
            return command(number, bytes(2) + self._blocks[payload[1]])
        if number == STREAM_CONFIG:
            return command(number, bytes((self._configure(payload), 0)))
        return command(number, bytes((1, 0)))

    def _configure(self, payload: bytes) -> int:
        """Take a stream's settings; return the error."""
        channels, _, per_packet, _, _, clock, interval = struct.unpack_from("<BBBBBBH", payload)
        table = list(struct.iter_unpack("<BB", payload[8:]))
        if channels != len(table) or not 1 <= per_packet <= 25 or not interval:
            return BAD_STREAM
        self.table, self._per_packet = table, per_packet
        self._period_s = interval / (48e6 if clock & 0x08 else 4e6)
        return 0

    def _next(self, endpoint: int) -> bytes:
        if endpoint == ENDPOINTS[1]:
            return self._replies.pop(0) if self._replies else b""
        while self.streaming and not self._silent and self._until_due_s() <= 0.0:
            wire = self._spoil(encode_stream(self._packet(self._per_packet // len(self.table))))
            if wire:
                return wire
        return b""

    def _until_due_s(self) -> float:
        """Return the time until the next packet is complete, by its last scan."""
        if not self.streaming or self._silent:
            return _SLICE_S
        last = self._scan + self._per_packet // len(self.table) - 1
        passed_s = (time.monotonic_ns() - self._begun_ns) * 1e-9
        return last * self._period_s / self._speed - passed_s

    def _packet(self, scans: int) -> StreamPacket:
        samples: list[int] = []
        missed, self._overflow = self._overflow, 0
        error = RECOVERED if missed else 0
        for _ in range(scans):
            if missed and not samples:
                samples += [DUMMY] * len(self.table)
                self._scan += missed
                continue
            at_ns = self._begun_ns + round(self._scan * self._period_s / self._speed * 1e9)
            volts = self._volts(at_ns)
            samples += [self._count(volts, number, options) for number, options in self.table]
            self._scan += 1
        self._counter, counter = (self._counter + 1) & 0xFF, self._counter
        return StreamPacket(counter, error, missed, tuple(samples))

    def _count(self, volts: Sequence[float], number: int, options: int) -> int:
        gain = (options >> 4) & 0x03
        value = volts[number] - (volts[number + 1] if options & 0x80 else 0.0)
        line = self._lines[gain]
        limit = 10.6 / GAINS[gain]
        value = min(max(value, -limit), limit)
        if value < 0.0:
            return max(round(line.centre - value / line.below_v), 0)
        return min(round(line.centre + value / line.above_v), DUMMY)


class EmulatedU6Voltages(U6Voltages):
    """The driver ``labjack-u6`` at an emulated U6, which is set before it is made."""

    at: ClassVar[Any] = None

    def __init__(self, options: BoardOptions) -> None:
        super().__init__(options, self.at)
