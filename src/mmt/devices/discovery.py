"""What hardware and which drivers this machine has; nothing is opened or moved."""

import os
from collections.abc import Mapping
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.devices.drivers import DRIVERS, Role, load_factory, offered, roles_of, software

KNOWN_USB: Final[dict[tuple[int, int], str]] = {
    (0x0CD5, 0x0006): "LabJack U6",
    (0x0301, 0x2988): "Touch haptic device",
    (0x2988, 0x0302): "Touch haptic device",
}
"""Vendor and product of devices for which there may be a driver."""

NO_LIBUSB: Final = "the library libusb 1.0 is not there: install it (Debian, Ubuntu: libusb-1.0-0)"


@dataclass(frozen=True)
class FoundDriver:
    """A driver that a scene can name."""

    name: str
    roles: tuple[Role, ...]
    """What it can be in a scene; empty where it does not tell."""
    factories: tuple[str, ...]
    """``module:factory`` for each role; one alone where it does not tell."""
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
    """Why it cannot be opened, with what to do; empty if it can be."""


def find_drivers() -> list[FoundDriver]:
    """Return the drivers of the table and of other packages; each is imported."""
    own = {**DRIVERS, **software()}
    found = [_own(name, roles) for name, roles in own.items()]
    found += [
        _offered(name, entry.value, entry.dist.name if entry.dist is not None else "?")
        for name, entry in offered().items()
        if name not in own
    ]
    return sorted(found, key=lambda driver: driver.name)


def _own(name: str, targets: Mapping[Role, str]) -> FoundDriver:
    problem = ""
    try:
        for role in targets:
            load_factory(name, role)
    except MmtError as error:
        problem = str(error)
    else:
        problem = missing_for(name)
    return FoundDriver(name, tuple(targets), tuple(targets.values()), "mmt", problem)


def _offered(name: str, origin: str, package: str) -> FoundDriver:
    try:
        return FoundDriver(name, roles_of(name), (origin,), package, "")
    except MmtError as error:
        return FoundDriver(name, (), (origin,), package, str(error))


def missing_for(driver: str) -> str:
    """Return what one of mmt's own drivers lacks on this machine, with what to do."""
    if driver == "haptuator-sound":
        return _missing_sound()
    if driver == "openhaptics" and find_library("HD") is None:
        return (
            "the vendor's library (libHD) is not where the system looks: install the vendor's "
            "OpenHaptics package, or give its path by the option 'library'"
        )
    if driver == "franka":
        return _missing_package("franky")
    if driver in {"labjack-u6", "adxl335-u6"} and not _has_libusb():
        return NO_LIBUSB
    if driver in {"ur", "virtual-ur"}:
        return _missing_package("rtde_control")
    return ""


def _missing_package(name: str) -> str:
    try:
        require(name)
    except MmtError as error:
        return str(error)
    return ""


def _missing_sound() -> str:
    from mmt.devices.haptuator.sound import load_sounddevice

    try:
        load_sounddevice()
    except MmtError as error:
        return str(error)
    return ""


def _has_libusb() -> bool:
    import usb.backend.libusb1

    return usb.backend.libusb1.get_backend() is not None


def find_sound_outputs() -> list[FoundPort]:
    """Return the sound cards' outputs, by the number and name that a scene can give.

    Raises
    ------
    MmtError
        There is no library to ask.
    """
    from mmt.devices.haptuator.sound import load_sounddevice

    return [
        FoundPort(str(entry["index"]), f"{entry['name']}, {channels} channels", "", "")
        for entry in load_sounddevice().query_devices()
        if (channels := entry["max_output_channels"]) > 0
    ]


def find_serial_ports() -> list[FoundPort]:
    """Return the serial ports that belong to a device; built-in ones that lead nowhere are not.

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
            _access_problem(port.device),
        )
        for port in sorted(list_ports.comports())
        if port.hwid != "n/a"
    ]


def find_iio_accelerometers(
    sysfs_root: Path = Path("/sys/bus/iio/devices"), dev_root: Path = Path("/dev")
) -> list[FoundPort]:
    """Return the accelerometers of Linux's industrial I/O."""
    from mmt.devices.iio.attributes import NO_PERMISSION, accelerometers, name_of

    found = []
    for path in accelerometers(sysfs_root):
        needed = {dev_root / path.name: os.R_OK, path / "buffer" / "enable": os.W_OK}
        refused = [
            file for file, way in needed.items() if file.exists() and not os.access(file, way)
        ]
        problem = NO_PERMISSION.format(path=refused[0]) if refused else ""
        found.append(FoundPort(path.name, name_of(path), "", problem))
    return found


def find_usb_devices() -> list[FoundPort]:
    """Return the USB devices for which there may be a driver.

    Raises
    ------
    InputError
        pyusb is not installed.
    MmtError
        There is no library to ask.
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
                    f"{ids[0]:04x}:{ids[1]:04x}", KNOWN_USB[ids], "", _access_problem(node, ids[0])
                )
            )
    return found


def _usb_name(vendor: int | None, product: int | None, said: str) -> str:
    if vendor is None or product is None:
        return said
    return f"{KNOWN_USB.get((vendor, product), said)} ({vendor:04x}:{product:04x})"


def _access_problem(path: str, vendor: int | None = None) -> str:
    """Return what keeps the person from opening a device file, of a USB device's vendor."""
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
