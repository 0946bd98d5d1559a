"""The leader's guards right before its devices: values are finite, and bounded in size and slew."""

import math
from typing import Final

from mmt.core.arrays import FloatArray, step_towards
from mmt.core.guards import ForceGuard, SampleGuard
from mmt.devices.protocols import Vector
from mmt.leader.motion.feedback import ForceDisplay

_FADE_TICKS: Final = 10
"""Ticks over which the vibration fades out, and in again."""


class GuardedDisplay:
    """Writes forces to a display, each finite, bounded and close to the one before.

    Parameters
    ----------
    display
        The operator's handle.
    limit_n
        Largest force, N.
    largest_step_n
        Largest change from one write to the next, in N; infinite for none.
    """

    def __init__(
        self, display: ForceDisplay, limit_n: float, largest_step_n: float = math.inf
    ) -> None:
        self._display = display
        self._largest_step_n = largest_step_n
        self._written: Vector = (0.0, 0.0, 0.0)
        self.guard: Final = ForceGuard(limit_n)
        """Bounds forces, and counts those that are not finite."""
        self.limited_writes = 0
        """Writes that would have changed the force by more than the largest step."""

    def write(self, force_n: Vector) -> None:
        """Display a force (N), or go towards it by the largest step."""
        wanted = self.guard.step(force_n)
        written = step_towards(self._written, wanted, self._largest_step_n)
        self.limited_writes += written is not wanted
        self._written = written
        self._display.write(written)


class VibrationSlew:
    """Makes a vibration finite, bounds it, fades it, and bounds its change from sample to sample.

    Parameters
    ----------
    limit_m_s2
        Largest magnitude, m/s2.
    largest_step_m_s2
        Largest change from one sample to the next, in m/s2; infinite for none.
    samples_per_tick
        Samples in a tick.
    """

    def __init__(
        self, limit_m_s2: float, largest_step_m_s2: float = math.inf, samples_per_tick: int = 1
    ) -> None:
        fade = _FADE_TICKS * samples_per_tick
        self._largest_step = largest_step_m_s2
        self._last = 0.0
        self._loudness = 1.0
        self._loudness_step = 1.0 / fade
        self.guard: Final = SampleGuard(limit_m_s2, fade)
        """Bounds samples, and counts those that are not finite."""
        self.limited_samples = 0
        """Samples that would have changed by more than the largest step."""

    def limit(self, vibration: FloatArray, *, silent: bool = False) -> None:
        """Bound the next samples (n,) in m/s2, in place; fade them out if `silent`."""
        last, step, guarded = self._last, self._largest_step, self.guard.step
        goal, fade = 0.0 if silent else 1.0, self._loudness_step
        for index, wanted in enumerate(vibration.tolist()):
            played = guarded(wanted)
            if silent or self._loudness < 1.0:
                self._loudness += min(max(goal - self._loudness, -fade), fade)
                played *= self._loudness
            if not -step <= played - last <= step:
                self.limited_samples += 1
                played = last + math.copysign(step, played - last)
            if played != wanted:
                vibration[index] = played
            last = played
        self._last = last
