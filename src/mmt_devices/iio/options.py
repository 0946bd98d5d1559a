"""Options of an accelerometer of industrial I/O."""

from typing import Literal

from pydantic import ConfigDict, Field

from mmt.devices.accelerometer_axes import AxesOptions


class IioOptions(AxesOptions):
    """Options of ``iio-accelerometer``."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    device: str | None = None
    """Its name, as ``adxl355``, or the number of its ``iio:device``; None for the only one."""
    rate_hz: float = Field(2000.0, ge=1.0, le=100_000.0)
    """Samples a second; the sensor takes the next rate that it has above."""
    stamps: Literal["kernel", "counted"] = "kernel"
    """Time of a sample: the kernel's stamp, or by counting where its driver gives none."""
    trigger: str | None = None
    """What starts a scan; None for the sensor's own interrupt, or what is set already."""
    length: int = Field(1024, ge=8, le=65_536)
    """Scans that the kernel holds until they are read."""
    latency_ms: float = Field(0.0, ge=0.0, le=1000.0)
    """From the motion to the stamp: the delay of the sensor's filter, of its data sheet."""
    range_g: float | None = Field(None, gt=0.0, le=500.0)
    """Where the sensor cuts off; None for as much as its bits hold."""
    stuck_s: float = Field(1.0, ge=0.05, le=3600.0)
    """After this time without a change of a single bit, the sensor counts as stuck."""
    start_s: float = Field(1.0, ge=0.1, le=30.0)
    """How long the first sample may take."""
    sysfs_root: str = "/sys/bus/iio/devices"
    """Where its attributes are."""
    dev_root: str = "/dev"
    """Where its character device is."""
