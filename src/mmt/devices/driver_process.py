"""A separate process for a device whose library would hold up a service's ticks.

Two pipes join the process with the driver that starts it, and neither end waits for the other. The
process ends when the driver's end of the pipes closes, which happens however the service ends.
"""

import contextlib
import json
import os
import pickle
import subprocess
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from io import BytesIO
from typing import Any, Final, Generic, NoReturn, TypeVar

from mmt.core.errors import DeviceLost, MmtError, short_message
from mmt.core.running.child_process import ChildProcess, Parent
from mmt.core.running.process import prefer_even_ticks

ENDED: Final = "ended"
"""Message: the process ends; the body is the reason as text."""
COUNT: Final = "count"
"""Message: a fault was tolerated; the body is its name as text."""
STATE: Final = "state"
"""Message: the state of the device; the body is as its driver has it."""
LOST: Final = "lost"
"""Message: the device gives nothing usable any more; the body is the reason as text."""

_LONGEST: Final = 4000
"""Bytes of a text: the system writes less than a page either whole or not at all."""
_AT_ONCE: Final = 1 << 16
_SILENT_READS: Final = 20
"""Empty reads that a loss needs too: a host that was held up does not mean a lost device."""
_CLOSE_S: Final = 4.0
_UNHEARD_CLOSE_S: Final = 0.5
"""For a process that has sent nothing yet: a call of its library may block for long."""

_KEPT: Final = 128
_FIRST_POLL_S: Final = 0.001

State = TypeVar("State")


class DriverPipes:
    """One end of the two pipes; it never waits for the other end.

    Parameters
    ----------
    receiving, sending
        File descriptors, which do not block from now on.
    """

    def __init__(self, receiving: int, sending: int) -> None:
        for file in (receiving, sending):
            os.set_blocking(file, False)
        self._receiving, self._sending = receiving, sending
        self._rest = b""  # of a message whose end has not come

    def receive(self) -> list[tuple[Any, ...]] | None:
        """Return the received messages, or None if the other end has gone."""
        try:
            data = os.read(self._receiving, _AT_ONCE)
        except BlockingIOError:
            return []
        if not data:
            return None
        messages, stream = [], BytesIO(self._rest + data)
        whole = 0
        with contextlib.suppress(EOFError, pickle.UnpicklingError):
            while True:
                messages.append(pickle.load(stream))  # noqa: S301 - from our own child or parent
                whole = stream.tell()
        self._rest = stream.getvalue()[whole:]
        return messages

    def send(self, kind: str, *body: Any) -> bool:
        """Send a message; return False if the pipe is full because the other end does not read.

        Raises
        ------
        BrokenPipeError
            The other end has gone.
        """
        cut = [
            each.encode()[:_LONGEST].decode(errors="ignore") if isinstance(each, str) else each
            for each in body
        ]
        try:
            os.write(self._sending, pickle.dumps((kind, *cut), pickle.HIGHEST_PROTOCOL))
        except BlockingIOError:
            return False
        return True


