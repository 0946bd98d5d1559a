"""Base class of the ADXL335 drivers, and their options: stored calibration, rest, faults."""

import logging
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import hypot, pi
from statistics import fmean, pstdev
from typing import Final

from pydantic import ConfigDict, Field

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.adxl335.gravity import (
    GravityCalibration,
    Rest,
    Up,
    from_dict,
    nominal,
)
from mmt.devices.axes import SensorAxesOptions, signed_axes
from mmt.devices.calibrations import load_calibration
from mmt.devices.protocols import SensorReading
from mmt.devices.reading_checks import RareWarning, StuckCheck, measured

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

_OVERLOADED: Final = (
    f"the accelerometer is overloaded: beyond {RANGE_M_S2 / GRAVITY_M_S2:g} g along an axis it may "
    "cut off what it feels; touch the surface and move more gently"
)


LOG: Final = logging.getLogger("mmt.devices")

CALIBRATED_AS: Final = "adxl335"
"""The kind of device under which calibrations are stored."""

_REST_S: Final = 0.2
_LEAST_SAMPLES: Final = 20
_LONGEST_PAUSE_S: Final = 1.0  # a busy machine may read samples late
_CALIBRATED_ERROR: Final = 0.05
_NOMINAL_ERROR: Final = 0.15
"""Largest error of gravity at rest, relative, with and without a stored calibration."""


class Adxl335(ABC):
    """A `SampledSensor`; a subclass reads the volts.

    Parameters
    ----------
    options
        Validated options.
    """

    def __init__(self, options: Adxl335Options) -> None:
        self._common = options
        self.latency_ns = options.filter_delay_ns
        """Delay of the board's filter."""
        self.calibration: GravityCalibration = nominal(options.supply_v)
        """Calibration in use: nominal until `connect` finds a stored one."""
        self._serial: str | None = None
        self._calibrated = False
        self._axes: list[tuple[int, float, float]] = []
        """For x, y, z of the scene: the sensor's axis, its scale, and its value at zero volts."""
        self._faults: Counter[str] = Counter()
        self._notice = RareWarning()
        self._stuck = StuckCheck(1e9 * options.stuck_s)
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

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""
        return {kind: count for kind, count in dict(self._faults).items() if count}

    def remarks(self) -> Sequence[str]:
        """Return a sentence for each doubtful option, such as a capacitor that is too large."""
        return self._common.remarks()

    def read(self) -> Sequence[SensorReading]:
        """Return the new readings, in m/s2 along the scene's axes.

        Raises
        ------
        DeviceLost
            The sensor was unplugged, or its value is stuck.
        """
        convert, stuck = self._convert, self._stuck
        readings = []
        for time_ns, volts in self.voltages():
            if stuck.add(volts, time_ns):
                raise DeviceLost(
                    f"the accelerometer's value has not changed for {self._common.stuck_s:g} s "
                    "or more, and even at rest it is never quite still: check the sensor's supply "
                    "and the wires to the converter"
                )
            readings.append(convert(time_ns, volts))
        return readings

    @abstractmethod
    def connect(self) -> None:
        """Open the device; see `mmt.devices.protocols.Device`."""

    @abstractmethod
    def voltages(self) -> Iterable[tuple[int, Vector]]:
        """Return the new samples as (time_ns, volts along the sensor's own axes)."""

    @abstractmethod
    def close(self) -> None:
        """Release the device; calling it twice is harmless."""

    def calibrate(self) -> None:
        """Compare the value at rest with gravity, and warn if they differ.

        No bias is subtracted: an accelerometer measures gravity too, and modelling and rendering
        leave out constant parts.
        """
        rest = self.measure_rest("+z", _REST_S)
        used = self.calibration
        felt = hypot(
            *((rest.mean_v[i] - used.zero_v[i]) / used.gain_v_per_m_s2[i] for i in range(3))
        )
        bound = _CALIBRATED_ERROR if self._calibrated else _NOMINAL_ERROR
        if not abs(felt / GRAVITY_M_S2 - 1.0) <= bound:
            why = (
                f"the calibration stored for {self._serial} does not fit this sensor or its supply"
                if self._calibrated
                else "it is not calibrated, and the options for supply, reference and resolution "
                "may be wrong"
            )
            LOG.warning(
                "the accelerometer measures %.2f m/s2 at rest, gravity is %.2f: %s, or it was "
                "moved. To calibrate it, run: mmt device calibrate",
                felt,
                GRAVITY_M_S2,
                why,
            )

    def measure_rest(self, up: Up, duration_s: float) -> Rest:
        """Measure for `duration_s` at rest; blocks up to 1 s longer if too few samples came.

        Raises
        ------
        MmtError
            Too few samples came.
        """
        volts: list[Vector] = []
        list(self.voltages())  # discard older samples
        end = time.monotonic() + duration_s
        while (now := time.monotonic()) < end or (
            len(volts) < _LEAST_SAMPLES and now < end + _LONGEST_PAUSE_S
        ):
            volts.extend(v for _, v in self.voltages() if measured(v) is not None)
            time.sleep(0.005)
        if len(volts) < _LEAST_SAMPLES:
            raise MmtError(
                f"the accelerometer gave {len(volts)} samples in {duration_s:g} s, too few; check "
                "its cable and its rate"
            )
        x, y, z = zip(*volts, strict=True)
        return Rest(up, (fmean(x), fmean(y), fmean(z)), (pstdev(x), pstdev(y), pstdev(z)))

    def _convert(self, time_ns: int, volts: Vector) -> SensorReading:
        """Return the acceleration for the volts of one sample."""
        (i, a, p), (j, b, q), (k, c, r) = self._axes
        value = (a * volts[i] - p, b * volts[j] - q, c * volts[k] - r)
        if max(value) > RANGE_M_S2 or min(value) < -RANGE_M_S2:
            self._faults["overload"] += 1
            self._notice.warn(_OVERLOADED)
        return SensorReading(time_ns, value)

    def _prepare(self, serial: str | None) -> None:
        """Load the stored calibration of the sensor that was just connected."""
        self._serial = self._common.serial or serial
        stored = load_calibration(CALIBRATED_AS, self._serial) if self._serial else None
        self._calibrated = stored is not None
        self.calibration = nominal(self.supply_v) if stored is None else from_dict(stored)
        zero, gain = self.calibration.zero_v, self.calibration.gain_v_per_m_s2
        self._axes = [
            (i, sign / gain[i], sign * zero[i] / gain[i])
            for i, sign in signed_axes(self._common.axes)
        ]
        if not self._remarked:
            self._remarked = True
            for remark in self._common.remarks():
                LOG.warning("%s", remark)
