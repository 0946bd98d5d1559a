"""Options of the ADXL335 drivers."""

from math import pi
from typing import Final

from pydantic import ConfigDict, Field

from mmt.devices.accelerometer_axes import AxesOptions

_Z_HZ: Final = 550.0
"""Largest bandwidth of the sensor's own z axis; x and y reach 1600 Hz (data sheet)."""
LARGEST_BANDWIDTH_HZ: Final = 1600.0
BAND: Final = (
    f"the sensor itself ends at {LARGEST_BANDWIDTH_HZ:g} Hz along its X and Y, at {_Z_HZ:g} Hz "
    "along its Z"
)
_MICROFARAD_HZ: Final = 5.0
"""f = 5 uF / C: the filter of the sensor's 32 kOhm and the board's capacitor (data sheet)."""


class Adxl335Options(AxesOptions):
    """Options of the sensor and its board."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    supply_v: float = Field(3.3, ge=1.8, le=3.6)
    """Supply voltage of the sensor; the output is proportional to it."""
    bandwidth_hz: float = Field(50.0, ge=0.5, le=LARGEST_BANDWIDTH_HZ)
    """-3 dB, set by the board's capacitors; breakout boards ship with 0.1 uF, which is 50 Hz."""
    band_hz: float = Field(500.0, gt=0.0, le=LARGEST_BANDWIDTH_HZ)
    """Highest wanted frequency: half the rate of the scene's acceleration, at most 1600."""
    serial: str | None = Field(None, min_length=1, max_length=64)
    """Serial number of the stored calibration; None takes the one that USB reports."""
    stuck_s: float = Field(1.0, ge=0.05, le=3600.0)
    """After this time with exactly the same value, the sensor counts as stuck."""

    @property
    def filter_delay_ns(self) -> int:
        """Delay of the board's filter well below its corner: 1 / (2 pi f)."""
        return round(1e9 / (2.0 * pi * self.bandwidth_hz))

    def remarks(self) -> list[str]:
        """Return a sentence for each doubtful option."""
        if self.band_hz > _Z_HZ:
            along = "xyz"[[axis[-1] for axis in self.axes].index("z")]
            sentences = [
                f"the sensor's own z axis, here the scene's {along}, ends at "
                f"{_Z_HZ:g} Hz, the scene wants {self.band_hz:g} Hz: turn the sensor so that x or "
                "y lies along the axis that is modelled, and say so by 'axes'"
            ]
        else:
            sentences = []
        if self.bandwidth_hz >= self.band_hz:
            return sentences
        farads = _MICROFARAD_HZ / self.bandwidth_hz
        wanted = _MICROFARAD_HZ / self.band_hz
        return [
            *sentences,
            f"the accelerometer's board passes {self.bandwidth_hz:g} Hz ({farads:.2g} uF at each "
            f"output), the scene wants {self.band_hz:g} Hz: vibration above is lost. Replace the "
            f"three capacitors by {wanted:.2g} uF or less (f = 5 uF / C), then set bandwidth_hz",
        ]


class SerialOptions(Adxl335Options):
    """Options of a microcontroller on a serial port."""

    port: str = Field(min_length=1)
    """Port, as ``/dev/ttyACM0`` or ``COM3``; better a name below ``/dev/serial/by-id``."""
    baud_rate: int = Field(500_000, ge=9600, le=4_000_000)
    """Bits a second; boards with native USB ignore it."""
    reference_v: float = Field(3.3, ge=1.0, le=5.5)
    """Full scale of the converter."""
    resolution_bits: int = Field(12, ge=8, le=16)
    """Resolution of the converter."""
    start_s: float = Field(3.0, ge=0.1, le=30.0)
    """Longest wait for the board's first frame; some boards restart when their port is opened."""

    @property
    def volts_per_count(self) -> float:
        """Volts for one count of the converter."""
        return self.reference_v / float(2**self.resolution_bits)
