"""Devices in software that use the protocols of the real ones, to test drivers and scenes."""

import random
from collections.abc import Callable

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
