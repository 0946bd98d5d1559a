"""Keep a robot's commanded position in its workspace, and its acceleration bounded."""

import math
from collections.abc import Callable
from typing import Final

from mmt.core.arrays import Vector, clipped, difference, step_towards
from mmt.scene import MotionLimits

_AT_REST: Final = (0.0, 0.0, 0.0)


class MotionLimit:
    """The last bound on the positions that are sent to a robot, whatever their source.

    - A position outside the workspace is clipped to it. A robot that begins outside goes no
      farther out.
    - Along each axis the velocity changes by no more than the acceleration limit allows.
    - Along each axis the robot can always stop, within that limit, at the wanted position or
      before it. So it overshoots neither this position nor the workspace, unless the wanted
      position jumps to a point at which the robot can no longer stop.
    - A call moves the robot by no more than the speed limit allows in one tick, even if it makes
      up for missed ticks. The robot stood still in those and is assumed to have slowed down.

    At a speed v the robot follows about v²/2a behind; exactly if the acceleration of one tick is
    enough to stop it. About 5 us a tick.

    Parameters
    ----------
    limits
        The follower's ``[devices]`` or ``[simulated]``.
    limit_mm_s
        Largest speed.
    rate_hz
        Ticks a second.
    """

    def __init__(self, limits: MotionLimits, limit_mm_s: float, rate_hz: float) -> None:
        self._box = limits.box_mm
        most = limits.acceleration_limit_mm_s2
        self._change_mm = math.inf if most == "off" else most / rate_hz**2
        self._fastest_mm = limit_mm_s / rate_hz
        self._position: Vector | None = None
        self._velocity: Vector = _AT_REST  # mm a tick

    def restart(self) -> None:
        """Begin at rest at the next position."""
        self._position, self._velocity = None, _AT_REST

    def step(self, elapsed: int, wanted: Vector | None) -> Vector | None:
        """Return the position (mm) to take now, None before the first.

        Parameters
        ----------
        elapsed
            Ticks since the last call, at least 1.
        wanted
            Position (mm) to go to; if it is None or not finite, the robot stops.
        """
        known = wanted is not None and math.isfinite(sum(wanted))
        here = self._position
        if here is None:
            self._position = wanted if known else None
            return self._position
        goal = wanted if wanted is not None and known else here
        if self._box is not None:
            low, high = self._box
            goal = clipped(goal, _each(min, low, here), _each(max, high, here))
        velocity = self._next_velocity(here, goal, self._slowed(elapsed - 1))
        x, y, z = (
            there if there - place == step else place + step
            for place, there, step in zip(here, goal, velocity, strict=True)
        )
        self._position, self._velocity = (x, y, z), velocity
        return self._position

    def _slowed(self, missed: int) -> Vector:
        """Return the velocity after missed ticks, in which the robot was not moved."""
        if not missed:
            return self._velocity
        less = missed * self._change_mm
        x, y, z = (math.copysign(max(abs(v) - less, 0.0), v) for v in self._velocity)
        return (x, y, z)

    def _next_velocity(self, here: Vector, goal: Vector, velocity: Vector) -> Vector:
        """Return the velocity (mm a tick) of the next tick."""
        change = self._change_mm
        wanted = difference(step_towards(here, goal, self._fastest_mm), here)
        steps = []
        for want, distance, before in zip(wanted, difference(goal, here), velocity, strict=True):
            most = _stoppable(abs(distance), change)
            step = max(-most, min(want, most))
            steps.append(max(before - change, min(step, before + change)))
        if math.hypot(*steps) > self._fastest_mm * (1.0 + 1e-9):
            # No axis gets faster while another still has to slow down.
            steps = [_no_faster(step, v) for step, v in zip(steps, velocity, strict=True)]
        x, y, z = steps
        return (x, y, z)


def _each(choose: Callable[[float, float], float], first: Vector, second: Vector) -> Vector:
    x, y, z = map(choose, first, second)
    return (x, y, z)


def _stoppable(distance_mm: float, change_mm: float) -> float:
    """Return the largest step (mm) after which the robot can stop within a distance.

    Each of the following steps is shorter by `change_mm`: after n of them the path has the length
    (n + 1) step - change n (n + 1) / 2.
    """
    if distance_mm <= change_mm:
        return distance_mm
    count = int((math.sqrt(1.0 + 8.0 * distance_mm / change_mm) - 1.0) / 2.0)
    return distance_mm / (count + 1) + 0.5 * change_mm * count


def _no_faster(step: float, before: float) -> float:
    """Return the step, or the nearest one that is no longer than the step before."""
    if abs(step) <= abs(before):
        return step
    return before if step * before > 0.0 else 0.0
