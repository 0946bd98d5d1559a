"""A handle without a hand: it moves from action to action, at the leader's rate."""

from typing import Final

from mmt.core.arrays import Vector, clipped, difference
from mmt.devices.leader_reports import InterfaceState

_TICK_S: Final = 1e-3
_AT_REST: Final[Vector] = (0.0, 0.0, 0.0)
_LONGEST_PERIOD: Final = 200
"""Longest time between two actions in ticks; a later action begins a new motion."""
_CONTACT_N: Final = 0.05


class ActionHandle:
    """Go from action to action in straight lines; implements `LeaderInterface`.

    The time to reach an action is the time between this action and the one before, so that the
    motion is continuous, and one period late. The first action, and one after a pause of over
    0.2 s, is approached at a bounded speed. Before the first there is no state and no command.

    The hand's normal force is the displayed force, as with a real handle at rest.

    Parameters
    ----------
    recovery_mm_s
        Largest speed towards the first action, and after a pause.
    box_mm
        Lowest and highest corner of a box to which actions are clipped, or None.
    """

    def __init__(
        self, recovery_mm_s: float = 50.0, box_mm: tuple[Vector, Vector] | None = None
    ) -> None:
        self._recovery_mm = recovery_mm_s * _TICK_S
        self._box = box_mm
        self._position: Vector | None = None
        self._target: Vector = _AT_REST
        self._step: Vector = _AT_REST  # in a tick
        self._left = 0  # ticks until the target is reached
        self._since = _LONGEST_PERIOD + 1  # ticks since the last action
        self._force_n = 0.0

    def connect(self) -> None:
        """Do nothing: there is no device."""

    def calibrate(self) -> None:
        """Do nothing: there is no device."""

    def close(self) -> None:
        """Do nothing: there is no device."""

    def follow(self, action_mm: Vector, start_mm: Vector | None) -> Vector:
        """Take an action (mm), and return it as clipped to the box.

        Parameters
        ----------
        start_mm
            Position of the robot, used at the first action; None if it is not known.
        """
        self._target = action_mm if self._box is None else clipped(action_mm, *self._box)
        if self._position is None:
            self._position = self._target if start_mm is None else start_mm
        way = difference(self._target, self._position)
        if self._since > _LONGEST_PERIOD:
            self._left = max(1, round(sum(a * a for a in way) ** 0.5 / self._recovery_mm))
        else:
            self._left = max(1, self._since)
        self._step = (way[0] / self._left, way[1] / self._left, way[2] / self._left)
        self._since = 0
        return self._target

    def read(self, elapsed_ticks: int) -> InterfaceState | None:
        """Advance by the ticks and return the state, or None before the first action."""
        self._since = min(self._since + elapsed_ticks, _LONGEST_PERIOD + 1)
        if self._position is None:
            return None
        velocity = _AT_REST
        if self._left > 0:
            u, v, w = self._step
            velocity = (u / _TICK_S, v / _TICK_S, w / _TICK_S)
            self._left -= elapsed_ticks
            x, y, z = self._position
            go = elapsed_ticks
            moved = (x + go * u, y + go * v, z + go * w)
            self._position = moved if self._left > 0 else self._target
        pressed_n = max(self._force_n, 0.0)
        return InterfaceState(self._position, velocity, pressed_n, pressed_n > _CONTACT_N)

    def write(self, force_n: Vector) -> None:
        """Take the force (N) that a hand would feel."""
        self._force_n = force_n[2]
