"""Modbus RTU frames as bytes: the requests that the Digital F/T answers before it streams."""

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
"""Registers asked for at once."""


class NoFrame(MmtError):  # noqa: N818 - it says what came
    """What came is no answer to the request: too short, another's, or with a wrong checksum."""


def checksum(content: bytes) -> bytes:
    """Return the CRC-16 of Modbus (polynomial 0xA001, from 0xFFFF), low byte first."""
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
    """Ask for registers."""
    return frame(device, READ_REGISTERS, struct.pack(">HH", start, count))


def write_request(device: int, start: int, values: Sequence[int]) -> bytes:
    """Write registers."""
    head = struct.pack(">HHB", start, len(values), 2 * len(values))
    return frame(device, WRITE_REGISTERS, head + struct.pack(f">{len(values)}H", *values))


def answer_length(request: bytes) -> int:
    """Return how many bytes answer a request."""
    if request[1] == READ_REGISTERS:
        return 5 + 2 * int.from_bytes(request[4:6], "big")
    return 8 if request[1] == WRITE_REGISTERS else 5


def parse_answer(request: bytes, received: bytes) -> bytes:
    """Return what an answer holds between function and checksum.

    Raises
    ------
    NoFrame
        What was received does not begin with an answer to the request.
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
    """Return the registers of an answer's content, whose first byte counts bytes."""
    return list(struct.unpack(f">{content[0] // 2}H", content[1 : 1 + content[0]]))
