"""Raw Data Transfer, the Net F/T box's UDP protocol: requests and records as bytes."""

import struct
from typing import Final, NamedTuple

PORT: Final = 49152

STOP: Final = 0x0000
START: Final = 0x0002
"""Send records as they are measured, each in a packet of its own."""
RESET_LATCH: Final = 0x0041

RECORD: Final = struct.Struct(">3I6i")
"""RDT sequence, F/T sequence, status, then Fx Fy Fz Tx Ty Tz in counts."""

ERROR: Final = 0x80000000
RDT_ERROR: Final = 0x00100000
SATURATED: Final = 0x00020000
MONITOR_LATCHED: Final = 0x00010000

_REQUEST: Final = struct.Struct(">HHI")
_MARK: Final = 0x1234
_HARMLESS: Final = ERROR | SATURATED | MONITOR_LATCHED
_NAMES: Final = {
    RDT_ERROR: "an error of its data transfer",
    SATURATED: "saturation of the transducer",
    MONITOR_LATCHED: "a latched monitor condition",
}


class Record(NamedTuple):
    """One measurement of the box."""

    sequence: int
    """Number of the record in this stream, from 1, unsigned 32-bit."""
    measurement: int
    """Number of the measurement by the box's own rate, unsigned 32-bit."""
    status: int
    counts: tuple[int, int, int, int, int, int]


def request(command: int, count: int = 0) -> bytes:
    """Return a request; a count of 0 means without end."""
    return _REQUEST.pack(_MARK, command, count)


def parse_request(packet: bytes) -> tuple[int, int] | None:
    """Return command and count of a request; None where it is none."""
    if len(packet) != _REQUEST.size:
        return None
    mark, command, count = _REQUEST.unpack(packet)
    return (command, count) if mark == _MARK else None


def pack_record(record: Record) -> bytes:
    """Return the record's 36 bytes."""
    return RECORD.pack(record.sequence, record.measurement, record.status, *record.counts)


def is_broken(status: int) -> bool:
    """Whether a record of this status is not to be used."""
    return status & ~_HARMLESS != 0


def explain_status(status: int) -> str:
    """Return what a status says, for a person."""
    causes = [name for bit, name in _NAMES.items() if status & bit]
    if status & ~(ERROR | RDT_ERROR | SATURATED | MONITOR_LATCHED):
        causes.append("see the System Information page of the box")
    return f"status 0x{status:08X}" + (f" ({'; '.join(causes)})" if causes else "")
