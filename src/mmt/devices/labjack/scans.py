"""Scans of a LabJack U6: packets of the stream to voltages, by the box's own calibration."""

import struct
from collections import Counter
from collections.abc import Sequence
from typing import Final, NamedTuple

from mmt.devices.labjack.packets import (
    DUMMY,
    GAINS,
    RECOVERED,
    RECOVERING,
    Scanning,
    StreamPacket,
    decode_stream,
)
from mmt.devices.protocols import VoltageReading

BLOCKS: Final = 4
"""Blocks of 32 bytes at the start of the calibration memory that hold the inputs' values."""

_NOMINAL_V: Final = 3.1580578e-4
"""Volts per count at gain 1."""
_CENTRE: Final = 33523.0
_TOLERANCE: Final = 0.05


class CentredLines(NamedTuple):
    """Two straight lines from counts to volts that meet at the centre."""

    centre: float
    """Count at 0 V."""
    above_v: float
    """Volts per count above the centre."""
    below_v: float
    """Volts per count below the centre, negative as in the calibration memory."""

    def volts(self, count: int) -> float:
        """Return the volts of a count of 16 bits."""
        if count < self.centre:
            return (self.centre - count) * self.below_v
        return (count - self.centre) * self.above_v


def nominal_lines() -> tuple[CentredLines, ...]:
    """Return the vendor's values for a U6 without calibration, by the gain's index."""
    return tuple(CentredLines(_CENTRE, _NOMINAL_V / gain, -_NOMINAL_V / gain) for gain in GAINS)


def read_lines(blocks: Sequence[bytes]) -> tuple[CentredLines, ...]:
    """Return the lines of the four gains from the first four blocks.

    Raises
    ------
    ValueError
        The values are not near the nominal ones, as in an erased memory.
    """
    numbers = [
        whole + fraction / 2**32
        for block in blocks
        for fraction, whole in struct.iter_unpack("<Ii", block[:32])
    ]
    lines = tuple(
        CentredLines(numbers[8 + 2 * index + 1], numbers[2 * index], numbers[8 + 2 * index])
        for index in range(len(GAINS))
    )
    for line, nominal in zip(lines, nominal_lines(), strict=True):
        for value, expected in zip(line, nominal, strict=True):
            if abs(value / expected - 1.0) > _TOLERANCE:
                raise ValueError(
                    f"its calibration memory holds {value:.6g} where about {expected:.6g} belongs"
                )
    return lines


def write_lines(lines: Sequence[CentredLines]) -> list[bytes]:
    """Return the blocks that hold the lines; offsets, which nothing uses, are zero."""
    numbers = [value for line in lines for value in (line.above_v, 0.0)]
    numbers += [value for line in lines for value in (line.below_v, line.centre)]
    packed = b"".join(struct.pack("<q", round(value * 2**32)) for value in numbers)
    return [packed[at : at + 32] for at in range(0, len(packed), 32)]


class StreamDecoder:
    """Decode the packets of one stream, from the first one on.

    Parameters
    ----------
    scanning
        The stream settings sent to the U6.
    lines
        Calibration of the U6, by the gain's index.
    """

    def __init__(self, scanning: Scanning, lines: Sequence[CentredLines]) -> None:
        self.faults: Counter[str] = Counter()
        """``bad packets``, ``lost scans``, ``overflows``, and ``error N`` by its number."""
        self._scanning = scanning
        self._volts = [lines[GAINS.index(channel.gain)].volts for channel in scanning.channels]
        self._scan = 0
        self._counter: int | None = None
        self._missed = 0

    def decode(self, raw: bytes) -> list[VoltageReading]:
        """Return the scans of a packet, with the volts of every channel; [] if it is invalid."""
        packet = decode_stream(raw, self._scanning.samples_per_packet)
        if packet is None:
            self.faults["bad packets"] += 1
            return []
        self._follow(packet)
        return self._take(packet)

    def _follow(self, packet: StreamPacket) -> None:
        """Count the packets missing before this one, and the error that it reports."""
        expected = packet.counter if self._counter is None else (self._counter + 1) & 0xFF
        missing = (packet.counter - expected) & 0xFF
        if missing:
            lost = missing * self._scanning.scans_per_packet
            self.faults["lost scans"] += lost
            self._scan += lost
        self._counter = packet.counter
        if packet.error == RECOVERED:
            self.faults["overflows"] += 1
            self.faults["lost scans"] += packet.missed
            self._missed = packet.missed
        elif packet.error not in {0, RECOVERING}:
            self.faults[f"error {packet.error}"] += 1

    def _take(self, packet: StreamPacket) -> list[VoltageReading]:
        scans: list[VoltageReading] = []
        of_channels, samples = self._volts, packet.samples
        number = len(of_channels)
        for at in range(0, len(samples), number):
            counts = samples[at : at + number]
            if self._missed and all(count == DUMMY for count in counts):
                self._scan += self._missed  # the dummy is one of the discarded scans
                self._missed = 0
                continue
            volts = tuple([line(count) for line, count in zip(of_channels, counts, strict=True)])
            scans.append(VoltageReading(self._scanning.time_ns(self._scan), volts))
            self._scan += 1
        return scans
