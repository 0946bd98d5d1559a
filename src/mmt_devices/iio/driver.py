"""``iio-accelerometer``: an accelerometer through the buffer of Linux's industrial I/O."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import ConfigDict, Field

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.axes import SensorAxesOptions
from mmt.devices.drivers import read_options
from mmt.devices.record_clocks import CountingClock
from mmt.devices.sensor_drivers import AccelerometerDriver
from mmt_devices.iio.attributes import find_device, find_iio_accelerometers
from mmt_devices.iio.capture import Capture

DRIVER: Final = "iio-accelerometer"
RATES: Final = (
    "as many samples a second as the sensor has (rate_hz), an ADXL355 or ADXL359 4000, an ADXL345 "
    "3200"
)

_ERROR_AT_REST: Final = 0.15
"""Largest relative error of gravity; data sheets allow 0.1 g, and several per cent of gain."""
_GAP: Final = 1.75
"""Samples are missing if stamps are more periods apart; late interrupts cause less."""
_AHEAD_NS: Final = 1_000_000
"""Longest time by which a stamp may be ahead of its clock."""

Raw = tuple[int, ...]
"""Counts of the axes; as decoded, a stamped scan has its time (ns) as last number."""


FINDERS: Final = {"IIO accelerometers": find_iio_accelerometers}


class IioOptions(SensorAxesOptions):
    """Options of ``iio-accelerometer``."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    device: str | None = None
    """Name (such as ``adxl355``) or number of its ``iio:device``; None for the only one."""
    rate_hz: float = Field(2000.0, ge=1.0, le=100_000.0)
    """Samples a second; the next higher rate that the sensor offers is used."""
    stamps: Literal["kernel", "counted"] = "kernel"
    """Time of a sample: the kernel's stamp, or by counting if the kernel's driver gives none."""
    trigger: str | None = None
    """Trigger of a scan; None for the one that is set already, or the sensor's own interrupt."""
    length: int = Field(1024, ge=8, le=65_536)
    """Length of the kernel's buffer, in scans."""
    latency_ms: float = Field(0.0, ge=0.0, le=1000.0)
    """Delay from motion to stamp: that of the sensor's filter, from its data sheet."""
    range_g: float | None = Field(None, gt=0.0, le=500.0)
    """Acceleration at which the sensor cuts off; None for the most that its bits hold."""
    stuck_s: float = Field(1.0, ge=0.05, le=3600.0)
    """After this time without a change of a single bit, the sensor counts as stuck."""
    start_s: float = Field(1.0, ge=0.1, le=30.0)
    """How long the first sample may take."""
    sysfs_root: str = "/sys/bus/iio/devices"
    """Directory of the devices' attributes."""
    dev_root: str = "/dev"
    """Directory of the character devices."""


