"""Fade a force out when its source falls silent, and in when the source returns."""

from typing import Final

from mmt.devices.protocols import Vector

SILENCE_TICKS: Final = 50
"""Longest silence that counts as the network's jitter."""

RAMP_TICKS: Final = 50
"""Length of a ramp out or in: if no tick is missed, the force is zero after 100 ms of silence."""

FADE_TICKS: Final = SILENCE_TICKS + RAMP_TICKS
"""Ticks from the last force of a source until no force is displayed."""

_NONE: Final[Vector] = (0.0, 0.0, 0.0)


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
        self._shown = self._start = _NONE
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
        self._shown = self._start = _NONE
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
