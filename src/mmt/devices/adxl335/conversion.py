"""From an ADXL335's volts to m/s2 along the scene's axes, and what shows that they are none."""

from collections import Counter
from typing import Final

from mmt.core.errors import DeviceLost
from mmt.devices.adxl335.gravity import GRAVITY_M_S2, Calibration
from mmt.devices.adxl335.options import Adxl335Options
from mmt.devices.overload import OverloadNotice
from mmt.devices.protocols import SensorReading, Vector

RANGE_M_S2: Final = 3.0 * GRAVITY_M_S2
"""Least full scale by the data sheet; a sensor that is typical goes to 3.6 g."""
TYPICAL_RANGE_M_S2: Final = 3.6 * GRAVITY_M_S2

_OVERLOADED: Final = (
    f"the accelerometer is overloaded: beyond {RANGE_M_S2 / GRAVITY_M_S2:g} g along an axis it may "
    "cut off what it feels; touch the surface and move more gently"
)


class Converter:
    """Convert one sensor's samples, in the order in which they were taken.

    Parameters
    ----------
    calibration
        Zero and gain of each of the sensor's own axes.
    options
        Which axis lies where, and from when a value is stuck.
    stuck_at
        The volts at which the sensor was stuck before, None where it was not.
    """

    def __init__(
        self, calibration: Calibration, options: Adxl335Options, stuck_at: Vector | None = None
    ) -> None:
        self.faults: Counter[str] = Counter()
        """``overload``: samples beyond 3 g along an axis."""
        self._notice = OverloadNotice()
        zero, gain = calibration.zero_v, calibration.gain_v_per_m_s2
        axes = [("xyz".index(a[-1]), -1.0 if a[0] == "-" else 1.0) for a in options.axes]
        self._axes = tuple((i, sign / gain[i], sign * zero[i] / gain[i]) for i, sign in axes)
        self._stuck_ns = round(1e9 * options.stuck_s)
        self.stuck_at = stuck_at
        """The volts that have stayed the same for too long, None where they change."""
        self._last = stuck_at
        self._since_ns = 0

    def convert(self, time_ns: int, volts: Vector) -> SensorReading:
        """Return the acceleration at that time.

        Raises
        ------
        DeviceLost
            The volts have not changed by the least bit for too long.
        """
        if volts != self._last:
            self._last, self._since_ns, self.stuck_at = volts, time_ns, None
        elif self.stuck_at is not None or time_ns - self._since_ns >= self._stuck_ns:
            self.stuck_at = volts
            raise DeviceLost(
                f"the accelerometer's value has not changed for {1e-9 * self._stuck_ns:g} s "
                "or more, and even at rest it is never quite still: check the sensor's supply and "
                "the wires to the converter"
            )
        (i, a, p), (j, b, q), (k, c, r) = self._axes
        value = (a * volts[i] - p, b * volts[j] - q, c * volts[k] - r)
        if max(value) > RANGE_M_S2 or min(value) < -RANGE_M_S2:
            self.faults["overload"] += 1
            self._notice.tell(_OVERLOADED)
        return SensorReading(time_ns, value)
