"""Drivers by name; none is imported before a scene asks for it."""

from importlib.metadata import EntryPoint, entry_points
from typing import Final

from mmt.errors import InputError

GROUP: Final = "mmt.devices"
"""The group of entry points under which another package offers its drivers by name."""

DRIVERS: Final[dict[str, str]] = {
    "ati-digital-ft": "mmt.devices.ati.digital_ft:digital_ft",
    "ati-gauges": "mmt.devices.ati.gauges:gauges",
    "ati-net-ft": "mmt.devices.ati.net_ft:net_ft",
    "labjack-u6": "mmt.devices.labjack.board:labjack_u6",
    "haptuator-serial": "mmt.devices.haptuator.serial_driver:haptuator_serial",
    "haptuator-sound": "mmt.devices.haptuator.sound:haptuator_sound",
    "openhaptics": "mmt.devices.openhaptics.robot:OpenHapticsRobot",
    "adxl335-serial": "mmt.devices.adxl335.serial_driver:SerialAdxl335",
    "adxl335-u6": "mmt.devices.adxl335.u6_driver:U6Adxl335",
    "virtual-robot": "mmt.devices.emulated.drivers:VirtualRobot",
    "virtual-net-ft": "mmt.devices.emulated.drivers:virtual_net_ft",
    "virtual-adxl335": "mmt.devices.emulated.drivers:virtual_adxl335",
}
"""Name -> ``module:factory`` of the drivers that are part of mmt."""

HANDLES: Final[dict[str, str]] = {
    "openhaptics": "mmt.devices.openhaptics.handle:OpenHapticsHandle",
}
"""Likewise for the leader's handle, where a device can be that as well as a robot."""


def offered() -> dict[str, EntryPoint]:
    """Return the drivers that other installed packages offer, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def locate(driver: str, role: str = "device") -> str:
    """Return ``module:factory`` of a driver.

    Parameters
    ----------
    driver
        A name of the table, one that an installed package offers, or ``package.module:factory``.
    role
        "handle" where the device is to be the leader's handle.

    Raises
    ------
    InputError
        There is no driver of that name; the message lists those that there are.
    """
    if ":" in driver:
        return driver
    if role == "handle" and driver in HANDLES:
        return HANDLES[driver]
    if driver in DRIVERS:
        return DRIVERS[driver]
    others = offered()
    if driver in others:
        return others[driver].value
    names = sorted({*DRIVERS, *others})
    raise InputError(
        f"driver {driver!r} is not known; allowed are {', '.join([*names, ''])}"
        "package.module:factory, and the names that other packages offer as entry points of "
        f"{GROUP}"
    )
