"""Serial line to a sensor by Bota Systems: commands, answers, and bytes of the stream."""

import time
from typing import Final

from mmt.core.errors import MmtError
from mmt.devices.serial_line import SerialLine
from mmt_devices.bota.frames import ANSWER

_ANSWER_S: Final = 0.5
_ATTEMPTS: Final = 4
"""Number of attempts, enough for a sensor that was just switched on to start up."""
_BETWEEN_BYTES_S: Final = 0.005
"""Pause between bytes of a command, as in the vendor's driver; commands have no end mark."""
_KEPT: Final = 8192


class NoAnswer(MmtError):  # noqa: N818 - its message names what came
    """The sensor has not answered a command."""


class BotaLine(SerialLine):
    """Line to a sensor; see `SerialLine`."""

    def __init__(self, name: str, port: str, baud: int) -> None:
        super().__init__(name, port, baud, write_timeout=1)
        self.received = bytearray()
        """Newest bytes received, for explaining faults."""

    def open(self) -> None:
        """Open the port; see `SerialLine`."""
        super().open()
        self.received.clear()

    def note(self, content: bytes) -> None:
        """Add bytes to `received`, of which the newest are kept."""
        self.received += content
        del self.received[:-_KEPT]

    def command(self, command: str) -> None:
        """Send a command and await its answer; frames that arrive meanwhile are discarded.

        Raises
        ------
        NoAnswer
            No answer came in four attempts.
        MmtError
            The sensor refuses the command.
        """
        for _ in range(_ATTEMPTS):
            self.note(self.read())
            self._send(command)
            code = self._await_answer(command[0])
            if code == "0":
                return
            if code:
                raise MmtError(
                    f"{self.name}: it refuses the command {command!r} (code {code}): "
                    "switch it off and on, or leave its settings with configure = false"
                )
        raise NoAnswer(f"{self.name}: it does not answer the command {command!r}")

    def _send(self, command: str) -> None:
        for character in command:
            self.write(character.encode("ascii"))
            time.sleep(_BETWEEN_BYTES_S)

    def _await_answer(self, command: str) -> str:
        """Return the code of the answer to a command, empty if none came."""
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