class IioAccelerometer(AccelerometerDriver):
    """`SampledSensor` of accelerations; counting the samples gives their times.

    Parameters
    ----------
    options
        Validated options.
    """

    def __init__(self, options: IioOptions) -> None:
        super().__init__(f"accelerometer {options.device or ''}".strip(), options.stuck_s)
        self._options, self._first_s = options, options.start_s
        self.latency_ns = round(1e6 * options.latency_ms)
        self._capture: Capture | None = None
        self._unfinished = b""
        self._clock: CountingClock | None = None

    def _open(self) -> None:
        """Find and set up the device, and start the capture."""
        if sys.platform != "linux":
            raise MmtError(
                f"{DRIVER}: industrial I/O is a part of Linux, and this is another system"
            )
        options = self._options
        directory = find_device(Path(options.sysfs_root), options.device)
        capture = Capture(directory, Path(options.dev_root) / directory.name, self.name)
        self._capture = capture
        stamped = options.stamps == "kernel"
        capture.start(options.rate_hz, options.length, options.trigger, stamped=stamped)
        self._prepare(capture)

    def explain_fault(self) -> str:
        """Return why no samples arrive, as far as the kernel tells."""
        return "" if self._capture is None else self._capture.explain_fault()

    def close(self) -> None:
        """Stop the capture and restore the changed settings; calling it twice is harmless."""
        if self._capture is not None:
            self._capture.stop()
            self._capture = None

    def samples(self) -> list[tuple[int, Raw]]:
        """Return time and counts of the scans that have arrived."""
        capture = self._capture
        if capture is None:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        content = capture.read()
        now_ns = time.monotonic_ns()
        size = capture.layout.size
        if len(content) >= capture.length * size:
            self._counts["full buffer"] += 1
        content, self._unfinished = self._unfinished + content, b""
        if odd := len(content) % size:
            content, self._unfinished = content[:-odd], content[-odd:]
        return self._stamp(list(capture.layout.decode(content)), now_ns)

    def _stamp(self, scans: Sequence[Raw], now_ns: int) -> list[tuple[int, Raw]]:
        """Return the scans with their times."""
        clock = self._clock
        assert clock is not None  # noqa: S101 - made before the first scan is taken
        clock.arrive(len(scans), now_ns)
        return [(clock.next(), raw) for raw in scans]

    def _prepare(self, capture: Capture) -> None:
        self._unfinished = b""
        offset, scale = capture.scales()
        range_g = self._options.range_g
        largest_m_s2 = float("inf") if range_g is None else range_g * GRAVITY_M_S2
        ends = [
            min(min(-(low + zero), high + zero) * each, largest_m_s2)
            for (low, high), zero, each in zip(capture.bounds, offset, scale, strict=True)
        ]
        x, y, z = offset
        self._set_axes(self._options.axes, scale, (-x, -y, -z), ends)
        self._start_clock(capture)

    def _start_clock(self, capture: Capture) -> None:
        if not capture.rate_hz:
            raise MmtError(
                f"{self.name}: nothing tells its rate, by which samples are counted: set stamps = "
                '"kernel"'
            )
        if self._clock is not None and self._clock.period_ns == 1e9 / capture.rate_hz:
            self._clock.interrupt()
        else:
            self._clock = CountingClock(capture.rate_hz, self._counts, "lost samples")

    def _explain_absence(self) -> str:
        why = self.explain_fault().removeprefix(f"{self.name}: ")
        return (
            f"{self.name}: no sample for {self._options.start_s:g} s though its buffer runs; "
            f"{why or 'check the wire from its interrupt to the pin that the overlay names'}"
        )

    def _doubt(self) -> tuple[float, str]:
        why = "it was moved, or its driver in the kernel is for another sensor (in_accel_scale)"
        return _ERROR_AT_REST, why


class StampedAccelerometer(IioAccelerometer):
    """`SampledSensor` of accelerations that the kernel stamps by the monotonic clock.

    This is the host's clock, so that a stamp is the time of arrival, too.
    """

    def __init__(self, options: IioOptions) -> None:
        super().__init__(options)
        self._newest_ns = 0
        self._period_ns = 0.0
        self._impossible = 0  # stamps since the last good one

    @property
    def arrival_ns(self) -> int:
        """When the newest reading was stamped, by the host's monotonic clock."""
        return self._newest_ns

    def explain_fault(self) -> str:
        """Return why no samples arrive, or that their time stamps are impossible."""
        if self._impossible:
            return (
                f"{self.name}: its samples have impossible time stamps ({self._impossible} in a "
                'row): look whether current_timestamp_clock says "monotonic"; another program may '
                "have set it"
            )
        return super().explain_fault()

    def _start_clock(self, capture: Capture) -> None:
        self._newest_ns = 0
        self._impossible = 0
        self._period_ns = 1e9 / capture.rate_hz if capture.rate_hz else 0.0

    def _stamp(self, scans: Sequence[Raw], now_ns: int) -> list[tuple[int, Raw]]:
        stamped: list[tuple[int, Raw]] = []
        for *raw, time_ns in scans:
            if not self._newest_ns < time_ns <= now_ns + _AHEAD_NS:
                self._counts["impossible stamp"] += 1
                self._impossible += 1
                continue
            periods = (time_ns - self._newest_ns) / self._period_ns if self._period_ns else 0.0
            if self._newest_ns and periods > _GAP:
                self._counts["lost samples"] += round(periods) - 1
            self._newest_ns, self._impossible = time_ns, 0
            stamped.append((time_ns, tuple(raw)))
        return stamped


def iio_accelerometer(**options: Any) -> IioAccelerometer:
    """Return the driver for the option `stamps`; see `IioOptions`."""
    given = read_options(IioOptions, DRIVER, options)
    return (StampedAccelerometer if given.stamps == "kernel" else IioAccelerometer)(given)
