"""Interpolation by a short windowed sinc, for a card that is faster than the session.

An instant takes six samples around it. It can be computed once the third sample after it has come:
the delay is three samples. The taps of an instant sum to 1. They are interpolated linearly between
64 tabulated instants, which leaves an error under 1e-3 of the signal.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray

TAPS: Final = 6
BEFORE: Final = TAPS // 2 - 1
"""Samples needed before the one at or just before an instant."""
AFTER: Final = TAPS // 2
"""Samples needed after that one."""

_PHASES: Final = 64
_KAISER_BETA: Final = 3.0
"""Flat within 0.2 dB to 0.3 of the rate; 1.4 dB are lost at 0.4 of it."""


def tap_table() -> FloatArray:
    """Return the taps at each tabulated fraction of a sample, shape (65, 6), ends included."""
    fractions = np.arange(_PHASES + 1)[:, np.newaxis] / _PHASES
    offsets = np.arange(-BEFORE, AFTER + 1)[np.newaxis, :] - fractions
    within = np.sqrt(np.clip(1.0 - (offsets / AFTER) ** 2, 0.0, 1.0))
    taps = np.sinc(offsets) * np.i0(_KAISER_BETA * within)
    normalised: FloatArray = taps / taps.sum(axis=1, keepdims=True)
    return normalised


class SampleRing:
    """Keeps the newest samples, and interpolates the signal between them.

    Parameters
    ----------
    bits
        The ring holds ``2**bits`` samples; older ones are overwritten.
    """

    def __init__(self, bits: int) -> None:
        self._mask = (1 << bits) - 1
        self._ring = np.zeros(1 << bits)
        self.written = 0
        """Samples written so far; changed only after the samples are stored."""
        self._table = tap_table()
        self._slopes = np.diff(self._table, axis=0)
        self._offsets = np.arange(-BEFORE, AFTER + 1)

    def write(self, samples: Iterable[float]) -> None:
        """Append samples."""
        ring, written, mask = self._ring, self.written, self._mask
        for sample in samples:
            ring[written & mask] = sample
            written += 1
        self.written = written

    def read(self, position: float, step: float, count: int) -> FloatArray:
        """Return the signal at `count` instants, the first at `position`, shape (count,).

        Parameters
        ----------
        position
            In samples, at least `BEFORE`; the sample `AFTER` the last instant must be there.
        step
            Distance between instants, in samples.
        """
        instants = position + step * np.arange(count)
        whole = np.floor(instants).astype(np.int64)
        phases = (instants - whole) * _PHASES
        rows = np.minimum(phases.astype(np.int64), _PHASES - 1)
        taps = self._table[rows] + self._slopes[rows] * (phases - rows)[:, np.newaxis]
        samples = self._ring[(whole[:, np.newaxis] + self._offsets) & self._mask]
        values: FloatArray = np.einsum("ij,ij->i", samples, taps)
        return values


_TIME_CONSTANT_S: Final = 2.0
_LARGEST_CORRECTION: Final = 5e-3
_LARGEST_DRIFT: Final = 3e-3


class FillController:
    """A proportional-integral controller, critically damped with a time constant of 2 s.

    Parameters
    ----------
    rate_hz
        Sampling rate of the buffer.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self.drift = 0.0
        """Learnt share by which the writing clock is faster than the reading one."""

    def correction(self, error: float, passed_s: float) -> float:
        """Return the share by which to read faster, within 0.5 %, and learn the drift.

        Parameters
        ----------
        error
            Samples in the buffer beyond the wanted number.
        passed_s
            Time since the last call.
        """
        natural = 1.0 / _TIME_CONSTANT_S
        drift = self.drift + natural * natural / self._rate_hz * error * passed_s
        self.drift = min(max(drift, -_LARGEST_DRIFT), _LARGEST_DRIFT)
        correction = self.drift + 2.0 * natural / self._rate_hz * error
        return min(max(correction, -_LARGEST_CORRECTION), _LARGEST_CORRECTION)
