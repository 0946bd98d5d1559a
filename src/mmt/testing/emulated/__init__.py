"""Devices in software with the protocols of the real ones, and the thread that runs them."""

import random
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

from mmt.core.arrays import Vector

Truth = Callable[[int], Vector]
"""True value for an emulated device: a vector in the channel's unit, at a time (ns) of the host's
monotonic clock."""


def with_flipped_bit(wire: bytes, generator: random.Random) -> bytes:
    """Return bytes with one random bit flipped."""
    bit = generator.randrange(8 * len(wire))
    broken = bytearray(wire)
    broken[bit // 8] ^= 1 << bit % 8
    return bytes(broken)


class FaultySending:
    """What sends packets, with faults on demand."""

    stuck = False
    """Whether it measures the same values again and again."""
    _random: random.Random
    _silent = False
    _flips = 0
    _cuts: Iterator[int] = iter(())

    def stall(self, *, silent: bool = True) -> None:
        """Send nothing of its own accord, or go on."""
        self._silent = silent

    def flip(self, packets: int = 1) -> None:
        """Flip a bit in each of the next packets, in none any more for 0."""
        self._flips = packets

    def cut(self, *lengths: int) -> None:
        """Cut the next packets to these lengths (bytes); 0 loses one."""
        self._cuts = iter(lengths)

    def _spoil(self, packet: bytes) -> bytes:
        """Return a packet with the faults that are due; nothing of one that is not sent."""
        if self._silent:
            return b""
        if self._flips:
            self._flips -= 1
            packet = with_flipped_bit(packet, self._random)
        return packet[: next(self._cuts, None)]


Turn = Callable[[int], int]
"""Does the work due at a monotonic time (ns), and returns the next due time."""

_IDLE_NS: Final = 10_000_000


class Clockwork:
    """A thread that calls the turn of each device when it is due.

    A device has a clockwork of its own, or shares that of a lab: its thread wakes once for all
    devices, and none waits for another's interpreter lock.

    Parameters
    ----------
    grid_ns
        Wake only at multiples of this time; 1 for whenever something is due.
    """

    def __init__(self, grid_ns: int = 1) -> None:
        self._grid_ns = grid_ns
        self._due: dict[Turn, int] = {}
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def add(self, turn: Turn) -> None:
        """Call a device's turn from now on."""
        with self._lock:
            self._due[turn] = 0
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="emulated devices", daemon=True
                )
                self._thread.start()

    def remove(self, turn: Turn) -> None:
        """Stop calling a turn; the thread ends with the last one. Calling it twice is harmless."""
        with self._lock:
            self._due.pop(turn, None)
            thread = None if self._due else self._thread
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._due:
                    self._thread = None
                    return
                now_ns = time.monotonic_ns()
                for turn, due_ns in tuple(self._due.items()):
                    if due_ns <= now_ns:
                        self._due[turn] = turn(now_ns)
                next_ns = min(*self._due.values(), now_ns + _IDLE_NS)
            next_ns += -next_ns % self._grid_ns
            time.sleep(max(0, next_ns - time.monotonic_ns()) / 1e9)
