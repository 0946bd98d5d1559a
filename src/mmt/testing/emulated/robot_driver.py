"""The driver of the robot behind datagrams; see `robot_link`."""

import select
import socket
import time
from typing import Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import Vector
from mmt.testing.emulated.robot_link import NO_COMMAND, PACKET

_ANSWER_S: Final = 2.0
_SILENT_READS: Final = 100


class DatagramRobot:
    """A `Robot` at a port of this machine.

    Parameters
    ----------
    port
        Of its `RobotLink`.
    """

    def __init__(self, port: int) -> None:
        self.own_ns = 0
        """Processor time of `read` and `write` so far, which a real arm's would be instead."""
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
            raise DeviceLost("the virtual robot says nothing: its lab has ended")
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
