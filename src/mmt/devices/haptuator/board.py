"""The serial port of a board that plays samples: bytes in and out, without waiting."""

import os
from collections import Counter
from collections.abc import Sequence
from typing import Final

import serial

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.haptuator.framing import Decoder, Message, encode
from mmt.devices.serial_ports import close_port, empty_port, open_port, read_waiting

_AT_ONCE: Final = 16384
_LARGEST_BACKLOG: Final = 8192


class HaptuatorBoard:
    """Messages to and from a board.

    Parameters
    ----------
    port, baud_rate
        As in `mmt.devices.haptuator.serial_driver.HaptuatorSerialOptions`.
    """

    def __init__(self, port: str, baud_rate: int) -> None:
        self.name = f"Haptuator's board on {port}"
        self.faults: Counter[str] = Counter()
        """``bad frames``, ``bad checksums`` and ``other versions`` received, and ``dropped writes``
        of more than the port takes."""
        self._path = port
        self._baud_rate = baud_rate
        self._port: serial.Serial | None = None
        self._decoder = Decoder()
        self._backlog = bytearray()

    def open(self) -> None:
        """Open the port and discard its input buffer.

        Raises
        ------
        MmtError
            The port is missing, in use by another program, or not permitted.
        """
        self.close()
        try:
            self._port = open_port(self._path, self._baud_rate, write_timeout=0)
        except MmtError as error:
            raise MmtError(f"{self.name}: {error}") from error
        empty_port(self._port)
        self._decoder = Decoder()
        self._backlog = bytearray(b"\0")  # ends a frame that the board has half of

    def receive(self) -> Sequence[Message]:
        """Return the received messages.

        Raises
        ------
        DeviceLost
            The port is not open, or the board was unplugged.
        """
        try:
            received = read_waiting(self._opened(), _AT_ONCE)
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._gone() from error
        messages = self._decoder.feed(received)
        if self._decoder.faults:
            self.faults.update(self._decoder.faults)
            self._decoder.faults.clear()
        return messages

    def send(self, *messages: Message) -> None:
        """Send messages; bytes that the port does not take now go with the next ones.

        Raises
        ------
        DeviceLost
            The port is not open, or the board was unplugged.
        """
        port, backlog = self._opened(), self._backlog
        for message in messages:
            backlog += encode(message)
        try:
            # pyserial's own write spins if the system's buffer is full
            sent = os.write(port.fileno(), backlog) if os.name == "posix" else port.write(backlog)
        except BlockingIOError:
            sent = 0
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._gone() from error
        del backlog[:sent]
        if len(backlog) > _LARGEST_BACKLOG:
            self.faults["dropped writes"] += 1
            backlog[:] = b"\0"

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        port, self._port = self._port, None
        close_port(port)

    def _opened(self) -> serial.Serial:
        if self._port is None:
            raise DeviceLost(f"the {self.name} is closed: connect it again")
        return self._port

    def _gone(self) -> DeviceLost:
        return DeviceLost(
            f"the {self.name} is gone: plug it in again, and check that no other program uses the "
            "port"
        )
