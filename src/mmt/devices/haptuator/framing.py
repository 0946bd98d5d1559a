"""Frames between the host and a microcontroller that plays samples: bytes to records, no I/O.

A frame is COBS-encoded (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) and ended by
a zero byte. Before the encoding it holds, little-endian: version (u8), kind (u8), the kind's
content, and CRC-16 of all that (polynomial 0x1021, initial value 0xFFFF).
"""

import struct
from binascii import crc_hqx
from collections import Counter
from collections.abc import Sequence
from typing import Final, NamedTuple

from mmt.devices.serial_ports import stuff, unstuff

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
_CHECK: Final = struct.Struct("<H")
_LONGEST: Final = 254


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
    return stuff(plain + _CHECK.pack(crc_hqx(plain, 0xFFFF))) + b"\0"


class Decoder:
    """Cut a stream of bytes into messages; invalid ones are counted and left out.

    Bytes before the first zero end an earlier frame: they are dropped and not counted.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        """``bad frames``, ``bad checksums``, ``other versions``."""
        self._rest = bytearray()
        self._synchronised = False

    def feed(self, received: bytes) -> Sequence[Message]:
        """Return the messages that these bytes complete, oldest first."""
        if not received:
            return ()
        *pieces, rest = (self._rest + received).split(b"\0")
        messages = []
        for piece in pieces:
            if not self._synchronised:
                self._synchronised = True
            elif piece:
                message = self._decode(bytes(piece))
                if message is not None:
                    messages.append(message)
        if len(rest) > _LONGEST:
            if self._synchronised:
                self.faults["bad frames"] += 1
                self._synchronised = False
            rest = bytearray()
        self._rest = bytearray(rest)
        return messages

    def _decode(self, stuffed: bytes) -> Message | None:
        plain = unstuff(stuffed) if len(stuffed) <= _LONGEST else None
        if plain is None or len(plain) < _HEAD.size + _CHECK.size:
            self.faults["bad frames"] += 1
            return None
        content = plain[: -_CHECK.size]
        if crc_hqx(content, 0xFFFF) != _CHECK.unpack_from(plain, len(content))[0]:
            self.faults["bad checksums"] += 1
            return None
        version, kind = _HEAD.unpack_from(content)
        if version != VERSION:
            self.faults["other versions"] += 1
            return None
        message = _message(kind, content[_HEAD.size :])
        if message is None:
            self.faults["bad frames"] += 1
        return message


def _message(kind: int, body: bytes) -> Message | None:
    if kind == _REPORT and len(body) == _REPORT_BODY.size:
        return BoardReport(*_REPORT_BODY.unpack(body))
    if kind == _RESET and not body:
        return Reset()
    count, odd = divmod(len(body) - _SEQUENCE.size, 2)
    if kind == _SAMPLES and 1 <= count <= MOST_SAMPLES and not odd:
        values = struct.unpack_from(f"<{count}h", body, _SEQUENCE.size)
        return BoardSamples(_SEQUENCE.unpack_from(body)[0], values)
    return None
