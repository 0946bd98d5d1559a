"""A robot behind datagrams of three doubles (mm): a command sets it, positions come back.

Whoever has sent something last, be it empty, is sent the position every millisecond.
"""

import socket
import struct
import threading
import time
from typing import Any, Final, Protocol

from mmt.devices.protocols import Vector

PACKET: Final = struct.Struct("<3d")
NO_COMMAND: Final = b""
"""Asks for positions without commanding one."""

_PERIOD_NS: Final = 1_000_000


class Tip(Protocol):
    """What moves at the other end."""

    command_mm: Vector | None

    def position_mm(self, time_ns: int) -> Vector:
        """Return where it is."""


class RobotLink:
    """The robot's end of the datagrams."""

    def __init__(self, tip: Tip) -> None:
        self._tip = tip
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._peer: Any = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def stop(self) -> None:
        """End, and give the port back."""
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        due_ns = time.monotonic_ns()
        while not self._ended.is_set():
            due_ns = max(due_ns + _PERIOD_NS, time.monotonic_ns() - 10 * _PERIOD_NS)
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            self._take()
            if self._peer is not None:
                position = self._tip.position_mm(time.monotonic_ns())
                try:
                    self._socket.sendto(PACKET.pack(*position), self._peer)
                except OSError:
                    self._peer = None  # it is gone

    def _take(self) -> None:
        while True:
            try:
                packet, self._peer = self._socket.recvfrom(64)
            except OSError:  # nothing more, or the peer's port is closed
                return
            if len(packet) == PACKET.size:
                command: Vector = PACKET.unpack(packet)
                self._tip.command_mm = command
