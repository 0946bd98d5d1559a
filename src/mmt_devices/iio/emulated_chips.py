"""Attributes and scans of the kernel's drivers for three accelerometers, to emulate them.

The driver of ADXL355 and ADXL359 captures by a trigger, with time stamps. That of the ADXL345
empties the sensor's own FIFO, without time stamps. Sources: ``adxl355_core.c`` and
``adxl345_core.c`` in Linux's ``drivers/iio/accel``.
"""

from dataclasses import dataclass, replace
from typing import Final

from mmt_devices.iio.layout import Element


@dataclass(frozen=True)
class Chip:
    """What the kernel's driver of a sensor offers."""

    name: str
    kind: str
    """Type of an axis, as in ``in_accel_x_type``."""
    scale: float
    """m/s2 a count."""
    rates_hz: tuple[str, ...]
    triggered: bool
    """Whether a trigger captures the scans, which can then have temperature and time stamp."""


ADXL355: Final = Chip(
    "adxl355",
    "be:s20/32>>4",
    0.000038245,
    ("4000.000000", "2000.000000", "1000.000000", "500.000000"),
    triggered=True,
)
ADXL359: Final = replace(ADXL355, name="adxl359", scale=0.000191229)
"""Like the ADXL355, but with a range of 10 g instead of 2 g."""
ADXL345: Final = Chip(
    "adxl345",
    "le:s13/16>>0",
    0.0383,
    ("400.000000", "800.000000", "1600.000000", "3200.000000"),
    triggered=False,
)


def attributes(chip: Chip, buffer: str, scan: str) -> dict[str, str]:
    """Return the files of the chip's directory and their initial content, by path.

    `buffer` and `scan` are the directories of the buffer's settings and of the elements.
    """
    kinds = {f"in_accel_{axis}": chip.kind for axis in "xyz"}
    made = {
        "name": chip.name,
        "in_accel_scale": f"{chip.scale:.9f}",
        "in_accel_sampling_frequency": chip.rates_hz[0],
        "in_accel_sampling_frequency_available": " ".join(chip.rates_hz),
        "in_accel_x_raw": "0",
        f"{buffer}/enable": "0",
        f"{buffer}/length": "2",
        f"{buffer}/watermark": "1",
    }
    if chip.triggered:
        kinds |= {"in_temp": "be:u12/16>>0", "in_timestamp": "le:s64/64>>0"}
        made["current_timestamp_clock"] = "realtime"
        made["trigger/current_trigger"] = f"{chip.name}-dev0"
        made["../trigger0/name"] = f"{chip.name}-dev0"
    for index, (name, kind) in enumerate(kinds.items()):
        made |= {
            f"{scan}/{name}_en": "0",
            f"{scan}/{name}_index": str(index),
            f"{scan}/{name}_type": kind,
        }
    return made


def pack(element: Element, value: int) -> bytes:
    """Return a value's bytes as its type says, clipped to the range of its bits."""
    least, most = element.bounds
    word = (min(max(value, least), most) % (1 << element.bits)) << element.shift
    return word.to_bytes(element.size, "big" if element.big_endian else "little")
