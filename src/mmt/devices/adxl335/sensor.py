"""Base class of the ADXL335 drivers, and their options: stored calibration, rest, faults."""

from collections.abc import Sequence
from math import pi
from statistics import fmean, pstdev
from typing import Final

from pydantic import ConfigDict, Field

from mmt.core.units import GRAVITY_M_S2
from mmt.devices.adxl335.gravity import GravityCalibration, Rest, Up, from_dict, nominal
from mmt.devices.axes import SensorAxesOptions
from mmt.devices.calibrations import load_calibration
from mmt.devices.reading_checks import LOG
from mmt.devices.sensor_drivers import AccelerometerDriver

_Z_HZ: Final = 550.0
"""Largest bandwidth of the sensor's own z axis; x and y reach 1600 Hz (data sheet)."""
LARGEST_BANDWIDTH_HZ: Final = 1600.0
BAND: Final = (
    f"the sensor itself ends at {LARGEST_BANDWIDTH_HZ:g} Hz along its X and Y, at {_Z_HZ:g} Hz "
    "along its Z"
)
_MICROFARAD_HZ: Final = 5.0
"""f = 5 uF / C: the filter of the sensor's 32 kOhm and the board's capacitor (data sheet)."""


class Adxl335Options(SensorAxesOptions):
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


RANGE_M_S2: Final = 3.0 * GRAVITY_M_S2
"""Guaranteed full scale (data sheet); a typical sensor reaches 3.6 g."""
TYPICAL_RANGE_M_S2: Final = 3.6 * GRAVITY_M_S2

CALIBRATED_AS: Final = "adxl335"
"""The kind of device under which calibrations are stored."""

_CALIBRATED_ERROR: Final = 0.05
_NOMINAL_ERROR: Final = 0.15
"""Largest error of gravity at rest, relative, with and without a stored calibration."""


class Adxl335(AccelerometerDriver):
    """A `SampledSensor`; a subclass reads the volts along the sensor's own axes.

    Parameters
    ----------
    options
        Validated options.
    """

    def __init__(self, options: Adxl335Options) -> None:
        super().__init__("the accelerometer", options.stuck_s)
        self._common = options
        self.latency_ns = options.filter_delay_ns
        """Delay of the board's filter."""
        self.calibration: GravityCalibration = nominal(options.supply_v)
        """Calibration in use: nominal until `connect` finds a stored one."""
        self._serial: str | None = None
        self._calibrated = False
        self._remarked = False

    @property
    def serial_number(self) -> str:
        """Serial number of the stored calibration, known after `connect`; empty if none."""
        return self._serial or ""

    @property
    def named(self) -> str | None:
        """Serial number of the options, or None to take the device's own."""
        return self._common.serial

    @property
    def supply_v(self) -> float:
        """Supply voltage of the sensor."""
        return self._common.supply_v

    @property
    def band_hz(self) -> float:
        """Highest frequency that the sensor passes, set by its board's capacitors."""
        return self._common.bandwidth_hz

    def remarks(self) -> Sequence[str]:
        """Return a sentence for each doubtful option, such as a capacitor that is too large."""
        return self._common.remarks()

    def measure_rest(self, up: Up, duration_s: float) -> Rest:
        """Measure for `duration_s` at rest; blocks up to 1 s longer if too few samples came.

        Raises
        ------
        MmtError
            Too few samples came.
        """
        volts = self._rest(lambda: ((x, y, z) for _, (x, y, z) in self.samples()), duration_s)
        x, y, z = zip(*volts, strict=True)
        return Rest(up, (fmean(x), fmean(y), fmean(z)), (pstdev(x), pstdev(y), pstdev(z)))

    def _doubt(self) -> tuple[float, str]:
        why = (
            f"the calibration stored for {self._serial} does not fit this sensor or its supply"
            if self._calibrated
            else "it is not calibrated, and the options for supply, reference and resolution may "
            "be wrong"
        )
        error = _CALIBRATED_ERROR if self._calibrated else _NOMINAL_ERROR
        return error, f"{why}, or it was moved. To calibrate it, run: mmt device calibrate"

    def _prepare(self, serial: str | None) -> None:
        """Load the stored calibration of the sensor that was just connected."""
        self._serial = self._common.serial or serial
        stored = load_calibration(CALIBRATED_AS, self._serial) if self._serial else None
        self._calibrated = stored is not None
        self.calibration = nominal(self.supply_v) if stored is None else from_dict(stored)
        a, b, c = self.calibration.gain_v_per_m_s2
        scale = (1.0 / a, 1.0 / b, 1.0 / c)
        self._set_axes(self._common.axes, scale, self.calibration.zero_v, [RANGE_M_S2] * 3)
        if not self._remarked:
            self._remarked = True
            for remark in self._common.remarks():
                LOG.warning("%s", remark)
