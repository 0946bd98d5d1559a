"""The serial line to a Digital F/T: requests and answers, then the bytes of the stream."""

import contextlib
import time
from typing import Final

import serial

from mmt.core.errors import MmtError
from mmt.devices.ati.digital_wire import (
    DEVICE,
    LONGEST_READ,
    NoFrame,
    answer_length,
    frame,
    parse_answer,
    read_request,
    registers_of,
    write_request,
)
from mmt.devices.serial_ports import SerialLine

_ANSWER_S: Final = 0.15
_ATTEMPTS: Final = 3
_JAM: Final = bytes(72)
_QUIET_S: Final = 0.5
"""Time that the device needs to stop its stream."""


class DigitalLine(SerialLine):
    """A line to a Digital F/T; see `SerialLine`."""

    def __init__(self, name: str, port: str, baud: int) -> None:
        super().__init__(name, port, baud, parity=serial.PARITY_EVEN, write_timeout=1)
        self._surplus = b""
        self._garbage = 0  # received bytes that were no answer

    def open(self) -> None:
        """Open the port; see `SerialLine`."""
        super().open()
        self._surplus = b""
        self._garbage = 0

    def read(self) -> bytes:
        """Return the received bytes without waiting; see `SerialLine`."""
        received, self._surplus = self._surplus + super().read(), b""
        return received

    def read_registers(self, start: int, count: int) -> list[int]:
        """Read registers, in as many requests as it takes.

        Raises
        ------
        MmtError
            No answer comes, or the device refuses.
        """
        values: list[int] = []
        while len(values) < count:
            number = min(LONGEST_READ, count - len(values))
            request = read_request(DEVICE, start + len(values), number)
            values += registers_of(self.ask(request))
        return values

    def write_registers(self, start: int, values: tuple[int, ...]) -> None:
        """Write registers; see `read_registers`."""
        self.ask(write_request(DEVICE, start, values))

    def command(self, command: tuple[int, int], action: str) -> None:
        """Send one of the device's own commands.

        Raises
        ------
        MmtError
            No answer comes, or the device does not accept it.
        """
        function, argument = command
        answer = self.ask(frame(DEVICE, function, bytes([argument])))
        if answer[0] != 1:
            raise MmtError(
                f"{self.name}: it does not accept to {action} (answer {answer[0]}); switch it off "
                "and on, then start again"
            )

    def ask(self, request: bytes) -> bytes:
        """Send a request and return the answer's content; keep the bytes after it for `read`.

        Raises
        ------
        MmtError
            No answer comes after three attempts, or the device refuses.
        """
        for _ in range(_ATTEMPTS):
            self.read()
            self.write(request)
            received = self._await(answer_length(request))
            try:
                content = parse_answer(request, received)
            except NoFrame:
                self._garbage += len(received)
                continue
            except MmtError as error:
                raise MmtError(f"{self.name}: {error}") from error
            self._surplus = received[answer_length(request) :]
            return content
        raise NoFrame(f"{self.name}: {self._explain_silence()}")

    def stop_stream(self) -> None:
        """Jam the line so that the device stops streaming, and wait until it listens again."""
        self.write(_JAM)
        time.sleep(_QUIET_S)
        self.read()

    def close(self) -> None:
        """Stop the stream and close; calling it twice is harmless."""
        if self._port is not None:
            with contextlib.suppress(OSError, MmtError):
                self.write(_JAM)
        super().close()

    def _await(self, length: int) -> bytes:
        received = b""
        end = time.monotonic() + _ANSWER_S + 11 * length / self._baud
        while time.monotonic() < end:
            received += self.read()
            if len(received) >= length or (len(received) >= 5 and received[1] & 0x80):
                break
            time.sleep(0.0005)
        return received

    def _explain_silence(self) -> str:
        if self._garbage:
            return (
                f"{self._garbage} bytes came that make no sense: check 'baud' (1250000 as shipped, "
                "also 115200 and 19200), and that nothing else drives the line"
            )
        return (
            f"it does not answer at {self._baud} baud: check its power, the cable, that A and B of "
            "the RS-485 adapter are not swapped, and 'baud'"
        )
