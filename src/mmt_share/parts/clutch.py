"""A hand takes up a robot elsewhere than where the hand is, without a jump."""

from mmt.core.arrays import difference
from mmt.devices.protocols import InterfaceState, Vector


class Clutch:
    """The difference between a robot and the hand that moves it, and how it shrinks.

    The robot makes the hand's own motion from the first moment. The difference shrinks along each
    axis, so that a small one along the surface's normal does not wait for a large one across the
    surface. It shrinks no faster than the hand moves, so that a hand at rest leaves the robot at
    rest, and no faster than a bound. What shrinks with the hand's motion alone is hardly noticed
    (Conti and Khatib, "Spanning large workspaces using small haptic devices", World Haptics 2005).

    Parameters
    ----------
    robot_mm
        Where the robot is.
    hand_mm
        Where the hand is.
    recovery_mm_s
        Bound of the speed at which the difference shrinks along each axis.
    """

    def __init__(self, robot_mm: Vector, hand_mm: Vector, recovery_mm_s: float) -> None:
        self.offset_mm: Vector = difference(robot_mm, hand_mm)
        """What the robot's position has more than the hand's."""
        self._recovery_mm_s = recovery_mm_s

    def step(self, hand: InterfaceState, elapsed_s: float) -> Vector:
        """Return where the robot is to be (mm), this time after the last call."""
        u, v, w = hand.velocity_mm_s
        speed_mm_s = min((u * u + v * v + w * w) ** 0.5, self._recovery_mm_s)
        most_mm = speed_mm_s * elapsed_s
        dx, dy, dz = (offset - min(max(offset, -most_mm), most_mm) for offset in self.offset_mm)
        self.offset_mm = (dx, dy, dz)
        x, y, z = hand.position_mm
        return (x + dx, y + dy, z + dz)
