"""Guards right before a device, after all arithmetic: values are finite, bounded, without jumps.

A value that is not finite is neither used nor kept. Instead, the last finite value fades to
zero, and the next finite values fade in, so that the output has no steps.
"""

import math
from typing import Final, Protocol

import numpy as np

from mmt.core.arrays import FloatArray, Vector, bounded, clipped, step_towards

_FADE: Final = 10
"""Values over which the output fades out while values are not finite, and in again after."""
_NOUGHT: Final[Vector] = (0.0, 0.0, 0.0)


class _Share:
    """Gain of the newest finite value.

    Parameters
    ----------
    fade
        Values over which the gain goes from 1 to 0, and back.
    """

    def __init__(self, fade: int) -> None:
        self._change = 1.0 / fade
        self._share = 1.0
        self.not_finite = 0
        """Values that were no finite numbers."""

    def _step(self, *, finite: bool) -> float:
        self.not_finite += not finite
        if not finite:
            self._share = max(self._share - self._change, 0.0)
        elif self._share < 1.0:
            self._share = min(self._share + self._change, 1.0)
        return self._share


class SampleGuard(_Share):
    """Guard right before a device that plays samples.

    Parameters
    ----------
    limit
        Largest magnitude of a sample.
    fade
        Samples over which the signal fades out if it is not finite, and in again.
    """

    def __init__(self, limit: float, fade: int = _FADE) -> None:
        super().__init__(fade)
        self._limit = limit
        self._last = 0.0
        self.limited = 0
        """Samples beyond the limit, played at the limit."""

    def apply(self, samples: FloatArray) -> None:
        """Bound the next samples (n,), in place."""
        if not len(samples):
            return
        if self._share == 1.0 and np.abs(samples).max() <= self._limit:  # false for NaN
            self._last = float(samples[-1])
            return
        samples[:] = [self.step(wanted) for wanted in samples.tolist()]

    def step(self, wanted: float) -> float:
        """Return the value to play for the next sample."""
        if -self._limit <= wanted <= self._limit:
            self._last = wanted
        elif math.isfinite(wanted):
            self._last = math.copysign(self._limit, wanted)
            self.limited += 1
        else:
            return self._step(finite=False) * self._last
        return self._last if self._share == 1.0 else self._step(finite=True) * self._last


class ForceGuard(_Share):
    """Guard right before a device that displays a force.

    Parameters
    ----------
    limit_n
        Largest force (N), along any direction.
    axes_n
        Largest force along each axis by itself; None for no further bound.
    """

    def __init__(self, limit_n: float, axes_n: Vector | None = None) -> None:
        super().__init__(_FADE)
        self._limit_n = limit_n
        self._axes_n = axes_n
        self._last = _NOUGHT

    def step(self, force_n: Vector, faded: float = 1.0) -> Vector:
        """Return the force to display (N): bounded, times the gain `faded` and the guard's."""
        x, y, z = force_n
        finite = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
        if finite:
            if self._axes_n is not None:
                a, b, c = self._axes_n
                force_n = clipped(force_n, (-a, -b, -c), (a, b, c))
            self._last = bounded(force_n, self._limit_n)
        x, y, z = self._last
        share = faded * self._step(finite=finite)
        return (share * x, share * y, share * z)


SILENCE_TICKS: Final = 50
"""Longest silence that counts as the network's jitter."""
RAMP_TICKS: Final = 50
"""Length of a ramp out or in: if no tick is missed, the force is zero after 100 ms of silence."""
FADE_TICKS: Final = SILENCE_TICKS + RAMP_TICKS
"""Ticks from the last force of a source until no force is displayed."""
_VIBRATION_TICKS: Final = 10
"""Ticks over which the vibration fades out, and in again."""


class ForceRamp:
    """Shape a force by the time since its source last gave one.

    After `silence_ticks` without `renew` the force goes linearly to zero over `ramp_ticks`.
    When the source returns, the output goes linearly from the displayed force to the
    source's force over `ramp_ticks`, however far the ramp out had gone.

    Missed ticks count for the silence. A ramp advances by one tick at each call of `shape`, that
    is, with each force written, so that a late call makes no step.

    Parameters
    ----------
    silence_ticks, ramp_ticks
        Both at least 1.
    """

    def __init__(self, silence_ticks: int = SILENCE_TICKS, ramp_ticks: int = RAMP_TICKS) -> None:
        self._silence_ticks = silence_ticks
        self._ramp_ticks = ramp_ticks
        self._age_ticks = 0
        self._shown = self._start = _NOUGHT
        self._share = 1.0  # of the source's force; the rest is that of the ramp's start
        self._left = 1.0  # of the force in a silence

    @property
    def silent(self) -> bool:
        """Whether the source has been silent for too long."""
        return self._age_ticks > self._silence_ticks

    def fall_silent(self) -> None:
        """Note that the source gives no force any more, without waiting for `silence_ticks`."""
        self._age_ticks = max(self._age_ticks, self._silence_ticks + 1)

    def renew(self) -> None:
        """Note that the source has given a new force."""
        if self.silent:
            self._start = self._shown
            self._share = 0.0
            self._left = 1.0
        self._age_ticks = 0

    def pause(self, elapsed: int) -> None:
        """Note that nothing is displayed for these ticks; the force then returns from zero."""
        self._age_ticks += elapsed
        self._shown = self._start = _NOUGHT
        self._share = 0.0

    def shape(self, force_n: Vector, elapsed: int) -> Vector:
        """Return the force (N) to display now, `elapsed` ticks after the last call."""
        self._age_ticks += elapsed
        step = 1.0 / self._ramp_ticks
        if self.silent:  # an unfinished ramp in waits: both at once would be too fast
            self._left = max(0.0, self._left - step)
        else:
            self._share = min(1.0, self._share + step)
        share, left = self._left * self._share, self._left * (1.0 - self._share)
        x, y, z = force_n
        u, v, w = self._start
        self._shown = (share * x + left * u, share * y + left * v, share * z + left * w)
        return self._shown


class ForceDisplay(Protocol):
    """A device that displays a force to the hand, such as every `LeaderInterface`."""

    def write(self, force_n: Vector) -> None:
        """Display a force (N)."""


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
        self._written = _NOUGHT
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
        fade = _VIBRATION_TICKS * samples_per_tick
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
