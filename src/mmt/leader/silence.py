"""Let a force out when its source falls silent and in again when it comes back, without a step."""

from typing import Final

from mmt.devices.protocols import Vector

SILENCE_TICKS: Final = 50
"""Silence up to this is the network's jitter."""

RAMP_TICKS: Final = 50
"""A ramp out or in takes so long: 100 ms after the last frame there is no force."""


class SilenceRamp:
    """Shape a force by how long ago its source sent anything.

    After `silence_ticks` without `renew` the force goes linearly to zero within `ramp_ticks`.
    When the source sends again, the output goes linearly from what is displayed to the
    source's force within `ramp_ticks`, wherever the ramp out had got to.

    Parameters
    ----------
    silence_ticks, ramp_ticks
        Both at least 1; `silence_ticks` not below `ramp_ticks`, so that one ramp has ended
        before the other begins.
    """

    def __init__(self, silence_ticks: int = SILENCE_TICKS, ramp_ticks: int = RAMP_TICKS) -> None:
        self._silence_ticks = silence_ticks
        self._ramp_ticks = ramp_ticks
        self._age_ticks = 0
        self._shown: Vector = (0.0, 0.0, 0.0)
        self._start: Vector = (0.0, 0.0, 0.0)
        self._share = 1.0  # of the source's force; the rest is that of the ramp's start

    @property
    def silent(self) -> bool:
        """Whether the source has been silent for too long."""
        return self._age_ticks > self._silence_ticks

    def renew(self) -> None:
        """Note that the source has given a new force."""
        if self.silent:
            self._start = self._shown
            self._share = 0.0
        self._age_ticks = 0

    def rest(self, elapsed: int) -> None:
        """Note that nothing is displayed for these ticks; the force then returns from zero."""
        self._age_ticks += elapsed
        self._shown = self._start = (0.0, 0.0, 0.0)
        self._share = 0.0

    def shape(self, force_n: Vector, elapsed: int) -> Vector:
        """Return the force (N) to display now, `elapsed` ticks after the last call."""
        self._age_ticks += elapsed
        if self._share < 1.0:
            share = self._share = min(1.0, self._share + elapsed / self._ramp_ticks)
            rest = 1.0 - share
            force_n = (
                share * force_n[0] + rest * self._start[0],
                share * force_n[1] + rest * self._start[1],
                share * force_n[2] + rest * self._start[2],
            )
        beyond = self._age_ticks - self._silence_ticks
        if beyond > 0:
            left = max(0.0, 1.0 - beyond / self._ramp_ticks)
            force_n = (left * force_n[0], left * force_n[1], left * force_n[2])
        self._shown = force_n
        return force_n
