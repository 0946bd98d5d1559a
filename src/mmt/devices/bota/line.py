"""The serial line to a sensor by Bota Systems: commands and answers, then bytes as they come."""

import time
from typing import Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.bota.frames import ANSWER
from mmt.devices.serial_ports import close_port, open_port, read_waiting

_ANSWER_S: Final = 0.5
_ATTEMPTS: Final = 4
"""So long that a sensor which has just got its power has started in between."""
_BETWEEN_BYTES_S: Final = 0.005
"""The vendor's driver sends commands no faster; they have no end mark."""
_AT_ONCE: Final = 4096
_KEPT: Final = 8192


class NoAnswer(MmtError):  # noqa: N818 - its message names what came
    """The sensor has not answered a command."""


class BotaLine:
    """The line, once it is open.

    Parameters
    ----------
    port
        As ``/dev/ttyUSB0``.
    baud
        Bits a second.
    name
        What a person calls the device.

    Raises
    ------
    MmtError
        The port cannot be opened.
    """

    def __init__(self, port: str, baud: int, name: str) -> None:
        self._name = name
        self.received = bytearray()
        """The newest bytes that came, for saying what is wrong."""
        try:
            self._serial = open_port(port, baud, write_timeout=1)
        except MmtError as error:
            raise MmtError(f"{name}: its serial port: {error}") from error

    def read(self) -> bytes:
        """Return what has come, without waiting.

        Raises
        ------
        DeviceLost
            The port is gone.
        """
        try:
            return read_waiting(self._serial, _AT_ONCE)
        except (OSError, TypeError) as error:  # TypeError: pyserial, when it is closed meanwhile
            raise self._lost(error) from error

    def note(self, content: bytes) -> None:
        """Keep bytes for saying what is wrong, the newest of them."""
        self.received += content
        del self.received[:-_KEPT]

    def command(self, command: str) -> None:
        """Send a command and await its answer; frames that come meanwhile are thrown away.

        Raises
        ------
        NoAnswer
            None came after four attempts.
        MmtError
            The sensor refuses.
        """
        for _ in range(_ATTEMPTS):
            self.note(self.read())
            self._write(command)
            code = self._await_answer(command[0])
            if code == "0":
                return
            if code:
                raise MmtError(
                    f"{self._name}: it refuses the command {command!r} (code {code}): "
                    "switch it off and on, or leave its settings with configure = false"
                )
        raise NoAnswer(f"{self._name}: it does not answer the command {command!r}")

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        close_port(self._serial)

    def _write(self, command: str) -> None:
        try:
            for character in command:
                self._serial.write(character.encode("ascii"))
                time.sleep(_BETWEEN_BYTES_S)
        except OSError as error:
            raise self._lost(error) from error

    def _await_answer(self, command: str) -> str:
        """Return the code of the answer to a command, empty where none came."""
        received = b""
        end = time.monotonic() + _ANSWER_S
        while time.monotonic() < end:
            content = self.read()
            self.note(content)
            received += content
            for answer in ANSWER.finditer(received):
                if answer[1] == command.encode("ascii"):
                    return answer[2].decode("ascii")
            time.sleep(0.001)
        return ""

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(f"{self._name}: the port is gone ({error}); plug the adapter in again")
