"""From a U6's counts to volts, by the calibration in its memory."""

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from mmt.devices.labjack.packets import GAINS

BLOCKS: Final = 4
"""Blocks of 32 bytes at the beginning of the calibration memory that hold the inputs' values."""

_NOMINAL_V: Final = 3.1580578e-4
"""A count at gain 1."""
_CENTRE: Final = 33523.0
_TOLERANCE: Final = 0.05


class Line(NamedTuple):
    """Two straight lines that meet at the centre."""

    centre: float
    """Count at 0 V."""
    above_v: float
    """Volts a count above the centre."""
    below_v: float
    """Volts a count below it, negative as it is stored: by how much the volts fall."""

    def volts(self, count: int) -> float:
        """Return the volts of a count of 16 bits."""
        if count < self.centre:
            return (self.centre - count) * self.below_v
        return (count - self.centre) * self.above_v


def nominal_lines() -> tuple[Line, ...]:
    """Return what the vendor gives for a U6 without calibration, by the gain's index."""
    return tuple(Line(_CENTRE, _NOMINAL_V / gain, -_NOMINAL_V / gain) for gain in GAINS)


def read_lines(blocks: Sequence[bytes]) -> tuple[Line, ...]:
    """Return the lines of the four gains from the first four blocks.

    Raises
    ------
    ValueError
        The values are not near the nominal ones, as in a memory that was erased.
    """
    numbers = [
        whole + fraction / 2**32
        for block in blocks
        for fraction, whole in struct.iter_unpack("<Ii", block[:32])
    ]
    lines = tuple(
        Line(numbers[8 + 2 * index + 1], numbers[2 * index], numbers[8 + 2 * index])
        for index in range(len(GAINS))
    )
    for line, nominal in zip(lines, nominal_lines(), strict=True):
        for value, expected in zip(line, nominal, strict=True):
            if abs(value / expected - 1.0) > _TOLERANCE:
                raise ValueError(
                    f"its calibration memory holds {value:.6g} where about {expected:.6g} belongs"
                )
    return lines


def write_lines(lines: Sequence[Line]) -> list[bytes]:
    """Return the blocks that hold the lines; offsets, which nothing uses, are zero."""
    numbers = [value for line in lines for value in (line.above_v, 0.0)]
    numbers += [value for line in lines for value in (line.below_v, line.centre)]
    packed = b"".join(struct.pack("<q", round(value * 2**32)) for value in numbers)
    return [packed[at : at + 32] for at in range(0, len(packed), 32)]
