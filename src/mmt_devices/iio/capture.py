"""Buffered capture by industrial I/O: set up by attributes, read from the character device.

Sources: the kernel's ``Documentation/iio/iio_devbuf.rst`` and
``Documentation/ABI/testing/sysfs-bus-iio``.
"""

import contextlib
import os
import re
from pathlib import Path
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt_devices.iio.attributes import Attributes
from mmt_devices.iio.layout import TIMESTAMP, Layout, parse_element

AXES: Final = ("in_accel_x", "in_accel_y", "in_accel_z")
_RATES: Final = ("in_accel_sampling_frequency", "sampling_frequency")
_TRIGGER: Final = "trigger/current_trigger"
_CLOCK: Final = "current_timestamp_clock"


class Capture:
    """One device that captures into its buffer.

    Parameters
    ----------
    directory
        Such as ``/sys/bus/iio/devices/iio:device0``.
    node
        Such as ``/dev/iio:device0``.
    name
        Name of the device in messages.
    """

    def __init__(self, directory: Path, node: Path, name: str) -> None:
        self._name = name
        self._node = node
        self._device = Attributes(directory, name)
        self._trigger: Attributes | None = None
        self._file = -1
        legacy = self._device.has("scan_elements")  # else both share a directory
        self._buffer = "buffer" if legacy or not self._device.has("buffer0") else "buffer0"
        self._scan = "scan_elements" if legacy else self._buffer
        self.length = 0
        """Length of the kernel's buffer, in scans."""
        self.rate_hz = 0.0
        """Scans a second, 0 if no attribute tells."""
        self.layout: Layout
        """Layout of a scan: x, y, z and, if stamped, the time."""
        self.bounds: tuple[tuple[int, int], ...] = ()
        """Least and largest value of each axis."""

    def start(self, rate_hz: float, length: int, trigger: str | None, *, stamped: bool) -> None:
        """Set up the device and start the capture; see `mmt_devices.iio.driver.IioOptions`.

        Raises
        ------
        MmtError
            The device cannot capture; the message says why and what to do.
        """
        if not self._device.has(f"{self._scan}/{AXES[0]}_en"):
            raise MmtError(
                f"{self._name}: its driver in the kernel offers no buffer; a newer kernel may (for "
                "the ADXL345, where its interrupt is wired), and an ADXL355 has one"
            )
        self._open()
        if self._device.read(f"{self._buffer}/enable") != "0":  # left by a program that was killed
            self._device.write(f"{self._buffer}/enable", "0")
        self._choose_trigger(trigger)
        self._set_rate(rate_hz)
        if stamped:
            self._stamp_by_monotonic_clock()
        self._choose_elements(stamped=stamped)
        self._device.set(f"{self._buffer}/length", str(length))
        self.length = int(self._device.number(f"{self._buffer}/length"))
        if self._device.has(f"{self._buffer}/watermark"):  # scans that a FIFO waits for
            self._device.set(f"{self._buffer}/watermark", "1")
        self._device.write(f"{self._buffer}/enable", "1")

    def read(self) -> bytes:
        """Return the scans that have arrived, at most a full buffer; never blocks.

        Raises
        ------
        DeviceLost
            The device is gone, or no longer captures.
        """
        if self._file < 0:
            raise DeviceLost(f"{self._name} is closed: connect it again")
        try:
            content = os.read(self._file, self.length * self.layout.size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._device.explain(error, self._node) from error
        if not content:
            why = self.explain_fault().removeprefix(f"{self._name}: ") or "look with dmesg why"
            raise DeviceLost(f"{self._name}: it captures no longer; {why}")
        return content

    def explain_fault(self) -> str:
        """Return why no scans arrive, as far as the attributes tell; else empty."""
        try:
            if self._device.read(f"{self._buffer}/enable") == "0":
                return f"{self._name}: another program has switched its buffer off; end that one"
            if self._device.has(_TRIGGER) and not self._device.read(_TRIGGER):
                return f"{self._name}: its trigger is gone; make it again, as 'trigger' names it"
        except MmtError as error:
            return str(error)
        return ""

    def scales(self) -> tuple[Vector, Vector]:
        """Return offset (counts) and scale (m/s2 a count) of x, y, z.

        Raises
        ------
        MmtError
            There is no scale.
        """
        offsets = [self._value(axis, "offset", "0") for axis in AXES]
        scales = [self._value(axis, "scale", "") for axis in AXES]
        return (offsets[0], offsets[1], offsets[2]), (scales[0], scales[1], scales[2])

    def stop(self) -> None:
        """Stop, and restore the changed settings; calling it twice is harmless."""
        if self._file < 0:
            return
        with contextlib.suppress(MmtError):
            self._device.write(f"{self._buffer}/enable", "0")
        os.close(self._file)
        self._file = -1
        self._device.restore()
        if self._trigger is not None:
            self._trigger.restore()

    def _open(self) -> None:
        try:
            self._file = os.open(self._node, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise self._device.explain(error, self._node) from error

    def _choose_trigger(self, wanted: str | None) -> None:
        """Set the trigger if the device needs one."""
        if not self._device.has(_TRIGGER):
            if wanted:
                raise MmtError(f"{self._name}: it takes no trigger; leave 'trigger' out")
            return
        root = self._device.directory.parent
        there = {}
        for path in sorted(root.glob("trigger*")):
            there[Attributes(path, self._name).read("name")] = path
        number = re.sub(r"\D", "", self._device.directory.name)
        own = f"{self._device.read('name')}-dev{number}"
        name = wanted or self._device.read(_TRIGGER) or (own if own in there else "")
        if name not in there:
            lacks = f"there is no trigger {wanted!r}" if wanted else "it has no trigger"
            raise MmtError(
                f"{self._name}: {lacks}; there are {', '.join(there) or 'none'}: wire its "
                "interrupt and name the pin in the overlay, or make a timer as docs/how-to/iio.md "
                "says and name it by 'trigger'"
            )
        self._device.set(_TRIGGER, name)
        self._trigger = Attributes(there[name], self._name)

    def _set_rate(self, rate_hz: float) -> None:
        """Set the next rate from `rate_hz` on, or else the highest; set a timer's rate as well."""
        for attribute in _RATES:
            if self._device.has(attribute):
                self._device.set(attribute, self._allowed_rate(attribute, rate_hz))
                self.rate_hz = self._device.number(attribute)
                break
        if self._trigger is not None and self._trigger.has("sampling_frequency"):
            rate_hz = min(rate_hz, self.rate_hz or rate_hz)  # faster than it samples makes no sense
            self._trigger.set("sampling_frequency", f"{rate_hz:g}")
            self.rate_hz = self._trigger.number("sampling_frequency")

    def _allowed_rate(self, attribute: str, rate_hz: float) -> str:
        if not self._device.has(f"{attribute}_available"):
            return f"{rate_hz:g}"
        allowed = self._device.read(f"{attribute}_available")
        values = allowed.strip("[]").split()
        if allowed.startswith("["):  # least, step, largest
            return f"{min(max(rate_hz, float(values[0])), float(values[-1])):g}"
        enough = [value for value in values if float(value) >= rate_hz]
        return min(enough, key=float) if enough else max(values, key=float)

    def _stamp_by_monotonic_clock(self) -> None:
        if not self._device.has(f"{self._scan}/{TIMESTAMP}_en"):
            raise MmtError(
                f"{self._name}: its driver in the kernel gives no time stamps (that of the ADXL345 "
                'does not): set stamps = "counted", which counts its samples by their rate'
            )
        if not self._device.has(_CLOCK):
            raise MmtError(
                f"{self._name}: this kernel stamps by a clock that is set at times: take Linux 4.7 "
                'or later, or set stamps = "counted"'
            )
        self._device.set(_CLOCK, "monotonic")

    def _choose_elements(self, *, stamped: bool) -> None:
        """Enable the wanted elements and no others, and work out the layout of a scan."""
        wanted = (*AXES, TIMESTAMP) if stamped else AXES
        scan = self._device.directory / self._scan
        names = sorted(path.name.removesuffix("_en") for path in scan.glob("*_en"))
        for name in names:
            self._device.set(f"{self._scan}/{name}_en", "1" if name in wanted else "0")
        enabled = [name for name in names if self._device.read(f"{self._scan}/{name}_en") != "0"]
        elements = [
            parse_element(
                name,
                self._device.read(f"{self._scan}/{name}_index"),
                self._device.read(f"{self._scan}/{name}_type"),
            )
            for name in enabled
        ]
        by_name = {element.name: element for element in elements}
        if missing := [name for name in wanted if name not in by_name]:
            raise MmtError(
                f"{self._name}: it does not capture {', '.join(missing)}; look with dmesg what its "
                "driver says"
            )
        self.layout = Layout(elements, wanted)
        self.bounds = tuple(by_name[axis].bounds for axis in AXES)

    def _value(self, axis: str, kind: str, without: str) -> float:
        """Return an attribute of one axis or of all axes, or else `without`."""
        for attribute in (f"{axis}_{kind}", f"in_accel_{kind}"):
            if self._device.has(attribute):
                return self._device.number(attribute)
        if not without:
            raise MmtError(f"{self._name}: its driver in the kernel gives no {kind}: {axis}_{kind}")
        return float(without)
