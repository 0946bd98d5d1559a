"""The serial port of a board that plays samples: bytes in and out, without waiting."""

import os
from collections import Counter
from collections.abc import Sequence
from typing import Final

from mmt.devices.haptuator.framing import Decoder, Message, encode
from mmt.devices.serial_line import SerialLine

_LARGEST_BACKLOG: Final = 8192


class HaptuatorBoard(SerialLine):
    """Messages to and from a board.

    Parameters
    ----------
    port, baud_rate
        As in `mmt.devices.haptuator.serial_driver.HaptuatorSerialOptions`.
    """

    def __init__(self, port: str, baud_rate: int) -> None:
        super().__init__(f"Haptuator's board on {port}", port, baud_rate, write_timeout=0)
        self.faults: Counter[str] = Counter()
        """``bad frames``, ``bad checksums`` and ``other versions`` received, and ``dropped writes``
        of more than the port takes."""
        self._decoder = Decoder()
        self._backlog = bytearray()

    def open(self) -> None:
        """Open the port and discard its input buffer; see `SerialLine`."""
        super().open()
        self._decoder = Decoder()
        self._backlog = bytearray(b"\0")  # ends a frame that the board has half of

    def receive(self) -> Sequence[Message]:
        """Return the received messages; see `SerialLine.read`."""
        messages = self._decoder.feed(self.read())
        if self._decoder.faults:
            self.faults.update(self._decoder.faults)
            self._decoder.faults.clear()
        return messages

    def send(self, *messages: Message) -> None:
        """Send messages; bytes that the port does not take now go with the next ones.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        port, backlog = self._opened(), self._backlog
        for message in messages:
            backlog += encode(message)
        try:
            # pyserial's own write spins if the system's buffer is full
            sent = os.write(port.fileno(), backlog) if os.name == "posix" else port.write(backlog)
        except BlockingIOError:
            sent = 0
        except (OSError, TypeError) as error:
            raise self._lost(error) from error
        del backlog[:sent]
        if len(backlog) > _LARGEST_BACKLOG:
            self.faults["dropped writes"] += 1
            backlog[:] = b"\0"
