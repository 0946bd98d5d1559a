"""Let a force out when its source falls silent and in again when it comes back, without a step."""

from typing import Final

from mmt.devices.protocols import Vector

SILENCE_TICKS: Final = 50
"""Silence up to this is the network's jitter."""

RAMP_TICKS: Final = 50
"""Length of a ramp out or in: where no tick is missed, there is no force after 100 ms."""

FADE_TICKS: Final = SILENCE_TICKS + RAMP_TICKS
"""From the last force of a source until none is displayed."""

_NONE: Final[Vector] = (0.0, 0.0, 0.0)


class ForceRamp:
    """Shape a force by the time since its source last gave one.

    After `silence_ticks` without `renew` the force goes linearly to zero over `ramp_ticks`.
    When the source returns, the output goes linearly from what is displayed to the
    source's force over `ramp_ticks`, wherever the ramp out had got to.

    Missed ticks count for the silence. A ramp goes one tick further at each call of `shape`, that
    is, with each force written: a call that was held up makes no step.

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
        """Note that the source gives no force any more, without waiting for its silence."""
        self._age_ticks = max(self._age_ticks, self._silence_ticks + 1)

    def renew(self) -> None:
        """Note that the source has given a new force."""
        if self.silent:
            self._start = self._shown
            self._share = 0.0
            self._left = 1.0
        self._age_ticks = 0

    def rest(self, elapsed: int) -> None:
        """Note that nothing is displayed for these ticks; the force then returns from zero."""
        self._age_ticks += elapsed
        self._shown = self._start = _NONE
        self._share = 0.0

    def shape(self, force_n: Vector, elapsed: int) -> Vector:
        """Return the force (N) to display now, `elapsed` ticks after the last call."""
        self._age_ticks += elapsed
        step = 1.0 / self._ramp_ticks
        if self.silent:  # a ramp in that has not ended waits: both at once would be too fast
            self._left = max(0.0, self._left - step)
        else:
            self._share = min(1.0, self._share + step)
        share, left = self._left * self._share, self._left * (1.0 - self._share)
        x, y, z = force_n
        u, v, w = self._start
        self._shown = (share * x + left * u, share * y + left * v, share * z + left * w)
        return self._shown
