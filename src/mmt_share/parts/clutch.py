"""Clutch: moves the robot relative to the hand, so that engaging causes no step."""

from mmt.core.arrays import difference
from mmt.devices.protocols import InterfaceState, Vector


class Clutch:
    """Offset between a robot and the hand that moves it, which shrinks while the hand moves.

    The robot makes the hand's own motion from the first moment. The offset shrinks along each axis
    on its own, so that a small offset along the surface's normal does not wait for a large one
    across the surface. It shrinks no faster than the hand moves, so that a hand at rest leaves the
    robot at rest, and no faster than a bound. People hardly notice such a shrinking offset (Conti,
    Khatib, "Spanning large workspaces using small haptic devices", World Haptics 2005).

    Parameters
    ----------
    robot_mm
        Position of the robot.
    hand_mm
        Position of the hand.
    recovery_mm_s
        Largest speed at which the offset shrinks along each axis.
    """

    def __init__(self, robot_mm: Vector, hand_mm: Vector, recovery_mm_s: float) -> None:
        self.offset_mm: Vector = difference(robot_mm, hand_mm)
        """Position of the robot minus position of the hand."""
        self._recovery_mm_s = recovery_mm_s

    def step(self, hand: InterfaceState, elapsed_s: float) -> Vector:
        """Return the wanted position of the robot (mm), `elapsed_s` after the last call."""
        u, v, w = hand.velocity_mm_s
        speed_mm_s = min((u * u + v * v + w * w) ** 0.5, self._recovery_mm_s)
        most_mm = speed_mm_s * elapsed_s
        dx, dy, dz = (offset - min(max(offset, -most_mm), most_mm) for offset in self.offset_mm)
        self.offset_mm = (dx, dy, dz)
        x, y, z = hand.position_mm
        return (x + dx, y + dy, z + dz)
