"""A UDP socket that knows when its newest packet came, by the kernel's stamp if there is one."""

import contextlib
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import Final

_SO_TIMESTAMPNS: Final = 35
"""Number of the option on 64-bit Linux; `socket` does not name it. The kernel starts stamping some
milliseconds later: until then the stamp is the time at which the packet is read."""
_STAMP: Final = struct.Struct("qq")
"""Seconds and nanoseconds of the wall clock."""
_ROOM: Final = 64
_STAMPED_OF: Final = 8
"""One look in this many reads the stamps: enough to estimate a clock. Such a look takes
twice as long."""


class StampedSocket:
    """Receives packets into a buffer, without waiting, some with their arrival time.

    The kernel's stamp is the true arrival time even if the program was busy with something else.

    Parameters
    ----------
    udp
        A socket that does not block; the caller closes it.
    """

    def __init__(self, udp: socket.socket) -> None:
        self._udp = udp
        self._stamp = b""
        self._stamps = False
        self._looks = 0
        if sys.platform == "linux" and struct.calcsize("P") == 8:
            with contextlib.suppress(OSError):
                udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
                self._stamps = True

    def receiver(self) -> Callable[[bytearray], int]:
        """Return the function that receives the waiting packets, one in each call.

        The function takes a buffer and returns the packet's length. It raises `BlockingIOError`
        if no packet waits, and another `OSError` if the network reports an error.
        """
        self._stamp = b""
        self._looks = (self._looks + 1) % _STAMPED_OF
        return self._receive_stamped if self._stamps and not self._looks else self._udp.recv_into

    def _receive_stamped(self, buffer: bytearray) -> int:
        size, ancillary, _, _ = self._udp.recvmsg_into((buffer,), _ROOM)
        self._stamp = ancillary[0][2] if ancillary else b""
        return size

    def arrival_ns(self, earliest_ns: int) -> int:
        """Return the arrival time (ns, monotonic clock) of the last look's newest packet.

        Parameters
        ----------
        earliest_ns
            A time before the packet came; an earlier stamp, as after the wall clock was set, is
            ignored. Without a usable stamp the time of this call is returned.
        """
        if len(self._stamp) != _STAMP.size:
            return time.monotonic_ns()
        wall_ns = time.time_ns()
        now_ns = time.monotonic_ns()  # after it: a pause in between must not make the arrival early
        seconds, nanoseconds = _STAMP.unpack(self._stamp)
        arrival_ns = now_ns - (wall_ns - 1_000_000_000 * int(seconds) - int(nanoseconds))
        return arrival_ns if earliest_ns <= arrival_ns <= now_ns else now_ns
