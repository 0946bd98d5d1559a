"""The point that the arm is sent to: it moves towards the target within bounds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mmt.core.quaternions import Vector

_SHARE: Final = 0.8
"""Share of the acceleration that braking may use; the rest is for turning meanwhile."""


@dataclass(frozen=True)
class ServoSettings:
    """Bounds and gains, in the units of the arm."""

    speed_m_s: float
    acceleration_m_s2: float
    force_limit_n: float
    normal: Vector
    """Unit vector away from the surface, in the base's axes."""
    lookahead_s: float
    gain: float


class ServoPoint:
    """A point that starts at the tip and can always come to rest at its target.

    For an acceleration a, its speed towards a target at a distance d is at most sqrt(2 a d), and
    its velocity changes by no more than a. So it trails a target of constant speed v by about
    v^2 / (2 a). While the force on the tip exceeds its limit, the point goes no deeper.

    Parameters
    ----------
    settings
        The bounds.
    position_m
        Position of the tip.
    """

    def __init__(self, settings: ServoSettings, position_m: Sequence[float]) -> None:
        x, y, z = position_m
        self.position_m: Vector = (x, y, z)
        self.held_back = False
        """Whether the force limit kept the point from going deeper in the last `move`."""
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._settings = settings

    def move(self, target_m: Vector, force_n: Vector, period_s: float) -> Vector:
        """Advance by a period and return the new position (m).

        Parameters
        ----------
        target_m
            Target, in the base's frame.
        force_n
            Force on the tip, in the base's axes.
        period_s
            Time since the last call.
        """
        settings, place, old = self._settings, self.position_m, self._velocity
        way = [goal - here for goal, here in zip(target_m, place, strict=True)]
        distance = math.hypot(*way)
        braking = _SHARE * settings.acceleration_m_s2
        half = 0.5 * braking * period_s
        speed = min(
            distance / period_s,
            math.sqrt(half * half + 2.0 * braking * distance) - half,  # in whole periods
            settings.speed_m_s,
        )
        change = [
            (speed * part / distance if distance else 0.0) - now
            for part, now in zip(way, old, strict=True)
        ]
        most, size = settings.acceleration_m_s2 * period_s, math.hypot(*change)
        share = most / size if size > most else 1.0
        velocity = [now + share * part for now, part in zip(old, change, strict=True)]
        u, v, w = self._not_deeper(velocity, force_n)
        x, y, z = place
        self._velocity = (u, v, w)
        self.position_m = (x + period_s * u, y + period_s * v, z + period_s * w)
        return self.position_m

    def _not_deeper(self, velocity: list[float], force_n: Vector) -> list[float]:
        """Remove the part of a velocity into the surface, if the force is too large."""
        normal = self._settings.normal
        pressed = sum(a * b for a, b in zip(force_n, normal, strict=True))
        rising = sum(a * b for a, b in zip(velocity, normal, strict=True))
        small = pressed <= self._settings.force_limit_n  # false if it is NaN
        self.held_back = not small and rising < 0.0
        if not self.held_back:
            return velocity
        return [part - rising * along for part, along in zip(velocity, normal, strict=True)]
