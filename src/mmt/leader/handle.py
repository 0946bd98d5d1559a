"""A real handle in the operator's hand, which may be lost and come back somewhere else."""

from mmt.core.arrays import difference, towards
from mmt.devices.protocols import InterfaceState, LeaderInterface, Vector
from mmt.devices.reconnection import ReconnectingHandle


class OperatorHandle(ReconnectingHandle):
    """A handle, and what it has the follower do.

    While it is lost the command stays what it was: the robot holds. When it is back the
    difference between the robot's place and the handle's is worked off at a bounded speed, and
    the hand's motion comes on top, so that no command jumps.

    Parameters
    ----------
    device
        The driver's.
    recovery_mm
        The difference shrinks by so much in a tick.
    """

    def __init__(self, device: LeaderInterface, recovery_mm: float) -> None:
        super().__init__(device)
        self._recovery_mm = recovery_mm
        self._offset: Vector | None = None
        self._read_losses = 0
        self.command_mm: Vector | None = None
        """The follower's position command, None before the handle was ever read."""

    def read(self, elapsed_ticks: int) -> InterfaceState | None:
        """Return the state now, None while the handle is lost, and set the command."""
        state = super().read(elapsed_ticks)
        if state is None:
            return None
        position = state.position_mm
        if self.losses != self._read_losses:  # it is back, perhaps since an earlier `write`
            self._read_losses = self.losses
            if self.command_mm is not None:
                self._offset = difference(self.command_mm, position)
        if self._offset is None:
            self.command_mm = position
            return state
        x, y, z = towards(self._offset, (0.0, 0.0, 0.0), self._recovery_mm * elapsed_ticks)
        self.command_mm = (position[0] + x, position[1] + y, position[2] + z)
        self._offset = (x, y, z) if x or y or z else None
        return state
