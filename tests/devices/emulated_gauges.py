"""A Nano17's gauges on an acquisition board, in software."""

import random
import time

import numpy as np

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import VoltageReading


class EmulatedGauges:
    """A `VoltageBoard` that feels forces, with faults on demand.

    Parameters
    ----------
    truth
        The force at a time: N at ns of the host's monotonic clock.
    matrix
        The sensor's, from volts to N and N mm.
    rate_hz
        Samples a second.
    clock_ppm
        How much too fast the board's clock runs.
    offset_v
        What each gauge gives without a force.
    noise_v
        Standard deviation of an input.
    limit_v
        Largest magnitude that it measures.
    seed
        Of the noise.
    """

    inputs = 6

    def __init__(
        self,
        truth,
        matrix,
        *,
        rate_hz=1000.0,
        clock_ppm=0.0,
        offset_v=0.2,
        noise_v=1e-4,
        limit_v=10.0,
        seed=1,
    ):
        self.latency_ns = 0
        self.limit_v = limit_v
        self.stuck = False
        self.faults = {}
        self.truth = truth
        self._to_volts = np.linalg.inv(np.array(matrix))[:, :3].tolist()
        self._period_ns = 1e9 / rate_hz
        self._rate = rate_hz * (1.0 + 1e-6 * clock_ppm) * 1e-9
        self._offset_v = offset_v
        self._noise_v = noise_v
        self._random = random.Random(seed)
        self.began_ns = time.monotonic_ns()
        self._sent = 0
        self._plugged = True
        self._silent = False
        self._volts = (0.0,) * 6

    def unplug(self):
        """Answer nothing any more."""
        self._plugged = False

    def plug(self):
        """Be there again."""
        self._plugged = True

    def stall(self, *, silent=True):
        """Give nothing, or go on."""
        self._silent = silent

    def connect(self):
        """Begin to sample.

        Raises
        ------
        MmtError
            It is unplugged.
        """
        if not self._plugged:
            raise MmtError("the board does not answer; plug it in")
        self._sent = self._due()

    def read(self):
        """Return what has been sampled since the last call.

        Raises
        ------
        DeviceLost
            It is unplugged.
        """
        if not self._plugged:
            raise DeviceLost("the board does not answer any more; check its cable")
        first, self._sent = self._sent, self._due()
        if self._silent:
            return ()
        return [self._sample(number) for number in range(first + 1, self._sent + 1)]

    def close(self):
        """Nothing is held."""

    def _due(self):
        return int((time.monotonic_ns() - self.began_ns) * self._rate)

    def _sample(self, number):
        if not self.stuck:
            x, y, z = self.truth(self.began_ns + round(number / self._rate))
            noise, limit = self._random.gauss, self.limit_v
            self._volts = tuple(
                max(
                    min(a * x + b * y + c * z + noise(self._offset_v, self._noise_v), limit), -limit
                )
                for a, b, c in self._to_volts
            )
        return VoltageReading(round(number * self._period_ns), self._volts)
