"""The speed at which a hand meets the surface."""

from collections import deque
from typing import Final

from mmt.devices.protocols import InterfaceState

APPROACH_S: Final = 0.02
"""Time before the contact over which the approach speed is averaged."""


class Landing:
    """Measure the approach speed when a hand's contact begins.

    Parameters
    ----------
    normal
        Number of the surface's normal axis.
    rate_hz
        Rate of the ticks.
    """

    def __init__(self, normal: int, rate_hz: float) -> None:
        self._normal = normal
        self._count = round(APPROACH_S * rate_hz)
        self._speeds: deque[float] = deque(maxlen=self._count)

    def step(self, state: InterfaceState | None, elapsed: int) -> float:
        """Return the approach speed (mm/s) at the first tick of a contact, else 0.

        Return 0 too if the hand was not in the air for `APPROACH_S`. ``elapsed`` is the number of
        ticks since the last call.
        """
        if state is not None and not state.contact:
            ticks = min(elapsed, self._count)
            self._speeds.extend([-state.velocity_mm_s[self._normal]] * ticks)
            return 0.0
        if not self._speeds:
            return 0.0
        mean, whole = sum(self._speeds) / len(self._speeds), len(self._speeds) == self._count
        self._speeds.clear()
        return max(0.0, mean) if whole and state is not None else 0.0
