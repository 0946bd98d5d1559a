"""A handle with an actuator and an accelerometer on it, emulated in a process of its own.

The samples of the actuator's board shake the handle, and the accelerometer's board measures this
motion. See `mmt.testing.emulated.lab_process`.
"""

import math
import sys
import threading
import time
from collections import deque
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.haptuator.framing import FULL_SCALE
from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard
from mmt.testing.emulated.lab_process import LabDevice, run_lab

FULL_SCALE_V: Final = 3.0
LEVEL_M_S2_PER_V: Final = 15.0
"""Above the resonance."""
RESONANCE_HZ: Final = 150.0
DAMPING_RATIO: Final = 0.2
DIRECTION: Final[Vector] = (0.6, 0.0, 0.8)
"""Direction in which the handle is shaken, in the accelerometer's axes."""

_RATE_HZ: Final = 8000
_ACCELEROMETER_HZ: Final = 2000.0
_BANDWIDTH_HZ: Final = 1000.0
_BEHIND: Final = 240
"""Delay of the acceleration in samples, so that the sample after an instant is known too."""
_KEPT: Final = 4096


class ShakenHandle:
    """A voice coil's mass on a spring, which turns voltage into acceleration with a resonance."""

    def __init__(self) -> None:
        rate = math.tau * RESONANCE_HZ
        self._damping, self._stiffness = 2.0 * DAMPING_RATIO * rate, rate * rate
        self._place = self._speed = 0.0
        self._origin_ns: int | None = None
        self._newest = -1
        self._accelerations: deque[float] = deque([0.0] * _KEPT, maxlen=_KEPT)
        self._lock = threading.Lock()

    def play(self, value: int) -> None:
        """Take the next sample of the actuator's board, full scale is 32767."""
        volts = value * FULL_SCALE_V / FULL_SCALE
        acceleration = volts - self._damping * self._speed - self._stiffness * self._place
        self._speed += acceleration / _RATE_HZ
        self._place += self._speed / _RATE_HZ
        with self._lock:
            if self._origin_ns is None:
                self._origin_ns = time.monotonic_ns()
            self._newest += 1
            self._accelerations.append(LEVEL_M_S2_PER_V * acceleration)

    def acceleration_m_s2(self, time_ns: int) -> Vector:
        """Return the proper acceleration of the handle at a monotonic time; gravity is along z."""
        with self._lock:
            shaken = self._at(time_ns)
        x, y, z = DIRECTION
        return (x * shaken, y * shaken, z * shaken + GRAVITY_M_S2)

    def _at(self, time_ns: int) -> float:
        if self._origin_ns is None:
            return 0.0
        place = (time_ns - self._origin_ns) * 1e-9 * _RATE_HZ - _BEHIND
        place = min(max(place - self._newest + _KEPT - 1, 0.0), _KEPT - 2.0)
        first = int(place)
        share = place - first
        before, after = self._accelerations[first], self._accelerations[first + 1]
        return before + share * (after - before)


class _Actuator(EmulatedHaptuatorBoard):
    @property
    def options(self) -> dict[str, Any]:
        return {"port": self.path, "full_scale_v": FULL_SCALE_V}


def main(seed: int) -> None:
    """Run the handle until standard input ends."""
    handle = ShakenHandle()
    accelerometer = EmulatedAdxl335Board(
        handle.acceleration_m_s2,
        rate_hz=_ACCELEROMETER_HZ,
        bandwidth_hz=_BANDWIDTH_HZ,
        clock_ppm=-70.0,
        seed=seed,
    )
    devices: dict[str, LabDevice] = {
        "haptuator": _Actuator(_RATE_HZ, listener=handle.play),
        "adxl335": accelerometer,
    }
    run_lab(devices.__getitem__)


if __name__ == "__main__":
    main(int(sys.argv[1]))
