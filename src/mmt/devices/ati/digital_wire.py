"""Bytes of the Digital F/T: Modbus requests and replies, registers, and records of its stream."""

import math
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mmt.core.errors import MmtError
from mmt.devices.ati.calibration import Calibration, wrench_units
from mmt.devices.wrench import matrix_of, six_of

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

    Parameters
    ----------
    faults
        Counts go here: ``wrong sum`` (how often the checksum of an expected record was wrong), and
        ``error bit`` (records dropped because of it).
    """

    def __init__(self, faults: Counter[str]) -> None:
        self.faults = faults
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
                self.faults["wrong sum"] += 1
                self._in_step = False
                continue
            if content[last] & 0x80:
                self.faults["error bit"] += 1
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


DEVICE: Final = 10
"""Modbus address of the device, always the same."""
START_STREAM: Final = (0x46, 0x55)
"""Function and data byte; the device answers with one byte, 1 if it accepts."""
UNLOCK: Final = (0x6A, 0xAA)
LOCK: Final = (0x6A, 0x18)

GAINS: Final = 0x0000
OFFSETS: Final = 0x0006
STATUS: Final = 0x001D
CALIBRATIONS: Final = 16
CALIBRATION_REGISTERS: Final = 168

FORCE_UNITS: Final = ("lbf", "N", "klbf", "kN", "kgf", "gf")
TORQUE_UNITS: Final = ("lbf-in", "lbf-ft", "N-m", "N-mm", "kgf-cm", "kN-m")
"""Units by their codes 1 to 6."""

_FIRST_CALIBRATION: Final = 0x00E3
_CALIBRATION_STEP: Final = 192
_CALIBRATION: Final = struct.Struct(">8s32s24x36f2B6f2i6H6H70x")
"""Serial, part, matrix, units and ranges of force and torque, counts, gains, offsets."""
_STATUS: Final = {
    0: "reset by its watchdog",
    1: "excitation voltage too high",
    2: "excitation voltage too low",
    3: "artificial analog ground out of range",
    4: "supply voltage too high",
    5: "supply voltage too low",
    7: "stored settings cannot be read",
    8: "configuration not valid",
    9: "bridge current too high",
    10: "bridge current too low",
    11: "thermistor too high",
    12: "thermistor too low",
    13: "DAC out of range",
}


@dataclass(frozen=True, slots=True)
class StoredCalibration(Calibration):
    """One of the calibrations that the device holds; its matrix is for gauge counts."""

    gains: tuple[int, ...]
    """Gains that the gauges need for this calibration, six register values."""
    offsets: tuple[int, ...]


def calibration_start(number: int) -> int:
    """Return the first register of calibration 1 to 16."""
    return _FIRST_CALIBRATION + _CALIBRATION_STEP * (number - 1)


def explain_status(status: int) -> str:
    """Return the meaning of the status register as text."""
    causes = [name for bit, name in _STATUS.items() if status >> bit & 1]
    return f"status 0x{status:04X} ({'; '.join(causes) or 'meaning not known'})"


def parse_calibration(registers: Sequence[int], device: str) -> StoredCalibration:
    """Read a calibration out of its 168 registers.

    Raises
    ------
    MmtError
        The registers hold no calibration, or an impossible value.
    """
    content = struct.pack(f">{len(registers)}H", *registers)
    serial, part, *numbers = _CALIBRATION.unpack(content)
    values, (force_code, torque_code) = numbers[:36], numbers[36:38]
    ranges, counts, gains = numbers[38:44], numbers[44:46], numbers[46:52]
    sizes = (*counts, *ranges)
    known = 1 <= force_code <= 6 and 1 <= torque_code <= 6
    if not (known and all(0.0 < size < math.inf for size in sizes)):
        raise MmtError(
            f"{device}: it holds no usable calibration of this number (units {force_code}, "
            f"{torque_code}, counts {counts}, ranges {ranges}); change 'calibration_number'"
        )
    force_unit = FORCE_UNITS[force_code - 1]
    units = wrench_units(force_unit, TORQUE_UNITS[torque_code - 1], device)
    scales = [unit / counts[i // 3] for i, unit in enumerate(units)]
    try:
        matrix = matrix_of(
            [
                [scale * value for value in values[6 * i : 6 * i + 6]]
                for i, scale in enumerate(scales)
            ]
        )
    except ValueError as error:
        raise MmtError(
            f"{device}: the matrix of this calibration cannot be used: {error}"
        ) from None
    limits = six_of([unit * value for unit, value in zip(units, ranges, strict=True)])
    offsets = tuple(numbers[52:])
    return StoredCalibration(
        _text(serial), _text(part), force_unit, matrix, limits, tuple(gains), offsets
    )


def pack_calibration(
    serial: str,
    part: str,
    matrix: Sequence[Sequence[float]],
    units: tuple[int, int],
    ranges: Sequence[float],
    counts: tuple[int, int],
    gains: Sequence[int],
    offsets: Sequence[int],
) -> list[int]:
    """Return the 168 registers of a calibration; all values are in its own units.

    A serial number is cut to 8 characters, a part number to 32.
    """
    values = [value for row in matrix for value in row]
    texts = serial.encode("ascii"), part.encode("ascii")
    numbers = *values, *units, *ranges, *counts, *gains, *offsets
    content = _CALIBRATION.pack(*texts, *numbers)
    return list(struct.unpack(f">{CALIBRATION_REGISTERS}H", content))


def _text(content: bytes) -> str:
    return content.split(b"\0")[0].decode("latin-1").strip()
