"""Packets of a LabJack U6: commands, replies and streamed data; bytes alone, no I/O.

Source: low-level function reference of the vendor's U6 data sheet, section 5.2.
"""

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

CONFIG_U6: Final = 0x08
STREAM_CONFIG: Final = 0x11
READ_CALIBRATION: Final = 0x2D

START_STREAM: Final = b"\xa8\xa8"
STOP_STREAM: Final = b"\xb0\xb0"
BAD_CHECKSUM: Final = b"\xb8\xb8"
"""Reply of the U6 to a command with a wrong checksum."""

MOST_SAMPLES: Final = 25
"""Samples in one packet of the stream."""
RECOVERING: Final = 59
RECOVERED: Final = 60
STREAM_IS_ACTIVE: Final = 48
BAD_STREAM: Final = 50
STREAM_NOT_RUNNING: Final = 52
DUMMY: Final = 0xFFFF
"""Value of each sample in the scan that replaces discarded scans."""

GAINS: Final = (1, 10, 100, 1000)
"""Gains by their index: +-10 V, +-1 V, +-0.1 V, +-0.01 V."""

_EXTENDED: Final = 0xF8
_STREAMED: Final = 0xF9
_ERRORS: Final = {
    STREAM_IS_ACTIVE: "a stream runs already",
    49: "the list of channels is not valid",
    BAD_STREAM: "the configuration is not valid",
    STREAM_NOT_RUNNING: "no stream runs",
    55: "a scan began before the last one had ended: fewer channels or a lower rate",
    56: "the number of samples is not valid",
    57: "the gain is not valid",
    58: "the rate is not valid",
}


class AnalogInput(NamedTuple):
    """One of the inputs."""

    number: int
    """0 to 13 are the screw terminals and the connectors."""
    gain: int = 1
    """1, 10, 100 or 1000."""
    differential: bool = False
    """Measured against the next input of the pair; the number is then even."""


class Scanning(NamedTuple):
    """Settings of a stream, as sent to the U6."""

    channels: tuple[AnalogInput, ...]
    clock_hz: int
    """4 or 48 MHz."""
    interval: int
    """Cycles of the clock from one scan to the next, up to 65535."""
    scans_per_packet: int

    @property
    def samples_per_packet(self) -> int:
        """Samples of whole scans, so that no packet begins within a scan."""
        return len(self.channels) * self.scans_per_packet

    def time_ns(self, scan: int) -> int:
        """Return the time of a scan after the first one, by the U6's clock."""
        return scan * self.interval * 1_000_000_000 // self.clock_hz


class StreamPacket(NamedTuple):
    """Samples that the U6 sent together."""

    counter: int
    """Number of the packet, modulo 256."""
    error: int
    missed: int
    """Discarded scans, including the dummy, if the error is `RECOVERED`."""
    samples: tuple[int, ...]
    """Counts, scan after scan."""


def checksum8(content: bytes) -> int:
    """Return the sum folded twice into eight bits."""
    total = sum(content)
    total = (total & 0xFF) + (total >> 8)
    return (total & 0xFF) + (total >> 8)


def command(number: int, payload: bytes) -> bytes:
    """Return an extended command; the payload has an even number of bytes."""
    words, odd = divmod(len(payload), 2)
    if odd or words > 0xFF:
        raise ValueError(f"a payload of {len(payload)} bytes")
    return _with_checksums(bytes((_EXTENDED, words, number)), payload)


def read_reply(reply: bytes, number: int) -> bytes:
    """Return the content of a reply, after its error byte and the byte that follows.

    Raises
    ------
    ValueError
        The bytes are no reply to that command, are corrupted, or report an error.
    """
    if reply[:2] == BAD_CHECKSUM:
        raise ValueError("it received a spoilt command")
    if len(reply) < 8 or reply[1] != _EXTENDED or reply[3] != number:
        raise ValueError(f"it sent another reply ({reply[:8].hex(' ')})")
    size = 6 + 2 * reply[2]
    if len(reply) < size or not is_sound(reply[:size]):
        raise ValueError("its reply was spoilt")
    if reply[6]:
        raise ValueError(explain(reply[6]))
    return reply[8:size]


def read_short_reply(reply: bytes, sent: bytes) -> int:
    """Return the error of the reply to `START_STREAM` or `STOP_STREAM`, 0 for none.

    Raises
    ------
    ValueError
        The bytes are no reply to that command.
    """
    if len(reply) < 4 or reply[1] != sent[1] + 1 or reply[0] != checksum8(reply[1:4]):
        raise ValueError(f"it sent another reply ({reply[:4].hex(' ')})")
    return reply[2]


def explain(error: int) -> str:
    """Return what an error of the U6 means."""
    return f"error {error}: {_ERRORS.get(error, 'see its data sheet')}"


def plan(channels: Sequence[AnalogInput], rate_hz: float) -> Scanning:
    """Return the stream settings nearest to a rate of at least 62 Hz, with little delay.

    A packet holds the scans of a millisecond, as far as they fit.
    """
    clock_hz = 48_000_000 if rate_hz >= 733.0 else 4_000_000
    scans = max(1, min(MOST_SAMPLES // len(channels), round(rate_hz / 1000.0)))
    return Scanning(tuple(channels), clock_hz, round(clock_hz / rate_hz), scans)


def stream_config(scanning: Scanning) -> bytes:
    """Return the command that sets up a stream; the resolution is the fastest, index 1."""
    channels = scanning.channels
    head = struct.pack(
        "<BBBBBBH",
        len(channels),
        1,
        scanning.samples_per_packet,
        0,
        0,
        0x08 if scanning.clock_hz == 48_000_000 else 0,
        scanning.interval,
    )
    table = b"".join(
        bytes((c.number, (0x80 if c.differential else 0) | GAINS.index(c.gain) << 4))
        for c in channels
    )
    return command(STREAM_CONFIG, head + table)


def decode_stream(packet: bytes, number: int) -> StreamPacket | None:
    """Return a packet of the stream with this number of samples, or None if it is invalid."""
    layout, head = _stream_layout(number)
    if len(packet) != layout.size or packet[1:4] != head or not is_sound(packet):
        return None
    missed, counter, error, *samples = layout.unpack(packet)
    return StreamPacket(counter, error, missed if error == RECOVERED else 0, tuple(samples))


@lru_cache(maxsize=MOST_SAMPLES)
def _stream_layout(number: int) -> tuple[struct.Struct, bytes]:
    """Return the layout of a stream's packet with `number` samples, and its bytes 1 to 3."""
    return struct.Struct(f"<6xIBB{number}H2x"), bytes((_STREAMED, 4 + number, 0xC0))


def encode_stream(packet: StreamPacket) -> bytes:
    """Return a packet of the stream as the U6 sends it, with an empty backlog."""
    number = len(packet.samples)
    payload = struct.pack(
        f"<IBB{number}HH", packet.missed, packet.counter, packet.error, *packet.samples, 0
    )
    return _with_checksums(bytes((_STREAMED, 4 + number, 0xC0)), payload)


def _with_checksums(head: bytes, payload: bytes) -> bytes:
    body = head + (sum(payload) & 0xFFFF).to_bytes(2, "little")
    return bytes((checksum8(body),)) + body + payload


def is_sound(packet: bytes) -> bool:
    """Return whether both checksums of a command, a reply or a packet are right."""
    return packet[0] == checksum8(packet[1:6]) and (
        packet[4] | packet[5] << 8 == sum(packet[6:]) & 0xFFFF
    )
