"""Devices in software that use the protocols of the real ones, to test drivers and scenes."""

import random
from collections.abc import Callable, Iterator

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
