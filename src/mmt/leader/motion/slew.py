"""The last bound before the devices: how fast a force and a vibration may change."""

from mmt.core.arrays import FloatArray, towards
from mmt.devices.protocols import Vector
from mmt.leader.motion.feedback import ForceDisplay


class SlewLimitedDisplay:
    """Writes forces to a display, each near the one before, whatever is asked for.

    Parameters
    ----------
    display
        The operator's handle.
    largest_step_n
        Largest change from one write to the next, in N.
    """

    def __init__(self, display: ForceDisplay, largest_step_n: float) -> None:
        self._display = display
        self._largest_step_n = largest_step_n
        self._written: Vector = (0.0, 0.0, 0.0)
        self.limited_writes = 0
        """Writes that were asked to change the force by more."""

    def write(self, force_n: Vector) -> None:
        """Display a force (N), or go towards it by the largest step."""
        written = towards(self._written, force_n, self._largest_step_n)
        self.limited_writes += written is not force_n
        self._written = written
        self._display.write(written)


class VibrationSlew:
    """Bounds the change of a vibration from sample to sample.

    Parameters
    ----------
    largest_step_m_s2
        Largest change from one sample to the next, in m/s2.
    """

    def __init__(self, largest_step_m_s2: float) -> None:
        self._largest_step = largest_step_m_s2
        self._last = 0.0
        self.limited_samples = 0
        """Samples that were to change by more."""

    def limit(self, vibration: FloatArray) -> None:
        """Bound the next samples (n,) in m/s2, in place."""
        last, step = self._last, self._largest_step
        for index, wanted in enumerate(vibration.tolist()):
            if -step <= wanted - last <= step:
                last = wanted
                continue
            self.limited_samples += 1
            last += step if wanted > last else -step
            vibration[index] = last
        self._last = last
