"""A robot behind datagrams of three doubles (mm), and its driver."""

import select
import socket
import struct
import time
from typing import TYPE_CHECKING, Any, Final, Protocol

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.testing.emulated import Clockwork

if TYPE_CHECKING:
    from mmt.testing.emulated.lab import World

PACKET: Final = struct.Struct("<3d")
NO_COMMAND: Final = b""
"""Asks for positions without commanding one."""

_PERIOD_NS: Final = 1_000_000


class Tip(Protocol):
    """The tip that the datagrams move."""

    command_mm: Vector | None

    def position_mm(self, time_ns: int) -> Vector:
        """Return its position."""


class RobotLink:
    """The robot's end of the datagrams."""

    def __init__(self, tip: Tip, clockwork: Clockwork | None = None) -> None:
        self._tip = tip
        self._clockwork = clockwork or Clockwork()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._peer: Any = None
        self._due_ns = 0

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds it."""
        return {"port": self.port}

    def start(self) -> None:
        """Begin to listen."""
        self._due_ns = time.monotonic_ns()
        self._clockwork.add(self._turn)

    def stop(self) -> None:
        """Stop, and close the port."""
        self._clockwork.remove(self._turn)
        self._socket.close()

    def _turn(self, now_ns: int) -> int:
        self._take()
        if self._peer is not None:
            position = self._tip.position_mm(time.monotonic_ns())
            try:
                self._socket.sendto(PACKET.pack(*position), self._peer)
            except OSError:
                self._peer = None  # it is gone
        self._due_ns = max(self._due_ns + _PERIOD_NS, now_ns - 10 * _PERIOD_NS)
        return self._due_ns

    def _take(self) -> None:
        while True:
            try:
                packet, self._peer = self._socket.recvfrom(64)
            except OSError:  # nothing more, or the peer's port is closed
                return
            if len(packet) == PACKET.size:
                command: Vector = PACKET.unpack(packet)
                self._tip.command_mm = command


_ANSWER_S: Final = 2.0
_SILENT_READS: Final = 100


class DatagramRobot:
    """A `Robot` at a port of this machine.

    Parameters
    ----------
    port
        Port of its `RobotLink`.
    """

    def __init__(self, port: int) -> None:
        self.own_ns = 0
        """Processor time of `read` and `write` so far; a real arm's driver has its own instead."""
        self._port = port
        self._socket: socket.socket | None = None
        self._position: Vector | None = None
        self._empty = 0

    def connect(self) -> None:
        """Wait for the first position."""
        self.close()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", self._port))
        self._socket.setblocking(False)
        self._socket.send(NO_COMMAND)
        select.select([self._socket], [], [], _ANSWER_S)
        self._drain(self._socket)
        if self._position is None:
            raise MmtError("the virtual robot does not answer: end what loads this machine")

    def calibrate(self) -> None:
        """Do nothing: it is calibrated."""

    def read(self) -> Vector:
        """Return the newest position (mm)."""
        if self._socket is None or self._position is None:
            raise DeviceLost("the virtual robot is not connected")
        began_ns = time.thread_time_ns()
        self._drain(self._socket)
        self.own_ns += time.thread_time_ns() - began_ns
        if self._empty > _SILENT_READS:
            raise DeviceLost("the virtual robot sends nothing: its lab has ended")
        return self._position

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        if self._socket is None:
            raise DeviceLost("the virtual robot is not connected")
        began_ns = time.thread_time_ns()
        try:
            self._socket.send(PACKET.pack(*position_mm))
        except BlockingIOError:
            return  # the next one is newer anyhow
        except OSError as error:
            raise DeviceLost(f"the virtual robot is gone: {error}") from error
        finally:
            self.own_ns += time.thread_time_ns() - began_ns

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        if self._socket is not None:
            self._socket.close()
            self._socket = self._position = None
            self._empty = 0

    def _drain(self, link: socket.socket) -> None:
        self._empty += 1
        try:
            while len(packet := link.recv(64)) == PACKET.size:
                self._position = PACKET.unpack(packet)
                self._empty = 0
        except BlockingIOError:
            return
        except OSError as error:
            raise DeviceLost(f"the virtual robot is gone: {error}") from error


def in_lab(world: "World", _seed: int, clockwork: Clockwork) -> RobotLink:
    """Return the robot of the virtual lab."""
    world.take_robot()
    return RobotLink(world, clockwork)
