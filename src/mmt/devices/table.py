"""Drivers by name and role; none is imported before a scene asks for it."""

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Final, Literal

from mmt.core.errors import InputError

Role = Literal["robot", "force_sensor", "accelerometer", "handle", "actuator", "board"]
"""What a device can be in a scene: in ``[devices]``, as ``[handle]``, as ``[actuator]``, or the
acquisition board of a sensor that gives bare voltages."""

ROLE_NAMES: Final[dict[Role, str]] = {
    "robot": "robot",
    "force_sensor": "force sensor",
    "accelerometer": "accelerometer",
    "handle": "handle",
    "actuator": "actuator",
    "board": "acquisition board",
}
"""As a person calls them."""

GROUP: Final = "mmt.devices"
"""The group of entry points under which another package offers its drivers by name."""

DRIVERS: Final[dict[str, Mapping[Role, str]]] = {
    "adxl335-serial": {"accelerometer": "mmt.devices.adxl335.serial_driver:SerialAdxl335"},
    "adxl335-u6": {"accelerometer": "mmt.devices.adxl335.u6_driver:U6Adxl335"},
    "ati-digital-ft": {"force_sensor": "mmt.devices.ati.digital_ft:digital_ft"},
    "ati-gauges": {"force_sensor": "mmt.devices.ati.gauges:gauges"},
    "ati-net-ft": {"force_sensor": "mmt.devices.ati.net_ft:net_ft"},
    "haptuator-serial": {"actuator": "mmt.devices.haptuator.serial_driver:haptuator_serial"},
    "haptuator-sound": {"actuator": "mmt.devices.haptuator.sound:haptuator_sound"},
    "labjack-u6": {"board": "mmt.devices.labjack.board:labjack_u6"},
    "openhaptics": {
        "robot": "mmt.devices.openhaptics.robot:OpenHapticsRobot",
        "handle": "mmt.devices.openhaptics.handle:OpenHapticsHandle",
    },
    "virtual-adxl335": {"accelerometer": "mmt.testing.emulated.drivers:VirtualAdxl335"},
    "virtual-handle-adxl335": {
        "accelerometer": "mmt.testing.emulated.drivers:VirtualHandleAdxl335"
    },
    "virtual-haptuator": {"actuator": "mmt.testing.emulated.drivers:VirtualHaptuator"},
    "virtual-net-ft": {"force_sensor": "mmt.testing.emulated.drivers:VirtualNetFt"},
    "virtual-robot": {"robot": "mmt.testing.emulated.drivers:VirtualRobot"},
}
"""Name -> role -> ``module:factory`` of the drivers that are part of mmt."""


def offered() -> dict[str, EntryPoint]:
    """Return the drivers that other installed packages offer, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def locate(driver: str, role: Role | None = None) -> str:
    """Return ``module:factory`` of a driver.

    Parameters
    ----------
    driver
        A name of the table, one that an installed package offers, or ``package.module:factory``.
    role
        What the device is to be; None takes the driver's first role.

    Raises
    ------
    InputError
        There is no driver of that name, or it cannot be that; the message lists those that can.
    """
    if ":" in driver:
        return driver
    if driver in DRIVERS:
        targets = DRIVERS[driver]
        if role is None:
            return next(iter(targets.values()))
        if role in targets:
            return targets[role]
        raise InputError(
            f"driver {driver!r} is for {_named(targets)}, it cannot be the {ROLE_NAMES[role]}; "
            f"drivers for that are {', '.join([*_able(role), ''])}package.module:factory, and "
            "what other packages offer"
        )
    others = offered()
    if driver in others:
        return others[driver].value
    names = sorted({*DRIVERS, *others})
    raise InputError(
        f"driver {driver!r} is not known; allowed are {', '.join([*names, ''])}"
        "package.module:factory, and the names that other packages offer as entry points of "
        f"{GROUP}"
    )


def _named(targets: Mapping[Role, str]) -> str:
    names = [ROLE_NAMES[role] for role in targets]
    return " or ".join(f"{'an' if name[0] in 'aeiou' else 'a'} {name}" for name in names)


def _able(role: Role) -> list[str]:
    return [name for name, targets in DRIVERS.items() if role in targets]
