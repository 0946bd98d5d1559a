"""Voltages that a LabJack U6 streams: what sensors behind it read."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final

from mmt.devices.labjack.gains import BLOCKS, read_lines
from mmt.devices.labjack.packets import (
    DUMMY,
    GAINS,
    READ_CALIBRATION,
    RECOVERED,
    RECOVERING,
    STREAM_CONFIG,
    Channel,
    StreamPacket,
    decode_stream,
    plan,
    stream_config,
)
from mmt.devices.labjack.usb_link import U6Link
from mmt.devices.voltages import VoltageReading
from mmt.errors import InputError, MmtError

_MOST_CHANNELS: Final = 14


class U6Voltages:
    """A `VoltageBoard` that streams inputs at an even rate.

    Parameters
    ----------
    channels
        The inputs, in the order of the volts; 1 to 14.
    rate_hz
        Scans a second, 100 to 4000.
    box
        Serial number of the U6; None takes the only one.
    backend
        Of pyusb; None takes what the system has.

    Raises
    ------
    InputError
        A channel or the rate is not allowed.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        rate_hz: float = 1000.0,
        box: int | None = None,
        backend: Any = None,
    ) -> None:
        _check(channels, rate_hz)
        self.faults: Counter[str] = Counter()
        """``bad packets``, ``lost scans``, ``overflows`` and, by their number, errors."""
        self.inputs = len(channels)
        """How many voltages a reading has."""
        self.limit_v = min(10.0 / channel.gain for channel in channels)
        """Largest magnitude that every input measures."""
        self.latency_ns = 0
        """A scan is stamped when it begins; its inputs follow each other within it."""
        self._scanning = plan(channels, rate_hz)
        self._link = U6Link(box, backend)
        self._lines: list[Callable[[int], float]] = []
        self._scan = 0
        self._counter: int | None = None
        self._missed = 0

    @property
    def serial(self) -> int:
        """Of the U6 that is connected."""
        return self._link.serial

    def connect(self) -> None:
        """Open the U6, read its calibration, start the stream.

        Raises
        ------
        MmtError
            It is not there, may not be opened, or refuses.
        """
        link = self._link
        link.open()
        try:
            blocks = [link.ask(READ_CALIBRATION, bytes((0, n))) for n in range(BLOCKS)]
            lines = read_lines(blocks)
            self._lines = [
                lines[GAINS.index(channel.gain)].volts for channel in self._scanning.channels
            ]
            self._scan, self._counter, self._missed = 0, None, 0
            link.send(stream_config(self._scanning), STREAM_CONFIG)
            link.start()
        except ValueError as error:
            link.close()
            raise MmtError(f"the LabJack U6 is not calibrated: {error}") from error
        except Exception:
            link.close()
            raise

    def read(self) -> list[VoltageReading]:
        """Return what has come, oldest first, by the U6's clock; never blocks.

        Raises
        ------
        DeviceLost
            It was unplugged.
        """
        scans: list[VoltageReading] = []
        for raw in self._link.packets():
            packet = decode_stream(raw, self._scanning.samples_per_packet)
            if packet is None:
                self.faults["bad packets"] += 1
            else:
                self._follow(packet)
                self._take(packet, scans)
        return scans

    def close(self) -> None:
        """End the stream; calling it twice is harmless."""
        self._link.close()

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

    def _take(self, packet: StreamPacket, scans: list[VoltageReading]) -> None:
        number = len(self._lines)
        for at in range(0, len(packet.samples), number):
            counts = packet.samples[at : at + number]
            if self._missed and all(count == DUMMY for count in counts):
                self._scan += self._missed  # the dummy is one of those that were thrown away
                self._missed = 0
                continue
            volts = tuple(line(count) for line, count in zip(self._lines, counts, strict=True))
            scans.append(VoltageReading(self._scanning.time_ns(self._scan), volts))
            self._scan += 1


def _check(channels: Sequence[Channel], rate_hz: float) -> None:
    if not 1 <= len(channels) <= _MOST_CHANNELS:
        raise InputError(f"a LabJack U6 has 14 inputs, not {len(channels)}")
    if not 100.0 <= rate_hz <= 4000.0:
        raise InputError(f"rate_hz {rate_hz:g}: a LabJack U6 is read at 100 to 4000 Hz here")
    for channel in channels:
        if channel.gain not in GAINS:
            raise InputError(f"gain {channel.gain}: a LabJack U6 has 1, 10, 100 and 1000")
        if not 0 <= channel.number < _MOST_CHANNELS:
            raise InputError(f"input {channel.number}: a LabJack U6 has 0 to 13")
        if channel.differential and channel.number % 2:
            raise InputError(
                f"input {channel.number}: a differential one is named by its even half"
            )
