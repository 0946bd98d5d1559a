"""A separate process for a device whose library would hold up a service's ticks.

Two pipes join the process with the driver that starts it, and neither end waits for the other. The
process ends when the driver's end of the pipes closes, which happens however the service ends.
"""

import contextlib
import json
import os
import struct
import subprocess
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any, Final, Generic, NoReturn, TypeVar

from mmt.core.errors import MmtError, short_message
from mmt.core.running.child_process import ChildProcess, Parent
from mmt.core.running.process import prefer_even_ticks

ENDED: Final = b"E"
"""Message: the process ends; the body is the reason as text."""
COUNT: Final = b"N"
"""Message: a fault was tolerated; the body is its name as text."""
STATE: Final = b"S"
"""Message: the state of the device; the body is as its driver packs it."""
LOST: Final = b"L"
"""Message: the device gives nothing usable any more; the body is the reason as text."""

_HEADER: Final = struct.Struct("<cH")
_LONGEST: Final = 4000
"""Bytes of a message's body: the system writes less than a page either whole or not at all."""
_AT_ONCE: Final = 1 << 16
_SILENT_READS: Final = 20
"""Empty reads that a loss needs too: a host that was held up does not mean a lost device."""
_CLOSE_S: Final = 4.0
_UNHEARD_CLOSE_S: Final = 0.5
"""For a process that has sent nothing yet: a call of its library may block for long."""

_KEPT: Final = 128
_FIRST_POLL_S: Final = 0.001

Message = tuple[bytes, bytes]
"""Kind and body."""
State = TypeVar("State")


class DriverProcess(Generic[State]):
    """The driver's end of the pipes; only `start` and `end` may block.

    Threads may share it: one connects the device again while another asks for its faults.

    Parameters
    ----------
    module
        Module to run; its ``main`` calls `run_process`.
    arguments
        Arguments of the process, as JSON has them.
    lost
        Reason to report if the process ends without one.
    counts
        The faults that the process tolerates are counted here, by name.
    unpack
        Returns the state in the body of a `STATE` message.
    """

    def __init__(
        self,
        module: str,
        arguments: dict[str, Any],
        lost: str,
        counts: Counter[str],
        unpack: Callable[[bytes], State],
    ) -> None:
        self._module, self._arguments, self._lost = module, arguments, lost
        self._counts, self._unpack = counts, unpack
        self.state: State | None = None
        """Newest state, or None before the first."""
        self.kept: deque[State] = deque(maxlen=_KEPT)
        """Newest states, the oldest first."""
        self.problem = ""
        """Why the device gives nothing usable any more; empty while it does."""
        self.ended: str | None = None
        """Why the process has ended, None while it runs."""
        self.child: ChildProcess | None = None
        self._files = (-1, -1)
        self._received = bytearray()
        self._lock = threading.Lock()
        self._arrival_ns = 0
        self._empty = 0
        self._heard = False

    def start(self) -> None:
        """Start the process."""
        self.child = ChildProcess(
            *("-m", self._module, json.dumps(self._arguments)),
            own_session=False,
            stderr=subprocess.DEVNULL,  # libraries write there what the pipe reports already
            bufsize=0,
        )
        self._files = (self.child.stdin.fileno(), self.child.stdout.fileno())
        for file in self._files:
            os.set_blocking(file, False)
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

    def receive(self) -> list[Message]:
        """Take the received messages; return those of which nothing is kept here."""
        with self._lock:
            if self.child is None:
                return []
            try:
                data = os.read(self._files[1], _AT_ONCE)
            except BlockingIOError:
                self._empty += 1
                return []
            if not data:
                self.ended = self.ended or self._lost
                return []
            self._arrival_ns, self._empty, self._heard = time.monotonic_ns(), 0, True
            self._received += data
            return [message for message in _messages(self._received) if not self.keep(*message)]

    def keep(self, kind: bytes, body: bytes) -> bool:
        """Keep what a message says; return False for one of another kind."""
        if kind == STATE:
            self.state = self._unpack(body)
            self.kept.append(self.state)
        elif kind == LOST:
            self.problem = text_of(body)
        elif kind == COUNT:
            self._counts[text_of(body)] += 1
        elif kind == ENDED:
            self.ended = self.ended or text_of(body)
        else:
            return False
        return True

    @property
    def silent_ns(self) -> int:
        """Time since the last message (ns); 0 until some reads in a row were empty."""
        return time.monotonic_ns() - self._arrival_ns if self._empty >= _SILENT_READS else 0

    def send(self, command: bytes) -> None:
        """Send a command; it is dropped if the pipe is full."""
        with self._lock, contextlib.suppress(BlockingIOError, BrokenPipeError):
            if self.child is not None:  # None after `end`
                os.write(self._files[0], command)

    def end(self, reason: str) -> None:
        """Have the process release the device and end; calling it twice is harmless."""
        with self._lock:
            child, self.child = self.child, None
            if child is None:
                return
            self.ended = self.ended or reason
        # if it is killed, its connections end, which stops a device as well
        child.end(_CLOSE_S if self._heard else _UNHEARD_CLOSE_S)
        child.close()


class DriverPipes:
    """The process's end of the pipes.

    Parameters
    ----------
    commands, messages
        File descriptors, which do not block.
    """

    def __init__(self, commands: int, messages: int) -> None:
        self._commands, self._messages = commands, messages
        self._received = b""

    def receive(self, layout: struct.Struct) -> list[tuple[Any, ...]] | None:
        """Return the received commands, or None if the driver has gone."""
        try:
            data = os.read(self._commands, _AT_ONCE)
        except BlockingIOError:
            return []
        if not data:
            return None
        data = self._received + data
        whole = len(data) - len(data) % layout.size
        self._received = data[whole:]
        return list(layout.iter_unpack(data[:whole]))

    def send(self, kind: bytes, body: bytes | str = b"") -> bool:
        """Send a message; return False if the pipe is full because the driver does not read.

        Raises
        ------
        BrokenPipeError
            The driver has gone.
        """
        try:
            os.write(self._messages, _pack(kind, body))
        except BlockingIOError:
            return False
        return True


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
    messages = driver.output.fileno()
    prefer_even_ticks()
    os.set_blocking(0, False)
    os.set_blocking(messages, False)
    pipes = DriverPipes(0, messages)
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


def text_of(body: bytes) -> str:
    """Return the text of a message's body."""
    return body.decode(errors="replace")


def _pack(kind: bytes, body: bytes | str) -> bytes:
    data = body.encode()[:_LONGEST] if isinstance(body, str) else body
    return _HEADER.pack(kind, len(data)) + data


def _messages(received: bytearray) -> Iterator[Message]:
    """Yield the complete messages and remove them from the buffer."""
    while len(received) >= _HEADER.size:
        kind, size = _HEADER.unpack_from(received)
        end = _HEADER.size + size
        if len(received) < end:
            return
        body = bytes(received[_HEADER.size : end])
        del received[:end]
        yield kind, body
