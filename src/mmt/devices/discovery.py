"""What hardware and which drivers this machine has; nothing is opened or moved."""

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mmt.devices.loading import load_factory
from mmt.devices.table import DRIVERS, offered
from mmt.errors import MmtError

KNOWN_USB: Final[dict[tuple[int, int], str]] = {
    (0x0CD5, 0x0006): "LabJack U6",
    (0x0301, 0x2988): "Touch haptic device",
    (0x2988, 0x0302): "Touch haptic device",
}
"""Vendor and product of devices for which there may be a driver."""

NO_LIBUSB: Final = "USB devices cannot be listed: install libusb 1.0 (Debian: libusb-1.0-0)"


@dataclass(frozen=True)
class FoundDriver:
    """A driver that a scene can name."""

    name: str
    origin: str
    """``module:factory``."""
    package: str
    """What brought it: "mmt" or the package that offers it."""
    problem: str
    """Why it cannot be used, with what to do; empty where it can be imported."""


@dataclass(frozen=True)
class FoundPort:
    """A serial port or a USB device."""

    address: str
    what: str
    serial: str
    problem: str
    """Why it cannot be opened, with what to do; empty where nothing speaks against it."""


def find_drivers() -> list[FoundDriver]:
    """Return the drivers of the table and of other packages; each is imported."""
    found = [_driver(name, origin, "mmt") for name, origin in DRIVERS.items()]
    found += [
        _driver(name, entry.value, entry.dist.name if entry.dist is not None else "?")
        for name, entry in offered().items()
        if name not in DRIVERS
    ]
    return sorted(found, key=lambda driver: driver.name)


def _driver(name: str, origin: str, package: str) -> FoundDriver:
    try:
        load_factory(name)
    except MmtError as error:
        return FoundDriver(name, origin, package, str(error))
    return FoundDriver(name, origin, package, "")


def find_serial_ports() -> list[FoundPort]:
    """Return the serial ports that belong to a device; built-in ones that lead nowhere are not."""
    from serial.tools import list_ports

    return [
        FoundPort(
            port.device,
            _usb_name(port.vid, port.pid, port.product or port.description or ""),
            port.serial_number or "",
            _access_problem(port.device),
        )
        for port in sorted(list_ports.comports())
        if port.hwid != "n/a"
    ]


def find_usb_devices() -> list[FoundPort]:
    """Return the USB devices for which there may be a driver.

    Raises
    ------
    MmtError
        There is no library to ask.
    """
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
                FoundPort(f"{ids[0]:04x}:{ids[1]:04x}", KNOWN_USB[ids], "", _access_problem(node))
            )
    return found


def _usb_name(vendor: int | None, product: int | None, said: str) -> str:
    if vendor is None or product is None:
        return said
    return f"{KNOWN_USB.get((vendor, product), said)} ({vendor:04x}:{product:04x})"


def _access_problem(path: str) -> str:
    """Return what keeps the person from opening a device file."""
    if not Path(path).exists() or os.access(path, os.R_OK | os.W_OK):
        return ""
    if path.startswith("/dev/bus/usb"):
        return f"no permission for {path}: add a udev rule that gives your group access"
    try:
        group = Path(path).group()
    except (NotImplementedError, KeyError, OSError):
        return f"no permission for {path}"
    return f"no permission for {path}: sudo usermod -a -G {group} $USER, then log in again"


OPTIONAL_LIBRARIES: Final = {
    "serial": ("serial ports", "pip install pyserial"),
    "usb": ("USB devices", "pip install pyusb"),
    "sounddevice": ("sound cards", "pip install sounddevice"),
}


def missing_libraries() -> dict[str, str]:
    """Return what cannot be reached without a library, and how to get it."""
    return {
        what: how
        for module, (what, how) in OPTIONAL_LIBRARIES.items()
        if importlib.util.find_spec(module) is None
    }
