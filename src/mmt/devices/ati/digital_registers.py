"""The Digital F/T's registers: status, gains and offsets, and its stored calibrations."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mmt.core.errors import MmtError
from mmt.devices.ati.calibration import Calibration, force_in_newton, torque_in_newton_mm
from mmt.devices.wrench import Matrix, matrix_of

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
class StoredCalibration:
    """One of the calibrations that the device holds."""

    calibration: Calibration
    matrix: Matrix
    """From gauge counts to N and N mm."""
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
    values = struct.unpack(">36f", content[64:208])
    force_code, torque_code = content[208], content[209]
    ranges = struct.unpack(">6f", content[210:234])
    counts = struct.unpack(">2i", content[234:242])
    sizes = (*counts, *ranges)
    known = 1 <= force_code <= 6 and 1 <= torque_code <= 6
    if not (known and all(0.0 < size < math.inf for size in sizes)):
        raise MmtError(
            f"{device}: it holds no usable calibration of this number (units {force_code}, "
            f"{torque_code}, counts {counts}, ranges {ranges}); change 'calibration_number'"
        )
    force_unit = FORCE_UNITS[force_code - 1]
    newton = force_in_newton(force_unit, device)
    newton_mm = torque_in_newton_mm(TORQUE_UNITS[torque_code - 1], device)
    scales = [newton / counts[0]] * 3 + [newton_mm / counts[1]] * 3
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
    x, y, z = (newton * value for value in ranges[:3])
    tx, ty, tz = (newton_mm * value for value in ranges[3:])
    return StoredCalibration(
        Calibration(
            _text(content[0:8]),
            _text(content[8:40]),
            force_unit,
            (x, y, z),
            (tx, ty, tz),
        ),
        matrix,
        tuple(registers[121:127]),
        tuple(registers[127:133]),
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
    """Return the 168 registers of a calibration; all values are in its own units."""
    content = b"".join(
        (
            serial.encode("ascii").ljust(8, b"\0"),
            part.encode("ascii").ljust(32, b"\0"),
            bytes(24),
            struct.pack(">36f", *(value for row in matrix for value in row)),
            bytes(units),
            struct.pack(">6f", *ranges),
            struct.pack(">2i", *counts),
            struct.pack(">6H", *gains),
            struct.pack(">6H", *offsets),
        )
    ).ljust(2 * CALIBRATION_REGISTERS, b"\0")
    return list(struct.unpack(f">{CALIBRATION_REGISTERS}H", content))


def _text(content: bytes) -> str:
    return content.split(b"\0")[0].decode("latin-1").strip()
