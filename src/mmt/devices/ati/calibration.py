"""Options of a force sensor by ATI, and the contents of its calibration."""

from dataclasses import dataclass
from typing import Final, Literal

from mmt.core.arrays import Vector
from mmt.core.errors import InputError
from mmt.core.units import unit_factor
from mmt.devices.wrench import Matrix, Positive, Six, WrenchOptions


class AtiOptions(WrenchOptions):
    """Expected identity of the sensor, and its mounting."""

    serial: str | None = None
    """Serial number that the calibration must have, as ``FT12345``."""
    calibration: str | None = None
    """Name that the calibration must have, as ``SI-12-0.12``."""
    force_unit: str | None = None
    """Unit of force that the device must be set to; None accepts and converts any known unit."""
    range_n: tuple[Positive, Positive, Positive] | None = None
    """Calibrated range of Fx, Fy, Fz (N) that the device must have."""


_QUANTITIES: Final = {"force": ("force", "; set it to N in the device"), "length": ("position", "")}


def unit_size(quantity: Literal["force", "length"], unit: str, device: str) -> float:
    """Return the size of a unit of force in N, or of a unit of length in mm.

    Raises
    ------
    InputError
        The unit is not known.
    """
    name, advice = _QUANTITIES[quantity]
    factor = unit_factor(name, unit)
    if factor is None:
        raise InputError(f"{device}: the unit of {quantity} {unit!r} is not known{advice}")
    return factor


def torque_in_newton_mm(unit: str, device: str) -> float:
    """Return the size of a unit of torque, such as ``Nm``, ``N-mm`` or ``lbf-in``, in N mm.

    Raises
    ------
    InputError
        The unit is not known.
    """
    name = unit.strip().lower().replace("-", "").replace("*", "").replace(" ", "")
    for length in ("mm", "cm", "m", "in", "ft"):
        newton = unit_factor("force", name.removesuffix(length))
        if name.endswith(length) and newton is not None:
            return newton * unit_size("length", length, device)
    raise InputError(
        f"{device}: the unit of torque {unit!r} is not known; set it to N-m or N-mm in the device"
    )


def wrench_units(force_unit: str, torque_unit: str, device: str) -> list[float]:
    """Return the sizes of the units of a wrench: three in N, three in N mm."""
    newton = unit_size("force", force_unit, device)
    return [newton] * 3 + [torque_in_newton_mm(torque_unit, device)] * 3


RANGE_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True)
class Calibration:
    """Identity of a sensor, its matrix and its calibrated range."""

    serial: str
    """Serial number; empty if the device does not report it."""
    part: str
    """Name, as ``SI-12-0.12``; empty if the device does not report it."""
    force_unit: str
    matrix: Matrix
    """From counts or volts to N and N mm."""
    limits: Six
    """Largest Fx, Fy, Fz (N), Tx, Ty, Tz (N mm)."""

    @property
    def range_n(self) -> Vector:
        """Largest Fx, Fy, Fz (N)."""
        return self.limits[:3]


def check_calibration(device: str, found: Calibration, expected: AtiOptions) -> None:
    """Compare the device's calibration with the expected one.

    Raises
    ------
    InputError
        The two differ; the message names each difference and what to do.
    """
    problems = []
    if expected.serial is not None and _differ(expected.serial, found.serial):
        problems.append(
            f"its serial number is {found.serial or 'not given by the device'}, expected is "
            f"{expected.serial}: connect that sensor, or change 'serial'"
        )
    if expected.calibration is not None and _differ(expected.calibration, found.part):
        problems.append(
            f"its calibration is {found.part or 'not given by the device'}, expected is "
            f"{expected.calibration}: choose that one in the device, or change 'calibration'"
        )
    if expected.force_unit is not None and _differ(expected.force_unit, found.force_unit):
        problems.append(
            f"it measures in {found.force_unit}, expected is {expected.force_unit}: change the "
            "unit in the device, or 'force_unit'"
        )
    if expected.range_n is not None and any(
        abs(a - b) > RANGE_TOLERANCE * b
        for a, b in zip(found.range_n, expected.range_n, strict=True)
    ):
        x, y, z = found.range_n
        problems.append(
            f"its range is {x:g}, {y:g}, {z:g} N, expected is {expected.range_n}: choose the "
            "other calibration in the device, or change 'range_n'"
        )
    if problems:
        raise InputError(f"{device}: {'; '.join(problems)}")


def _differ(expected: str, found: str) -> bool:
    return expected.strip().casefold() != found.strip().casefold()
