"""The driver's end of the process that talks to an arm."""

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict
from typing import Any, Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import Vector
from mmt.devices.universal_robots import messages as to
from mmt.devices.universal_robots.messages import State
from mmt.devices.universal_robots.servo import ServoSettings

_CONNECT_S: Final = 15.0
_CLOSE_S: Final = 4.0
_SILENT_NS: Final = 700_000_000
_SILENT_READS: Final = 20
"""Reads without a state that a loss takes too: a host that was held up is no lost arm."""


class ArmLink:
    """A process that talks to an arm; nothing here waits but `start` and `end`.

    Parameters
    ----------
    host, frequency_hz
        Of the controller.
    servo
        How the arm is moved; None where it is read alone.

    Attributes
    ----------
    state
        The newest one.
    refusal
        Why the arm takes no commands, None while it does.
    """

    def __init__(self, host: str, frequency_hz: float, servo: ServoSettings | None) -> None:
        self._host = host
        self._arguments: dict[str, Any] = {
            "host": host,
            "frequency_hz": frequency_hz,
            "servo": None if servo is None else asdict(servo),
        }
        self.state: State | None = None
        self.refusal: str | None = f"the arm at {host} is not controlled: connect the robot first"
        self.counts: Counter[str] = Counter()
        """What was survived, by what it was."""
        self._ended: str | None = None
        self._received = bytearray()
        self._arrival_ns = 0
        self._empty = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._files = (-1, -1)

    def start(self) -> None:
        """Start the process and wait until the arm answers, and is controlled where it shall be.

        Raises
        ------
        MmtError
            It does not; the message says what to check.
        """
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [
                sys.executable, "-m", "mmt.devices.universal_robots.process",
                json.dumps(self._arguments),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # the library writes there what it told us already
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the service, which lets go of the arm first
        )  # fmt: skip
        assert self._process.stdin is not None  # noqa: S101 - a pipe was asked for
        assert self._process.stdout is not None  # noqa: S101 - likewise
        self._files = (self._process.stdin.fileno(), self._process.stdout.fileno())
        for file in self._files:
            os.set_blocking(file, False)
        try:
            self._await()
        except BaseException:
            self.end()
            raise

    def _await(self) -> None:
        controls = self._arguments["servo"] is not None
        deadline = time.monotonic() + _CONNECT_S
        while self.state is None or (controls and self.refusal is not None):
            left_s = deadline - time.monotonic()
            if left_s < 0.0:
                raise MmtError(
                    f"the UR controller at {self._host} has not answered for {_CONNECT_S:g} s: "
                    "check 'host', its cable and that it is switched on"
                )
            select.select([self._files[1]], [], [], left_s)
            self._poll()
            if self._ended is not None:
                raise MmtError(self._ended)
        self._arrival_ns = time.monotonic_ns()

    def read(self) -> State:
        """Return the newest state.

        Raises
        ------
        DeviceLost
            None has come for a while, or the process ended.
        """
        self._poll()
        if self._ended is not None:
            raise DeviceLost(self._ended)
        silent_ns = time.monotonic_ns() - self._arrival_ns
        if self._empty >= _SILENT_READS and silent_ns > _SILENT_NS:
            raise DeviceLost(
                f"nothing has come from the UR arm at {self._host} for {silent_ns / 1e6:.0f} ms: "
                "check its cable, and whether this machine has time for it"
            )
        if self.state is None:
            raise DeviceLost(f"nothing has come from the UR arm at {self._host} yet")
        return self.state

    def move(self, position_m: Vector) -> None:
        """Send the arm to a place of its base's frame (m)."""
        self._write(to.MOVE, position_m)

    def release(self) -> None:
        """Stop the arm and end its program; it is read on."""
        self._write(to.RELEASE, (0.0, 0.0, 0.0))
        self.refusal = f"the arm at {self._host} is not controlled: connect the robot first"

    def end(self) -> None:
        """Stop the arm and end the process; calling it twice is harmless."""
        process, self._process = self._process, None
        if process is None:
            return
        self._end(f"the UR arm at {self._host} is not connected")
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            process.kill()  # its connection ends, and the controller's watchdog stops the arm
            process.wait()

    def _write(self, kind: bytes, place: Vector) -> None:
        if self._process is None:
            return
        with contextlib.suppress(BlockingIOError, BrokenPipeError):  # `read` tells of its end
            os.write(self._files[0], to.COMMAND.pack(kind, *place))

    def _poll(self) -> None:
        """Take what has come."""
        if self._process is None:
            return
        try:
            data = os.read(self._files[1], 1 << 16)
        except BlockingIOError:
            self._empty += 1
            return
        if not data:
            self._end(
                f"the process that talks to the UR arm at {self._host} has ended, as the library "
                "may when its connection breaks: check the arm's cable, and that it is switched on"
            )
            return
        self._received += data
        for kind, body in to.messages(self._received):
            self._take(kind, body)

    def _take(self, kind: bytes, body: bytes) -> None:
        if kind == to.STATE:
            self.state = to.unpack_state(body)
            self._arrival_ns, self._empty = time.monotonic_ns(), 0
        elif kind == to.CONTROLLED:
            self.refusal = None
        elif kind == to.LOST:
            self.refusal = body.decode()
        elif kind == to.COUNT:
            self.counts[body.decode()] += 1
        else:
            self._end(body.decode())

    def _end(self, reason: str) -> None:
        self._ended = self.refusal = self._ended or reason
