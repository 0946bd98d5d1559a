"""Emulated Inverse Services with one device each, in a process of their own.

For the handle, a simulated hand holds the tip and strokes a surface at the scene's zero. For the
robot, the tip is free. See `mmt.testing.emulated.lab_process`.
"""

import sys

from mmt.core.arrays import Vector
from mmt.scene import Hand
from mmt.testing.emulated.lab_process import run_lab
from mmt.testing.simulation import START_MM
from mmt.testing.simulation.hand import SimulatedHand
from mmt_devices.inverse3.emulated import REST_MM, EmulatedInverse3
from mmt_devices.inverse3.emulated_tip import EmulatedTip


class StrokingHand:
    """Simulated hand that holds the tip and feels the displayed force.

    Parameters
    ----------
    seed
        Seed of the hand's motion.
    """

    def __init__(self, seed: int) -> None:
        self._hand = SimulatedHand(Hand(), seed)

    def __call__(self, felt_n: Vector) -> Vector:
        """Return where the hand holds the tip one millisecond later."""
        self._hand.write(felt_n)
        return _on_device(self._hand.read(1).position_mm)


def _on_device(position_mm: Vector) -> Vector:
    """Convert a scene's position (mm) to the device's axes, by the driver's default options."""
    (x, y, z), (u, v, w) = position_mm, REST_MM
    return (x + u, y + v, z + w)


def main(seed: int) -> None:
    """Run the services until standard input ends."""

    def service(role: str) -> EmulatedInverse3:
        held = StrokingHand(seed) if role == "handle" else None
        return EmulatedInverse3({"049D": EmulatedTip(_on_device(START_MM), held)})

    run_lab(service)


if __name__ == "__main__":
    main(int(sys.argv[1]))
