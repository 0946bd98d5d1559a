"""A Nano17's gauges on an acquisition board, in software."""

import random
import time

import numpy as np

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import VoltageReading

PERIOD_NS = 1_000_000


class EmulatedGauges:
    """A `VoltageBoard` that feels forces, with faults on demand.

    Parameters
    ----------
    truth
        The force at a time: N at ns of the host's monotonic clock.
    matrix
        The sensor's, from volts to N and N mm.
    """

    inputs = 6
    latency_ns = 0
    limit_v = 10.0

    def __init__(self, truth, matrix):
        self.stuck = False
        self.faults = {}
        self.truth = truth
        self._to_volts = np.linalg.inv(matrix)[:, :3].tolist()
        self._random = random.Random(1)
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
        return (time.monotonic_ns() - self.began_ns) // PERIOD_NS

    def _sample(self, number):
        if not self.stuck:
            x, y, z = self.truth(self.began_ns + number * PERIOD_NS)
            noise, limit = self._random.gauss, self.limit_v
            self._volts = tuple(
                max(min(a * x + b * y + c * z + noise(0.2, 1e-4), limit), -limit)
                for a, b, c in self._to_volts
            )
        return VoltageReading(number * PERIOD_NS, self._volts)
