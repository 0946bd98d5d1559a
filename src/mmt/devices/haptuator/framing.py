"""Frames between the host and a microcontroller that plays samples: bytes to records, no I/O.

A frame is COBS-encoded (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) and ended by
a zero byte. Before the encoding it holds, little-endian: version (u8), kind (u8), the kind's
content, and CRC-16 of all that (polynomial 0x1021, initial value 0xFFFF).
"""

import struct
from typing import Final, NamedTuple

from mmt.devices.serial_ports import FrameDecoder, framed

VERSION: Final = 1
MOST_SAMPLES: Final = 120
"""Samples in one frame at most: it then stays below 254 bytes, and COBS adds exactly one byte."""
FULL_SCALE: Final = 32_767

_SAMPLES: Final = 1
_RESET: Final = 2
_REPORT: Final = 3
_HEAD: Final = struct.Struct("<BB")
_SEQUENCE: Final = struct.Struct("<H")
_REPORT_BODY: Final = struct.Struct("<IHHHHH")


class BoardSamples(NamedTuple):
    """Samples for the converter."""

    sequence: int
    """Number of the frame, modulo 2^16; the first after a reset is 1."""
    values: tuple[int, ...]
    """Full scale is +-32767."""


class Reset(NamedTuple):
    """Command to empty the buffer and restart the counts; it is frame number 0."""


class BoardReport(NamedTuple):
    """The state that the board reports."""

    rate_hz: int
    """Sample rate of its converter."""
    capacity: int
    """Samples that its buffer holds."""
    fill: int
    """Samples in the buffer that are still to be played."""
    sequence: int
    """Number of the newest frame received, even if it did not fit; 0 after a reset."""
    underruns: int
    """How often the buffer ran dry since the reset, modulo 2^16."""
    lost: int
    """Frames missing, invalid, or rejected by a full buffer since the reset, modulo 2^16."""


Message = BoardSamples | Reset | BoardReport


def encode(message: Message) -> bytes:
    """Return a message as it goes over the wire, with its final zero.

    Raises
    ------
    ValueError
        There are no samples or more than 120, or a sample is beyond full scale.
    """
    if isinstance(message, BoardSamples):
        if not 1 <= len(message.values) <= MOST_SAMPLES:
            raise ValueError(f"a frame holds 1 to {MOST_SAMPLES}, not {len(message.values)}")
        if max(message.values) > FULL_SCALE or min(message.values) < -FULL_SCALE:
            raise ValueError(f"a sample is beyond {FULL_SCALE}")
        plain = _HEAD.pack(VERSION, _SAMPLES) + _SEQUENCE.pack(message.sequence)
        plain += struct.pack(f"<{len(message.values)}h", *message.values)
    elif isinstance(message, BoardReport):
        plain = _HEAD.pack(VERSION, _REPORT) + _REPORT_BODY.pack(*message)
    else:
        plain = _HEAD.pack(VERSION, _RESET)
    return framed(plain)


class Decoder(FrameDecoder[Message]):
    """Decoder of messages."""

    _version = VERSION
    _shortest = _HEAD.size + 2

    def _parse(self, content: bytes) -> Message | None:
        kind, body = content[1], content[_HEAD.size :]
        if kind == _REPORT and len(body) == _REPORT_BODY.size:
            return BoardReport(*_REPORT_BODY.unpack(body))
        if kind == _RESET and not body:
            return Reset()
        count, odd = divmod(len(body) - _SEQUENCE.size, 2)
        if kind == _SAMPLES and 1 <= count <= MOST_SAMPLES and not odd:
            values = struct.unpack_from(f"<{count}h", body, _SEQUENCE.size)
            return BoardSamples(_SEQUENCE.unpack_from(body)[0], values)
        return None
