"""Emulated devices in a process of their own.

The process starts when the first driver connects. It ends when the last one closes, or with the
present process.
"""

import json
import select
import subprocess
import threading
from typing import Any, Final

from mmt.core.errors import MmtError
from mmt.core.programs import python_command

_START_S: Final = 20.0


class LabProcess:
    """The process of a lab, shared by the drivers of the present process.

    Parameters
    ----------
    module
        Module that runs the lab. It prints its devices' addresses as a line of JSON, further ones
        when a line of its standard input names them, and ends with that input.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._lock = threading.Lock()
        self._users: set[int] = set()
        self.process: subprocess.Popen[str] | None = None
        self._addresses: dict[str, dict[str, Any]] = {}

    def acquire(self, user: object, *arguments: str) -> dict[str, dict[str, Any]]:
        """Start the process unless it runs; return the addresses."""
        with self._lock:
            if self.process is None or self.process.poll() is not None:
                self._users.clear()
                if self.process is not None:  # its pipes are still open
                    self._end(self.process)
                self._start(arguments)
            self._users.add(id(user))
            return self._addresses

    def address(self, user: object, device: str, *arguments: str) -> dict[str, Any]:
        """Start the process and the device in it unless they run; return the device's address."""
        self.acquire(user, *arguments)
        with self._lock:
            if device not in self._addresses and self.process is not None:
                assert self.process.stdin is not None  # noqa: S101 - a pipe was asked for
                self.process.stdin.write(device + "\n")
                self.process.stdin.flush()
                self._addresses |= self._answer(self.process)
            return self._addresses[device]

    def release(self, user: object) -> None:
        """End the process after its last user."""
        with self._lock:
            self._users.discard(id(user))
            if not self._users and self.process is not None:
                self._end(self.process)
                self.process = None

    def _start(self, arguments: tuple[str, ...]) -> None:
        self.process = subprocess.Popen(  # noqa: S603 - our own module
            python_command("-m", self._module, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,  # Ctrl-C is for the service
        )
        self._addresses = self._answer(self.process)

    def _answer(self, process: "subprocess.Popen[str]") -> dict[str, dict[str, Any]]:
        """Return the addresses in the next line that the process prints."""
        output = process.stdout
        assert output is not None  # noqa: S101 - a pipe was asked for
        line = output.readline() if select.select([output], [], [], _START_S)[0] else ""
        if not line:
            reason = self._end(process)
            self.process = None
            raise MmtError(f"the virtual lab does not start: {reason or 'it printed nothing'}")
        addresses: dict[str, dict[str, Any]] = json.loads(line)
        return addresses

    def _end(self, process: "subprocess.Popen[str]") -> str:
        """End the process and return the last line of its standard error."""
        try:
            _, output = process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            _, output = process.communicate()
        lines = output.strip().splitlines()
        return lines[-1] if lines else ""
