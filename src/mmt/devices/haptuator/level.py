"""The level of a Haptuator: given in the scene, or stored after a sweep."""

import math
from pathlib import Path
from typing import Final, NamedTuple

from mmt.core.errors import InputError
from mmt.devices.calibrations import calibration_file, load_calibration, save_calibration
from mmt.devices.haptuator.equalising import TAPS, Equaliser
from mmt.devices.haptuator.options import HaptuatorOptions

DEVICE: Final = "haptuator"


class Level(NamedTuple):
    """What the drive needs of an actuator."""

    volts_per_m_s2: float
    taps: tuple[float, ...]
    """Of the equaliser, (1.0,) for none."""


def level_of(options: HaptuatorOptions, directory: Path | None = None) -> Level:
    """Return the level of the options, or that which is stored for their serial number.

    Raises
    ------
    InputError
        Nothing usable is stored.
    MmtError
        It cannot be read.
    """
    if options.volts_per_m_s2 is not None:
        return Level(options.volts_per_m_s2, (1.0,))
    serial = options.serial or ""
    stored = load_calibration(DEVICE, serial, directory)
    if stored is None:
        raise InputError(
            f"no calibration of Haptuator {serial} is stored: make one by 'mmt device equalise', "
            "or give 'volts_per_m_s2'"
        )
    volts, taps = _number(stored.get("volts_per_m_s2")), stored.get("taps")
    numbers = [_number(tap) for tap in taps] if isinstance(taps, list) else []
    if volts is None or volts <= 0.0 or not 1 <= len(numbers) <= TAPS or None in numbers:
        raise InputError(
            f"the calibration {calibration_file(DEVICE, serial, directory)} is not that of a "
            "Haptuator: make it again by 'mmt device equalise'"
        )
    return Level(volts, tuple(number for number in numbers if number is not None))


def store_level(equaliser: Equaliser, serial: str, directory: Path | None = None) -> Path:
    """Store what a sweep gave; return the file.

    Raises
    ------
    MmtError
        It cannot be written.
    """
    values = {**equaliser._asdict(), "taps": list(equaliser.taps)}
    return save_calibration(DEVICE, serial, values, directory)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
