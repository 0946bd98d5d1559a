"""Find IIO devices, read and set their sysfs attributes, and explain file errors."""

import contextlib
import errno
import os
from pathlib import Path
from typing import Final

from mmt.core.bounds import finite_number
from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices.discovery import FoundPort

NO_PERMISSION: Final = (
    "no permission for {path}: files of industrial I/O belong to root until a udev rule gives them "
    "to a group; write the one of docs/how-to/iio.md, and join the group"
)


class Attributes:
    """Attributes below one directory; changed ones can be restored.

    Parameters
    ----------
    directory
        Such as ``/sys/bus/iio/devices/iio:device0``.
    name
        Name of the device in messages.
    """

    def __init__(self, directory: Path, name: str) -> None:
        self.directory = directory
        self._name = name
        self._before: list[tuple[str, str]] = []

    def has(self, attribute: str) -> bool:
        """Return whether there is this attribute."""
        return (self.directory / attribute).exists()

    def read(self, attribute: str) -> str:
        """Return the content of an attribute.

        Raises
        ------
        MmtError
            The file cannot be read.
        """
        path = self.directory / attribute
        try:
            return path.read_text(encoding="ascii", errors="replace").strip()
        except OSError as error:
            raise self.explain(error, path) from error

    def number(self, attribute: str) -> float:
        """Return the number that an attribute holds.

        Raises
        ------
        MmtError
            The file cannot be read, or holds no finite number.
        """
        content = self.read(attribute)
        try:
            return finite_number(content)
        except ValueError as error:
            raise MmtError(
                f"{self._name}: {self.directory / attribute} holds {content!r} and no finite "
                "number; look with dmesg what its driver says"
            ) from error

    def write(self, attribute: str, value: str) -> None:
        """Write a value.

        Raises
        ------
        MmtError
            The kernel refuses the value, or writing is not permitted.
        """
        path = self.directory / attribute
        try:
            path.write_text(value, encoding="ascii")
        except OSError as error:
            raise self.explain(error, path, value) from error

    def set(self, attribute: str, value: str) -> None:
        """Write a value if the attribute differs, and remember the old value."""
        before = self.read(attribute)
        if before != value:
            self.write(attribute, value)
            self._before.append((attribute, before))

    def restore(self) -> None:
        """Restore the values that `set` has changed, the last first, as far as possible."""
        while self._before:
            attribute, before = self._before.pop()
            with contextlib.suppress(MmtError):
                self.write(attribute, before)

    def explain(self, error: OSError, path: Path, value: str = "") -> MmtError:
        """Return why a file of the device cannot be used, with what to do."""
        if error.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
            return MmtError(f"{self._name}: {NO_PERMISSION.format(path=path)}")
        if error.errno == errno.EBUSY:
            return MmtError(
                f"{self._name}: {path.name} is in use: another program has it open (iio_readdev, "
                "another follower); end that one"
            )
        if error.errno in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
            return DeviceLost(
                f"{self._name}: {path} is gone; check the wires, and with dmesg why the kernel has "
                "let it go"
            )
        wrote = f" {value!r} in" if value else ""
        return MmtError(
            f"{self._name}: the kernel refuses{wrote} {path} ({error.strerror or error}); look "
            "with dmesg what its driver says"
        )


def find_device(root: Path, wanted: str | None) -> Path:
    """Return the directory of an accelerometer.

    Parameters
    ----------
    root
        Such as ``/sys/bus/iio/devices``.
    wanted
        Name (such as ``adxl355``), number or directory's name; None for the only accelerometer.

    Raises
    ------
    InputError
        No device fits, or several do.
    """
    devices = {path: name_of(path) for path in sorted(root.glob("iio:device*"))}
    if wanted is None:
        found = accelerometers(root)
    else:
        found = [
            path
            for path, name in devices.items()
            if wanted in {name, path.name, path.name.removeprefix("iio:device")}
        ]
    if len(found) == 1:
        return found[0]
    names = ", ".join(f"{path.name} ({name})" for path, name in devices.items()) or "none"
    what = "accelerometer" if wanted is None else f"device {wanted!r}"
    if found:
        raise InputError(
            f"industrial I/O has {len(found)} of the {what}: name one by 'device'; there are "
            f"{names}"
        )
    raise InputError(
        f"industrial I/O has no {what} in {root}; there are {names}: check the overlay in "
        "config.txt, that the kernel's module is loaded (lsmod), and with dmesg what it says"
    )


def accelerometers(root: Path) -> list[Path]:
    """Return the directories of the accelerometers below `root`."""
    return [
        path
        for path in sorted(root.glob("iio:device*"))
        if any(path.glob("in_accel_x_*")) or any(path.glob("scan_elements/in_accel_x_*"))
    ]


def name_of(path: Path) -> str:
    """Return the name of a device; empty if it has none."""
    with contextlib.suppress(OSError):
        return (path / "name").read_text(encoding="ascii", errors="replace").strip()
    return ""


def find_iio_accelerometers(
    sysfs_root: Path = Path("/sys/bus/iio/devices"), dev_root: Path = Path("/dev")
) -> list[FoundPort]:
    """Return the accelerometers of Linux's industrial I/O."""
    found = []
    for path in accelerometers(sysfs_root):
        needed = {dev_root / path.name: os.R_OK, path / "buffer" / "enable": os.W_OK}
        refused = [
            file for file, way in needed.items() if file.exists() and not os.access(file, way)
        ]
        problem = NO_PERMISSION.format(path=refused[0]) if refused else ""
        found.append(FoundPort(path.name, name_of(path), "", problem))
    return found
