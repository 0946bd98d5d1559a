"""A lab in a process of its own: the world, and emulated devices that measure it.

Its robot is moved by datagrams, or is an arm by Universal Robots where a third argument says
``ur``. It prints the robot's address as one line of JSON, that of a sensor when a line of its
standard input names it, and ends when that input ends, as it does with the process that started it.
"""

import gc
import json
import sys
from typing import TYPE_CHECKING, Any, Final

from mmt.core.process import SWITCH_INTERVAL_S, ask_for_short_turns
from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board
from mmt.testing.emulated.bota import EmulatedBota
from mmt.testing.emulated.clockwork import Clockwork
from mmt.testing.emulated.iio import EmulatedIio
from mmt.testing.emulated.iio_chips import ADXL359
from mmt.testing.emulated.net_ft import EmulatedNetFt
from mmt.testing.emulated.robot import RobotLink
from mmt.testing.emulated.world import TICK_NS, World

if TYPE_CHECKING:
    from mmt.testing.emulated.universal_robots.controller import EmulatedUrController

ACCELEROMETER_HZ: Final = 2000.0
ACCELEROMETER_BANDWIDTH_HZ: Final = 1000.0


def main(surface: str, seed: int, kind: str = "datagrams") -> None:
    """Run the lab until standard input ends."""
    ask_for_short_turns(0)  # the service that it is a child of goes first
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    clockwork = Clockwork(TICK_NS)
    world = World(surface, seed, clockwork)
    robot = _ur_controller(world, seed) if kind == "ur" else RobotLink(world)
    gc.freeze()  # a real device does not stand still for a collector
    parts: list[Any] = [world, robot]
    for part in parts:
        part.start()
    _say({"robot" if kind == "datagrams" else kind: robot.options})
    for line in sys.stdin:
        device = _sensor(line.strip(), world, seed, clockwork)
        device.start()
        parts.append(device)
        _say({line.strip(): device.options})
    for part in reversed(parts):
        part.stop()


def _ur_controller(world: World, seed: int) -> "EmulatedUrController":
    from mmt.testing.emulated.universal_robots.controller import EmulatedUrController

    return EmulatedUrController(world, seed=seed)


def _sensor(name: str, world: World, seed: int, clockwork: Clockwork) -> Any:
    """Return a sensor; one that no scene names costs nothing."""
    if name == "net_ft":
        return EmulatedNetFt(world.force_n, clock_ppm=40.0, seed=seed)
    if name == "bota":
        return EmulatedBota(world.force_n, clock_ppm=25.0, seed=seed, clockwork=clockwork)
    if name == "iio":
        return EmulatedIio(
            world.acceleration_m_s2, ADXL359, clock_ppm=-120.0, seed=seed, clockwork=clockwork
        )
    return EmulatedAdxl335Board(
        world.acceleration_m_s2,
        rate_hz=ACCELEROMETER_HZ,
        bandwidth_hz=ACCELEROMETER_BANDWIDTH_HZ,
        clock_ppm=-70.0,
        seed=seed,
    )


def _say(addresses: dict[str, dict[str, Any]]) -> None:
    sys.stdout.write(json.dumps(addresses) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
