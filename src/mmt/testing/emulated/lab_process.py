"""Emulated devices in a process of their own.

The process starts when the first driver connects. It ends when the last one closes, or with the
present process.
"""

import gc
import sys
import threading
from collections.abc import Callable
from typing import Any, Final, Protocol

from mmt.core.errors import MmtError
from mmt.core.running.child_process import ChildProcess, Parent
from mmt.core.running.process import SWITCH_INTERVAL_S

_START_S: Final = 20.0
_END_S: Final = 5.0


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
    """Run the devices that the parent names, until it ends.

    Each name is answered by the device's options, or by the reason why there is no such device.
    """
    parent = Parent()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    started: list[LabDevice] = []
    for name in parent:
        try:
            one = device(name)
        except MmtError as error:
            parent.send(str(error))
            continue
        gc.freeze()  # a real device does not pause for garbage collection
        one.start()
        started.append(one)
        parent.send(one.options)
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
        self.process: ChildProcess | None = None
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
                if process is not None:
                    process.close()
                process = self.process = ChildProcess(
                    *("-m", self._module, *arguments), own_session=False, keeps_errors=True
                )
            if device not in self._addresses:
                self._addresses[device] = self._ask(process, device)
            self._users.add(id(user))
            return self._addresses[device]

    def release(self, user: object) -> None:
        """End the process after its last user."""
        with self._lock:
            self._users.discard(id(user))
            if not self._users and self.process is not None:
                self.process.end(_END_S)
                self.process.close()
                self.process = None

    def _ask(self, process: ChildProcess, device: str) -> dict[str, Any]:
        try:
            answer: dict[str, Any] | str = process.ask(device, _START_S)
        except EOFError:
            self.process = None
            process.end(_END_S)
            reason = process.close() or "it printed nothing"
            raise MmtError(f"the virtual lab does not start: {reason}") from None
        if isinstance(answer, str):
            raise MmtError(answer)
        return answer
