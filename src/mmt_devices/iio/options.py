"""Options of an accelerometer of industrial I/O."""

from typing import Literal

from pydantic import ConfigDict, Field

from mmt.devices.axes import SensorAxesOptions


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
