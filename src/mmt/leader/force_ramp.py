"""Let a force out when its source falls silent and in again when it comes back, without a step."""

from typing import Final

from mmt.devices.protocols import Vector

SILENCE_TICKS: Final = 50
"""Silence up to this is the network's jitter."""

RAMP_TICKS: Final = 50
"""Length of a ramp out or in, in forces written: 100 ms after the last frame there is none."""


class ForceRamp:
    """Shape a force by the time since its source last gave one.

    Silence is counted in ticks, the ramps in calls of `shape`: however late a tick is, each force
    that is displayed is at most one step of the ramp away from the one before.

    After `silence_ticks` without `renew` the force goes linearly to zero within `ramp_ticks`.
    When the source returns, the output goes linearly from what is displayed to the
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
        self._gain = 1.0  # of what is displayed, less than 1 in silence

    @property
    def silent(self) -> bool:
        """Whether the source has been silent for too long."""
        return self._age_ticks > self._silence_ticks

    def renew(self) -> None:
        """Note that the source has given a new force."""
        if self.silent:
            self._begin_ramp()
        self._age_ticks = 0

    def rest(self, elapsed: int) -> None:
        """Note that nothing is displayed for these ticks; the force then returns from zero."""
        self._age_ticks += elapsed
        self._shown = (0.0, 0.0, 0.0)
        self._begin_ramp()

    def shape(self, force_n: Vector, elapsed: int) -> Vector:
        """Return the force (N) to display now, `elapsed` ticks after the last call."""
        if elapsed > self._silence_ticks:  # held up: the source has moved on meanwhile
            self._begin_ramp()
        self._age_ticks += elapsed
        if self._share < 1.0:
            share = self._share = min(1.0, self._share + 1 / self._ramp_ticks)
            rest = 1.0 - share
            force_n = (
                share * force_n[0] + rest * self._start[0],
                share * force_n[1] + rest * self._start[1],
                share * force_n[2] + rest * self._start[2],
            )
        if self.silent:
            gain = self._gain = max(0.0, self._gain - 1 / self._ramp_ticks)
            force_n = (gain * force_n[0], gain * force_n[1], gain * force_n[2])
        self._shown = force_n
        return force_n

    def _begin_ramp(self) -> None:
        """Go to the source's force from what is displayed."""
        self._start = self._shown
        self._share, self._gain = 0.0, 1.0
