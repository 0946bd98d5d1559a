"""Bytes of the Digital F/T: Modbus requests and replies, and the records of its stream."""

import struct
from collections.abc import Sequence
from typing import Final

from mmt.core.errors import MmtError

READ_REGISTERS: Final = 0x03
WRITE_REGISTERS: Final = 0x10
_EXCEPTION: Final = 0x80
_REASONS: Final = {
    1: "function not known",
    2: "no such register",
    3: "value not allowed",
    4: "failure in the device",
    6: "busy",
}

LONGEST_READ: Final = 64
"""Registers in one request at most."""


class NoFrame(MmtError):  # noqa: N818 - its message names what came
    """The received bytes are no answer to the request: too short, to another one, or corrupted."""


def checksum(content: bytes) -> bytes:
    """Return the CRC-16 of Modbus (polynomial 0xA001, initial value 0xFFFF), low byte first."""
    crc = 0xFFFF
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def frame(device: int, function: int, content: bytes) -> bytes:
    """Return a frame with its checksum."""
    body = bytes([device, function]) + content
    return body + checksum(body)


def read_request(device: int, start: int, count: int) -> bytes:
    """Return a request to read registers."""
    return frame(device, READ_REGISTERS, struct.pack(">HH", start, count))


def write_request(device: int, start: int, values: Sequence[int]) -> bytes:
    """Return a request to write registers."""
    head = struct.pack(">HHB", start, len(values), 2 * len(values))
    return frame(device, WRITE_REGISTERS, head + struct.pack(f">{len(values)}H", *values))


def answer_length(request: bytes) -> int:
    """Return the length (bytes) of the answer to a request."""
    if request[1] == READ_REGISTERS:
        return 5 + 2 * int.from_bytes(request[4:6], "big")
    return 8 if request[1] == WRITE_REGISTERS else 5


def parse_answer(request: bytes, received: bytes) -> bytes:
    """Return the content of an answer, between its function code and checksum.

    Raises
    ------
    NoFrame
        The received bytes do not begin with an answer to the request.
    MmtError
        The device refuses.
    """
    if len(received) < 5 or received[0] != request[0]:
        raise NoFrame(f"{len(received)} bytes that are no answer")
    refused = received[1] == request[1] | _EXCEPTION
    length = 5 if refused else answer_length(request)
    if (received[1] != request[1] and not refused) or len(received) < length:
        raise NoFrame(f"{len(received)} bytes that are no answer")
    if checksum(received[: length - 2]) != received[length - 2 : length]:
        raise NoFrame("an answer with a wrong checksum")
    if refused:
        reason = _REASONS.get(received[2], f"exception {received[2]}")
        raise MmtError(f"function 0x{request[1]:02X} is refused: {reason}")
    return received[2 : length - 2]


def registers_of(content: bytes) -> list[int]:
    """Return the registers of an answer's content, whose first byte is the byte count."""
    return list(struct.unpack(f">{content[0] // 2}H", content[1 : 1 + content[0]]))


SIZE: Final = 13
_GAUGES: Final = struct.Struct(">6h")
_CONFIRMED: Final = 3
"""Records in a row whose checksums must be right; by chance this is one in two million."""

Gauges = tuple[int, int, int, int, int, int]
"""G0 to G5 in counts."""


def pack_record(gauges: Gauges, *, error: bool = False) -> bytes:
    """Return the record's bytes: the even gauges, the odd ones, then error bit and sum."""
    content = _GAUGES.pack(*gauges[0::2], *gauges[1::2])
    return content + bytes([sum(content) & 0x7F | (0x80 if error else 0)])


class RecordStream:
    """Cut a stream of bytes into records, and resynchronise after garbage.

    While the checksums are right, each 13 bytes are a record. After a wrong checksum, the next
    three valid records in a row are searched; the bytes before them are dropped.
    """

    def __init__(self) -> None:
        self.bad = 0
        """How often the checksum of an expected record was wrong."""
        self.errors = 0
        """Records dropped because of their error bit."""
        self.reset()

    def reset(self) -> None:
        """Discard everything received."""
        self._rest = b""
        self._in_step = False
        self._skipped = 0

    def feed(self, received: bytes) -> list[Gauges | None]:
        """Take bytes and return the complete records.

        Returns
        -------
        records
            None for each record that was broken or had the error bit set.
        """
        content = self._rest + received if self._rest else received
        records: list[Gauges | None] = []
        append, unpack = records.append, _GAUGES.unpack_from
        start, end = 0, len(content)
        while end - start >= SIZE:
            if not self._in_step:
                start, self._in_step = self._search(content, start)
                if not self._in_step:
                    break
                records += [None] * -(-self._skipped // SIZE)
                self._skipped = 0
            last = start + SIZE - 1
            if (sum(content[start:last]) ^ content[last]) & 0x7F:
                self.bad += 1
                self._in_step = False
                continue
            if content[last] & 0x80:
                self.errors += 1
                append(None)
            else:
                a, c, e, b, d, f = unpack(content, start)
                append((a, b, c, d, e, f))
            start += SIZE
        self._rest = content[start:]
        return records

    def _search(self, content: bytes, start: int) -> tuple[int, bool]:
        """Return (position, found): the first record, or where to resume the search."""
        place, found = start, False
        while len(content) - place >= SIZE * _CONFIRMED:
            if all(_is_right(content, place + SIZE * i) for i in range(_CONFIRMED)):
                found = True
                break
            place += 1
        self._skipped += place - start
        return place, found


def _is_right(content: bytes, start: int) -> bool:
    last = start + SIZE - 1
    return (sum(content[start:last]) ^ content[last]) & 0x7F == 0
