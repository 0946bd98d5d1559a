"""Emulated devices in a process of their own.

The process starts when the first driver connects. It ends when the last one closes, or with the
present process.
"""

import gc
import json
import select
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Protocol

from mmt.core.errors import MmtError
from mmt.core.running.process import SWITCH_INTERVAL_S
from mmt.core.running.programs import python_command

_START_S: Final = 20.0


class LabDevice(Protocol):
    """An emulated device of a lab."""

    @property
    def options(self) -> dict[str, Any]:
        """Options by which its driver finds it."""

    def start(self) -> None:
        """Begin to measure, and to answer."""

    def stop(self) -> None:
        """End it."""


def run_lab(device: Callable[[str], LabDevice]) -> None:
    """Run the devices that lines of standard input name, until it ends.

    Each line is answered by a line of JSON with the device's options, or with the reason why there
    is no such device.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    started: list[LabDevice] = []
    for line in sys.stdin:
        try:
            one = device(line.strip())
        except MmtError as error:
            answer: dict[str, Any] = {"problem": str(error)}
        else:
            gc.freeze()  # a real device does not pause for garbage collection
            one.start()
            started.append(one)
            answer = {"options": one.options}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    for one in reversed(started):
        one.stop()


class LabProcess:
    """The process of a lab, shared by the drivers of the present process.

    Parameters
    ----------
    module
        Module that calls `run_lab`.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._lock = threading.Lock()
        self._users: set[int] = set()
        self.process: subprocess.Popen[str] | None = None
        self._addresses: dict[str, dict[str, Any]] = {}

    def address(self, user: object, device: str, *arguments: str) -> dict[str, Any]:
        """Start the process and the device in it unless they run; return the device's options.

        Raises
        ------
        MmtError
            The process does not start, or has no such device.
        """
        with self._lock:
            process = self.process
            if process is None or process.poll() is not None:
                self._users.clear()
                self._addresses.clear()
                if process is not None:  # its pipes are still open
                    _end(process)
                process = self.process = self._start(arguments)
            if device not in self._addresses:
                self._addresses[device] = self._ask(process, device)
            self._users.add(id(user))
            return self._addresses[device]

    def release(self, user: object) -> None:
        """End the process after its last user."""
        with self._lock:
            self._users.discard(id(user))
            if not self._users and self.process is not None:
                _end(self.process)
                self.process = None

    def _start(self, arguments: tuple[str, ...]) -> "subprocess.Popen[str]":
        return subprocess.Popen(  # noqa: S603 - our own module
            python_command("-m", self._module, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,  # Ctrl-C is for the service
        )

    def _ask(self, process: "subprocess.Popen[str]", device: str) -> dict[str, Any]:
        assert process.stdin is not None  # noqa: S101 - a pipe was asked for
        assert process.stdout is not None  # noqa: S101 - likewise
        with suppress(BrokenPipeError):  # it has ended, and its last words say why
            process.stdin.write(device + "\n")
            process.stdin.flush()
        ready = select.select([process.stdout], [], [], _START_S)[0]
        line = process.stdout.readline() if ready else ""
        if not line:
            self.process = None
            reason = _end(process) or "it printed nothing"
            raise MmtError(f"the virtual lab does not start: {reason}")
        answer: dict[str, Any] = json.loads(line)
        if "problem" in answer:
            raise MmtError(answer["problem"])
        options: dict[str, Any] = answer["options"]
        return options


def _end(process: "subprocess.Popen[str]") -> str:
    """End the process and return the last line of its standard error."""
    try:
        _, output = process.communicate(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        _, output = process.communicate()
    lines = output.strip().splitlines()
    return lines[-1] if lines else ""
