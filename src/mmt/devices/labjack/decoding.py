"""Scans from the packets of a U6's stream, each with its time; bytes alone, no I/O."""

from collections import Counter
from collections.abc import Sequence

from mmt.devices.labjack.gains import Line
from mmt.devices.labjack.packets import (
    DUMMY,
    GAINS,
    RECOVERED,
    RECOVERING,
    Scanning,
    StreamPacket,
    decode_stream,
)
from mmt.devices.voltages import VoltageReading


class StreamDecoder:
    """Follow one stream from its first packet on.

    Parameters
    ----------
    scanning
        What the U6 was told.
    lines
        Its calibration by the gain's index.
    """

    def __init__(self, scanning: Scanning, lines: Sequence[Line]) -> None:
        self.faults: Counter[str] = Counter()
        """``bad packets``, ``lost scans``, ``overflows`` and, by their number, errors."""
        self._scanning = scanning
        self._volts = [lines[GAINS.index(channel.gain)].volts for channel in scanning.channels]
        self._scan = 0
        self._counter: int | None = None
        self._missed = 0

    def decode(self, raw: bytes) -> list[VoltageReading]:
        """Return the scans of a packet, with the volts of every channel; none of a spoilt one."""
        packet = decode_stream(raw, self._scanning.samples_per_packet)
        if packet is None:
            self.faults["bad packets"] += 1
            return []
        self._follow(packet)
        return self._take(packet)

    def _follow(self, packet: StreamPacket) -> None:
        """Count the packets that are missing before this one, and what it says is wrong."""
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
                self._scan += self._missed  # the dummy is one of those that were thrown away
                self._missed = 0
                continue
            volts = tuple([line(count) for line, count in zip(of_channels, counts, strict=True)])
            scans.append(VoltageReading(self._scanning.time_ns(self._scan), volts))
            self._scan += 1
        return scans
