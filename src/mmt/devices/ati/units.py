"""Units of force and torque by the names that devices and calibration files give them."""

from typing import Final

from mmt.core.errors import InputError

_FORCES_N: Final = {
    "n": 1.0,
    "newton": 1.0,
    "kn": 1e3,
    "lbf": 4.4482216152605,
    "lb": 4.4482216152605,
    "klbf": 4448.2216152605,
    "klb": 4448.2216152605,
    "kgf": 9.80665,
    "kg": 9.80665,
    "gf": 9.80665e-3,
    "g": 9.80665e-3,
}
_LENGTHS_MM: Final = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "in": 25.4,
    "ft": 304.8,
}


def force_in_newton(unit: str, device: str) -> float:
    """Return how many newton one of the unit is.

    Raises
    ------
    InputError
        The unit is not known.
    """
    factor = _FORCES_N.get(unit.strip().lower())
    if factor is None:
        raise InputError(
            f"{device}: the unit of force {unit!r} is not known; set it to N in the device"
        )
    return factor


def torque_in_newton_mm(unit: str, device: str) -> float:
    """Return how many newton millimetres one of the unit is: ``Nm``, ``N-mm``, ``lbf-in`` ...

    Raises
    ------
    InputError
        The unit is not known.
    """
    name = unit.strip().lower().replace("-", "").replace("*", "").replace(" ", "")
    for length, millimetres in _LENGTHS_MM.items():
        force = name.removesuffix(length)
        if force != name and force in _FORCES_N:
            return _FORCES_N[force] * millimetres
    raise InputError(
        f"{device}: the unit of torque {unit!r} is not known; set it to N-m or N-mm in the device"
    )


def length_in_mm(unit: str, device: str) -> float:
    """Return how many millimetres one of the unit is.

    Raises
    ------
    InputError
        The unit is not known.
    """
    factor = _LENGTHS_MM.get(unit.strip().lower())
    if factor is None:
        raise InputError(f"{device}: the unit of length {unit!r} is not known")
    return factor
