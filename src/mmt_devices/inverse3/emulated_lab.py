"""An emulated Inverse Service with one device, in a process of its own.

Its tip is held by a hand that strokes a surface at a scene's zero, or is free. See
`mmt.testing.emulated.lab_process`.
"""

import gc
import json
import sys

from mmt.core.process import SWITCH_INTERVAL_S
from mmt.devices.protocols import Vector
from mmt.scene import Hand
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.robot import START_MM
from mmt_devices.inverse3.emulated import REST_MM, EmulatedInverse3
from mmt_devices.inverse3.emulated_tip import EmulatedTip


class StrokingHand:
    """A simulated hand that holds the tip; it feels what the device displays.

    Parameters
    ----------
    seed
        Seed of what it does.
    """

    def __init__(self, seed: int) -> None:
        self._hand = SimulatedHand(Hand(), seed)

    def __call__(self, felt_n: Vector) -> Vector:
        """Return where it holds the tip after the next millisecond."""
        self._hand.write(felt_n)
        return _on_device(self._hand.read(1).position_mm)


def _on_device(position_mm: Vector) -> Vector:
    """Return a place (mm) of a scene in the device's axes, as the driver's defaults have it."""
    (x, y, z), (u, v, w) = position_mm, REST_MM
    return (x + u, y + v, z + w)


def main(role: str, seed: int) -> None:
    """Run the service until standard input ends."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.freeze()  # a real device does not stand still for a collector
    held = StrokingHand(seed) if role == "handle" else None
    service = EmulatedInverse3({"049D": EmulatedTip(_on_device(START_MM), held)})
    service.start()
    sys.stdout.write(json.dumps({"inverse3": service.options}) + "\n")
    sys.stdout.flush()
    sys.stdin.read()
    service.stop()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
