"""List the hardware and the drivers of this machine; nothing is opened or moved."""

import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Final

from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.core.plugins import is_own, package_of
from mmt.devices.drivers import Role, drivers, entry_points_by_role, load_factory, roles_of

KNOWN_USB: Final[dict[tuple[int, int], str]] = {
    (0x0CD5, 0x0006): "LabJack U6",
    (0x0301, 0x2988): "Touch haptic device",
    (0x2988, 0x0302): "Touch haptic device",
}
"""Vendor and product numbers of devices that may have a driver, and what the devices are."""

NO_LIBUSB: Final = "the library libusb 1.0 is not there: install it (Debian, Ubuntu: libusb-1.0-0)"


@dataclass(frozen=True)
class FoundDriver:
    """A driver that a scene can name."""

    name: str
    roles: tuple[Role, ...]
    """Roles that it can take in a scene; empty if it does not tell."""
    factories: tuple[str, ...]
    """``module:factory`` for each role; a single one if it does not tell its roles."""
    package: str
    """Package that offers the driver, "mmt" among them."""
    problem: str
    """Why the driver cannot be used and what to do, or empty."""
    rates: str = ""
    """Samples a second and band of a board, or of an accelerometer with its own clock."""


@dataclass(frozen=True)
class FoundPort:
    """A serial port or a USB device."""

    address: str
    what: str
    serial: str
    problem: str
    """Why it cannot be opened and what to do, or empty."""


Finder = Callable[[], list[FoundPort]]


def find_drivers() -> list[FoundDriver]:
    """Return the drivers that installed packages offer; each is imported.

    A driver's module may have a function ``missing() -> str``, which says what this machine lacks
    and what to do; a mapping ``FINDERS`` from a heading to a function that lists the driver's
    devices (`FoundPort`); and a text ``RATES`` for `FoundDriver.rates`.
    """
    return [_found(name, entries) for name, entries in sorted(drivers().items())]


def drivers_with(role: Role, method: str) -> list[str]:
    """Return the names of drivers for a role whose class has a method."""
    able = []
    for name in sorted(drivers()):
        with suppress(MmtError):
            if role in entry_points_by_role(name) and hasattr(load_factory(name, role), method):
                able.append(name)
    return able


def _found(name: str, entries: Mapping[str, EntryPoint]) -> FoundDriver:
    first = next(iter(entries.values()))
    package = first.module.partition(".")[0] if is_own(first) else package_of(first)
    targets = entry_points_by_role(name) or entries
    factories = tuple(entry.value for entry in targets.values())
    try:
        roles = roles_of(name)
        for role in roles or (None,):
            load_factory(name, role)
    except MmtError as error:
        return FoundDriver(name, tuple(entry_points_by_role(name)), factories, package, str(error))
    lacking = (getattr(sys.modules[each.module], "missing", str)() for each in entries.values())
    rates = getattr(sys.modules[first.module], "RATES", "")
    return FoundDriver(name, roles, factories, package, next(filter(None, lacking), ""), rates)


def find_all() -> dict[str, Finder]:
    """Return the functions that find devices, by heading; the drivers' own come last."""
    found: dict[str, Finder] = {"serial ports": find_serial_ports, "USB devices": find_usb_devices}
    for entries in drivers().values():
        for entry in entries.values():
            found.update(getattr(sys.modules.get(entry.module), "FINDERS", {}))
    return found


def lacking(needs: Callable[[], object]) -> Callable[[], str]:
    """Return a driver's ``missing``: it says why what the driver needs fails, empty if nothing."""

    def missing() -> str:
        try:
            needs()
        except MmtError as error:
            return str(error)
        return ""

    return missing


def missing_libusb() -> str:
    """Return how to install the library of USB devices, empty if it is there."""
    import usb.backend.libusb1

    return "" if usb.backend.libusb1.get_backend() is not None else NO_LIBUSB


def find_serial_ports() -> list[FoundPort]:
    """Return the serial ports that belong to a device, without unused built-in ones.

    Raises
    ------
    InputError
        pyserial is not installed.
    """
    require("serial")
    from serial.tools import list_ports

    return [
        FoundPort(
            port.device,
            _usb_name(port.vid, port.pid, port.product or port.description or ""),
            port.serial_number or "",
            access_problem(port.device),
        )
        for port in sorted(list_ports.comports())
        if port.hwid != "n/a"
    ]


def find_usb_devices() -> list[FoundPort]:
    """Return the USB devices for which there may be a driver.

    Raises
    ------
    InputError
        pyusb is not installed.
    MmtError
        The library libusb is missing.
    """
    require("usb")
    import usb.core

    try:
        devices = list(usb.core.find(find_all=True))
    except usb.core.NoBackendError as error:
        raise MmtError(NO_LIBUSB) from error
    found = []
    for device in devices:
        ids = (device.idVendor, device.idProduct)
        if ids in KNOWN_USB:
            node = f"/dev/bus/usb/{device.bus:03}/{device.address:03}"
            found.append(
                FoundPort(
                    f"{ids[0]:04x}:{ids[1]:04x}", KNOWN_USB[ids], "", access_problem(node, ids[0])
                )
            )
    return found


def _usb_name(vendor: int | None, product: int | None, given: str) -> str:
    if vendor is None or product is None:
        return given
    return f"{KNOWN_USB.get((vendor, product), given)} ({vendor:04x}:{product:04x})"


def access_problem(path: str, vendor: int | None = None) -> str:
    """Return why the user may not open a device file, or ''; `vendor` is that of a USB device."""
    if not Path(path).exists() or os.access(path, os.R_OK | os.W_OK):
        return ""
    if vendor is not None:
        return (
            f'no permission for {path}: write the line SUBSYSTEM=="usb", '
            f'ATTR{{idVendor}}=="{vendor:04x}", MODE="0666" into /etc/udev/rules.d/60-mmt.rules '
            "as root, and plug it in again"
        )
    try:
        group = Path(path).group()
    except (NotImplementedError, KeyError, OSError):
        return f"no permission for {path}"
    return f"no permission for {path}: sudo usermod -a -G {group} $USER, then log in again"
