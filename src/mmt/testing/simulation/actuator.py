"""A vibrotactile actuator without hardware: it limits and counts."""

import math
from collections.abc import Sequence

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.guards import SampleGuard
from mmt.devices.leader_reports import ActuatorStatistics


class SimulatedActuator:
    """Stands in for a Haptuator; implements `VibrationActuator`.

    Samples beyond the limit are played at the limit and counted, as an amplifier clips;
    values that are not finite fade out and count as clipped. Only sums are kept: memory does not
    grow. Cost: about 0.3 us a sample.

    Parameters
    ----------
    limit_m_s2
        Largest magnitude that the actuator can play.

    Raises
    ------
    InputError
        The limit is not above 0.
    """

    def __init__(self, *, limit_m_s2: float) -> None:
        if not (math.isfinite(limit_m_s2) and limit_m_s2 > 0.0):
            raise InputError(f"limit_m_s2 is {limit_m_s2}, it must be above 0")
        self._limit = limit_m_s2
        self._guard = SampleGuard(limit_m_s2)
        self._samples = 0
        self._sum_squares = 0.0
        self._peak = 0.0

    def connect(self) -> None:
        """Reset the statistics."""
        self._guard = SampleGuard(self._limit)
        self._samples = 0
        self._sum_squares = self._peak = 0.0

    def calibrate(self) -> None:
        """Do nothing: the simulated actuator has a flat response."""

    def close(self) -> None:
        """Do nothing: there is no device; the statistics stay readable."""

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2."""
        values = samples_m_s2 if isinstance(samples_m_s2, Sequence) else samples_m_s2.tolist()
        for value in values:
            if math.isfinite(value):
                self._peak = max(self._peak, abs(value))
            played = self._guard.step(value)
            self._sum_squares += played * played
        self._samples += len(values)

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels since `connect`."""
        rms = math.sqrt(self._sum_squares / self._samples) if self._samples else 0.0
        clipped = self._guard.limited + self._guard.not_finite
        return ActuatorStatistics(self._samples, clipped, rms, self._peak)
