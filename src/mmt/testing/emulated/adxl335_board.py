"""An emulated ADXL335 behind a microcontroller, on a pseudo-terminal for its driver."""

import math
import random
from typing import TYPE_CHECKING, Any, Final

from mmt.core.units import GRAVITY_M_S2
from mmt.devices.adxl335.framing import BoardFrame, Counts, encode_frame
from mmt.devices.adxl335.gravity import GravityCalibration, nominal
from mmt.devices.adxl335.sensor import LARGEST_BANDWIDTH_HZ, TYPICAL_RANGE_M_S2
from mmt.testing.emulated import Clockwork, FaultySending, Truth
from mmt.testing.emulated.serial_port import EmulatedSerialDevice

if TYPE_CHECKING:
    from mmt.testing.emulated.lab import World

NOISE_DENSITY: Final = 150e-6 * GRAVITY_M_S2
"""m/s2 per root hertz (data sheet, X and Y)."""


class EmulatedAdxl335Board(EmulatedSerialDevice, FaultySending):
    """A board that sends frames until it is stopped; while it is unplugged, it goes on counting.

    The sensor clips at 3.6 g along each axis. The board's filter delays the acceleration by
    1 / (2 pi f), the delay well below its corner, and attenuates nothing. Through a pseudo-terminal
    bytes arrive at once, whatever the baud rate.

    Parameters
    ----------
    truth
        Proper acceleration (m/s2) along the sensor's own axes at a monotonic time (ns).
    rate_hz, per_frame
        Samples a second, and how many of them make a frame.
    supply_v, resolution_bits
        Supply of the sensor, which is also the reference of the converter, and resolution of
        the converter.
    calibration
        True calibration of the sensor; None for the data sheet's values.
    bandwidth_hz
        Bandwidth of the board's filters.
    clock_ppm, start_us
        How much too fast the board's clock runs, and its time at the start.
    noise_density
        Noise density of the sensor, m/s2 per root hertz.
    seed
        Seed of the noise and the garbage.
    """

    _listens = False

    def __init__(
        self,
        truth: Truth,
        *,
        rate_hz: float = 1000.0,
        per_frame: int = 1,
        supply_v: float = 3.3,
        resolution_bits: int = 12,
        calibration: GravityCalibration | None = None,
        bandwidth_hz: float = 500.0,
        clock_ppm: float = 0.0,
        start_us: int = 0,
        noise_density: float = NOISE_DENSITY,
        seed: int = 0,
    ) -> None:
        super().__init__(math.ceil(1e9 * per_frame / rate_hz))
        self.truth = truth
        self._rate_hz = rate_hz
        self._per_frame = per_frame
        self._top = (1 << resolution_bits) - 1
        self._volts_per_count = supply_v / 2**resolution_bits
        self._calibration = nominal(supply_v) if calibration is None else calibration
        self._bandwidth_hz = bandwidth_hz
        self._delay_ns = round(1e9 / (math.tau * bandwidth_hz))
        self._noise = noise_density * (1.57 * bandwidth_hz) ** 0.5
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._start_us = start_us
        self._random = random.Random(seed)  # noqa: S311 - noise, no secret
        self._samples: list[Counts] = []
        self._sequence = 0
        self._begun_ns = 0
        self._begins = True
        self._counts: Counts | None = None
        self._scrambled = False

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds it."""
        return {"port": self.path, "bandwidth_hz": self._bandwidth_hz}

    def restart(self) -> None:
        """Count samples and time from the beginning, as after the reset button."""
        self._start_us = 0
        self._begins = True

    def scramble(self, *, scrambled: bool = True) -> None:
        """Send random bytes, as after a wrong baud rate, or go on."""
        self._scrambled = scrambled

    def _step(self, due_ns: int, _received: bytes) -> None:
        if self._begins:
            self._begins = False
            self._sequence, self._begun_ns = 0, due_ns
            self._samples.clear()
        due = round((due_ns - self._begun_ns) * 1e-9 * self._rate_hz)
        while self._sequence < due:
            self._sample()

    def _sample(self) -> None:
        self._sequence += 1
        elapsed_ns = round(self._sequence / self._rate_hz * 1e9)
        if self._counts is None or not self.stuck:
            self._counts = self._convert(self._begun_ns + elapsed_ns)
        self._samples.append(self._counts)
        if len(self._samples) < self._per_frame:
            return
        time_us = self._start_us + round(elapsed_ns * self._speed / 1000.0)
        frame = BoardFrame(self._sequence & 0xFFFFFFFF, time_us & 0xFFFFFFFF, tuple(self._samples))
        self._samples.clear()
        wire = encode_frame(frame)
        self.write(self._random.randbytes(len(wire)) if self._scrambled else self._spoil(wire))

    def _convert(self, time_ns: int) -> Counts:
        felt = self.truth(time_ns - self._delay_ns)
        zero, gain = self._calibration.zero_v, self._calibration.gain_v_per_m_s2
        noisy = (each + self._random.gauss(0.0, self._noise) for each in felt)
        most = TYPICAL_RANGE_M_S2
        x, y, z = (
            self._count(zero[i] + gain[i] * min(max(each, -most), most))
            for i, each in enumerate(noisy)
        )
        return x, y, z

    def _count(self, volts: float) -> int:
        return min(max(int(volts / self._volts_per_count), 0), self._top)


def in_lab(world: "World", seed: int, _clockwork: Clockwork) -> EmulatedAdxl335Board:
    """Return the accelerometer of the virtual lab, which sends a frame each half millisecond."""
    samples = world.samples_per_frame
    return EmulatedAdxl335Board(
        world.acceleration_m_s2,
        rate_hz=2000.0 * samples,
        per_frame=samples,
        bandwidth_hz=min(1000.0 * samples, LARGEST_BANDWIDTH_HZ),
        clock_ppm=-70.0,
        seed=seed,
    )