class DriverProcess(Generic[State]):
    """A process and the driver's end of its pipes; only `start` and `end` may block.

    Threads may share it: one connects the device again while another asks for its faults.

    Parameters
    ----------
    module
        Module to run; its ``main`` calls `run_process`.
    arguments
        Arguments of the process, as JSON has them.
    lost
        Reason to report if the process ends without one.
    silent
        That nothing has come, and what to check, for a message; and for how long at most (ms).
    counts
        The faults that the process tolerates are counted here, by name.
    """

    def __init__(
        self,
        module: str,
        arguments: dict[str, Any],
        lost: str,
        silent: tuple[str, str, float],
        counts: Counter[str],
    ) -> None:
        self._module, self._arguments, self._lost = module, arguments, lost
        self._silent, self._counts = silent, counts
        self.state: State | None = None
        """Newest state, or None before the first."""
        self.kept: deque[State] = deque(maxlen=_KEPT)
        """Newest states, the oldest first."""
        self.problem = ""
        """Why the device gives nothing usable any more; empty while it does."""
        self.ended: str | None = None
        """Why the process has ended, None while it runs."""
        self.child: ChildProcess | None = None
        self._pipes: DriverPipes | None = None
        self._lock = threading.Lock()
        self._arrival_ns = 0
        self._empty = 0
        self._heard = False

    def start(self) -> None:
        """Start the process."""
        self.child = child = ChildProcess(
            *("-m", self._module, json.dumps(self._arguments)),
            own_session=False,
            stderr=subprocess.DEVNULL,  # libraries write there what the pipe reports already
            bufsize=0,
        )
        self._pipes = DriverPipes(child.stdout.fileno(), child.stdin.fileno())
        self._arrival_ns = time.monotonic_ns()

    def await_state(self, patience_s: float, late: str) -> None:
        """Wait for the first state.

        Raises
        ------
        MmtError
            The process has ended, or no state has come in time, which `late` says.
        """
        deadline = time.monotonic() + patience_s
        while self.state is None:
            if time.monotonic() > deadline:
                raise MmtError(late)
            time.sleep(_FIRST_POLL_S)
            self.receive()
            if self.ended is not None:
                raise MmtError(self.ended)

    def receive(self) -> None:
        """Take the received messages, and keep what they say."""
        with self._lock:
            messages = [] if self._pipes is None else self._pipes.receive()
            if messages is None:
                self.ended = self.ended or self._lost
            elif messages:
                self._arrival_ns, self._empty, self._heard = time.monotonic_ns(), 0, True
                for message in messages:
                    self.keep(*message)
            else:
                self._empty += 1

    def read(self) -> State:
        """Return the newest state.

        Raises
        ------
        DeviceLost
            The process has ended, the device is lost, or nothing has come for a while.
        """
        self.receive()
        problem = self.problem if self.ended is None else self.ended
        if problem:
            raise DeviceLost(problem)
        nothing, advice, longest_ms = self._silent
        silent_ms = 1e-6 * self.silent_ns
        if self.state is None or silent_ms > longest_ms:
            raise DeviceLost(f"{nothing} for {silent_ms:.0f} ms: {advice}")
        return self.state

    def keep(self, kind: str, body: Any) -> None:
        """Keep what a message says; a subclass does so with those of its own kinds."""
        if kind == STATE:
            self.state = body
            self.kept.append(body)
        elif kind == LOST:
            self.problem = body
        elif kind == COUNT:
            self._counts[body] += 1
        elif kind == ENDED:
            self.ended = self.ended or body

    @property
    def silent_ns(self) -> int:
        """Time since the last message (ns); 0 until some reads in a row were empty."""
        return time.monotonic_ns() - self._arrival_ns if self._empty >= _SILENT_READS else 0

    def send(self, kind: str, *body: Any) -> None:
        """Send a command; it is dropped if the pipe is full."""
        with self._lock, contextlib.suppress(BrokenPipeError):
            if self._pipes is not None:  # None after `end`
                self._pipes.send(kind, *body)

    def end(self, reason: str) -> None:
        """Have the process release the device and end; calling it twice is harmless."""
        with self._lock:
            child, self.child, self._pipes = self.child, None, None
            if child is None:
                return
            self.ended = self.ended or reason
        # if it is killed, its connections end, which stops a device as well
        child.end(_CLOSE_S if self._heard else _UNHEARD_CLOSE_S)
        child.close()


def run_process(run: Callable[[dict[str, Any], DriverPipes], None], device: str) -> NoReturn:
    """Run the process of a device on standard input and output, then end at once.

    Parameters
    ----------
    run
        Called with the arguments and the pipes; it returns when the driver has gone. Its exceptions
        are reported to the driver.
    device
        Name of the device in messages.
    """
    driver = Parent()
    prefer_even_ticks()
    pipes = DriverPipes(0, driver.output.fileno())
    code = 1
    with contextlib.suppress(BrokenPipeError):  # the driver has gone
        try:
            run(json.loads(sys.argv[1]), pipes)
            code = 0
        except BrokenPipeError:
            raise
        except MmtError as error:
            pipes.send(ENDED, str(error))
        except Exception as error:  # noqa: BLE001 - whatever it is, the driver is told
            pipes.send(ENDED, f"the process of {device} failed: {short_message(error)}")
    os._exit(code)  # without waiting for threads of a library, which may hang
