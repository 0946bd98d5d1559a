"""Follow a clock by how full the buffer between it and another is."""

from typing import Final

_TIME_CONSTANT_S: Final = 2.0
_LARGEST_CORRECTION: Final = 5e-3
_LARGEST_DRIFT: Final = 3e-3


class FillFollower:
    """A proportional-integral controller, critically damped with a time constant of 2 s.

    Parameters
    ----------
    rate_hz
        Of the samples in the buffer.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self.drift = 0.0
        """By what share the writing clock is ahead of the reading one, as learnt."""

    def correction(self, error: float, passed_s: float) -> float:
        """Return by what share to read faster, within 0.5 %, and learn the drift.

        Parameters
        ----------
        error
            Samples in the buffer beyond those that are wanted.
        passed_s
            Since the last call.
        """
        natural = 1.0 / _TIME_CONSTANT_S
        drift = self.drift + natural * natural / self._rate_hz * error * passed_s
        self.drift = min(max(drift, -_LARGEST_DRIFT), _LARGEST_DRIFT)
        correction = self.drift + 2.0 * natural / self._rate_hz * error
        return min(max(correction, -_LARGEST_CORRECTION), _LARGEST_CORRECTION)
