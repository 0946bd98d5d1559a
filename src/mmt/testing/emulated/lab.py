"""A lab in a process of its own: the world, and emulated devices that measure it.

Its robot is moved by datagrams, or is an arm by Universal Robots where a third argument says
``ur``. It prints its devices' addresses as one line of JSON, and ends when its standard input
ends, as it does with the process that started it.
"""

import json
import sys
from typing import TYPE_CHECKING, Final

from mmt.core.process import SWITCH_INTERVAL_S, ask_for_short_turns
from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board
from mmt.testing.emulated.net_ft import EmulatedNetFt
from mmt.testing.emulated.robot import RobotLink
from mmt.testing.emulated.world import World

if TYPE_CHECKING:
    from mmt.testing.emulated.universal_robots.controller import EmulatedUrController

ACCELEROMETER_HZ: Final = 2000.0
ACCELEROMETER_BANDWIDTH_HZ: Final = 1000.0


def main(surface: str, seed: int, kind: str = "datagrams") -> None:
    """Run the lab until standard input ends."""
    ask_for_short_turns(0)  # the service that it is a child of goes first
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    world = World(surface, seed)
    robot = _ur_controller(world, seed) if kind == "ur" else RobotLink(world)
    box = EmulatedNetFt(world.force_n, clock_ppm=40.0, seed=seed)
    board = EmulatedAdxl335Board(
        world.acceleration_m_s2,
        rate_hz=ACCELEROMETER_HZ,
        bandwidth_hz=ACCELEROMETER_BANDWIDTH_HZ,
        clock_ppm=-70.0,
        seed=seed,
    )
    parts = (world, robot, box, board)
    for part in parts:
        part.start()
    addresses = {
        "robot" if kind == "datagrams" else kind: robot.options,
        "net_ft": box.options,
        "adxl335": {"port": board.address, "bandwidth_hz": ACCELEROMETER_BANDWIDTH_HZ},
    }
    sys.stdout.write(json.dumps(addresses) + "\n")
    sys.stdout.flush()
    sys.stdin.read()
    for part in reversed(parts):
        part.stop()


def _ur_controller(world: World, seed: int) -> "EmulatedUrController":
    from mmt.testing.emulated.universal_robots.controller import EmulatedUrController

    return EmulatedUrController(world, seed=seed)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
