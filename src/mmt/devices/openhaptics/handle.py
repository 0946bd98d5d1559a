"""The leader's handle: a Phantom or Touch that the operator holds."""

from mmt.core.arrays import Vector
from mmt.devices.leader_reports import InterfaceState
from mmt.devices.openhaptics.driver import HdDriver
from mmt.devices.openhaptics.library import Stack
from mmt.devices.openhaptics.options import HdOptions
from mmt.devices.openhaptics.servo import Servo


class OpenHapticsHandle(HdDriver[Servo]):
    """Implements `LeaderInterface`; see `docs/how-to/openhaptics.md`.

    The handle measures no force: with ``hand_force = "contact"`` of ``[handle]`` the leader
    estimates the hand's force from the motion.
    """

    OPTIONS = HdOptions

    def _make_servo(
        self,
        stack: Stack,
        handle: int,
        limit_n: float,
        stiffness_n_mm: float,  # noqa: ARG002 - nothing is rendered here
    ) -> Servo:
        return Servo(stack.hd, stack.copies, handle, self._options, limit_n)

    def read(self, elapsed_ticks: int) -> InterfaceState:  # noqa: ARG002 - it has its own clock
        """Return the handle's newest state, at most a tick old."""
        servo = self.check()
        position = self._axes.place_in_scene(servo.position)
        velocity = self._axes.to_scene(servo.velocity)
        return InterfaceState(position, velocity, 0.0, contact=False)

    def write(self, force_n: Vector) -> None:
        """Display a force (N), cut to the limit.

        A force that is not finite is counted and ignored.
        """
        servo = self.check()
        if servo.accepts(force_n):
            servo.force = self._axes.to_device(force_n)
            servo.command_ns = servo.clock()
