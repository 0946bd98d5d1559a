"""The operator's handle, which may be lost and return, and the command that follows it."""

from mmt.core.arrays import Vector, difference, step_towards
from mmt.devices.leader_reports import InterfaceState
from mmt.devices.protocols import LeaderInterface
from mmt.devices.reconnection import ReconnectingHandle


class OperatorHandle(ReconnectingHandle):
    """A handle that may be lost and return elsewhere, and the follower's position command.

    While the handle is lost the command does not change: the robot holds. After the handle's
    return the difference between the command and the handle's position is reduced at a bounded
    speed, in addition to the hand's motion, so that the command does not jump.

    Parameters
    ----------
    device
        The handle's driver.
    recovery_mm
        Reduction of the difference in one tick, mm.
    """

    def __init__(self, device: LeaderInterface, recovery_mm: float) -> None:
        super().__init__(device)
        self._recovery_mm = recovery_mm
        self._offset: Vector | None = None
        self._read_losses = 0
        self.command_mm: Vector | None = None
        """The follower's position command (mm), or None before the handle was ever read."""

    def read(self, elapsed_ticks: int) -> InterfaceState | None:
        """Return the state now, or None while the handle is lost; set the command."""
        state = super().read(elapsed_ticks)
        if state is None:
            return None
        position = state.position_mm
        if self.losses != self._read_losses:  # returned, perhaps during an earlier `write`
            self._read_losses = self.losses
            if self.command_mm is not None:
                self._offset = difference(self.command_mm, position)
        if self._offset is None:
            self.command_mm = position
            return state
        x, y, z = step_towards(self._offset, (0.0, 0.0, 0.0), self._recovery_mm * elapsed_ticks)
        self.command_mm = (position[0] + x, position[1] + y, position[2] + z)
        self._offset = (x, y, z) if x or y or z else None
        return state
