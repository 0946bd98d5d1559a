"""Guards right before a device, after all arithmetic: its input is finite and bounded.

A value that is not finite is neither used nor kept. Instead, the last finite value fades to
zero, and the next finite values fade in, so that the output has no steps.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, Vector, bounded, clipped

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
