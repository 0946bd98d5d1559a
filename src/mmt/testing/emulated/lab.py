"""A lab in a process of its own: the world, and emulated devices that measure it.

Its robot is moved by datagrams, unless the last argument names another robot, as ``ur``. The lab
prints the robot's address as one line of JSON, and a sensor's when a line of standard input names
the sensor. It ends when standard input ends, which also happens with the process that started it.

The devices are entry points of the group ``mmt.emulators``: functions that take the world, a seed
and the lab's clockwork.
"""

import gc
import json
import sys
from typing import Any, Final, Protocol

from mmt.core.plugins import load, offered
from mmt.core.process import SWITCH_INTERVAL_S, ask_for_short_turns
from mmt.testing.emulated.clockwork import Clockwork
from mmt.testing.emulated.world import TICK_NS, World

GROUP: Final = "mmt.emulators"


class LabDevice(Protocol):
    """An emulated device of the lab."""

    @property
    def options(self) -> dict[str, Any]:
        """Options by which its driver finds it."""

    def start(self) -> None:
        """Begin to measure, and to answer."""

    def stop(self) -> None:
        """End it."""


def main(surface: str, samples_per_frame: str, seed: str, robot_name: str = "robot") -> None:
    """Run the lab until standard input ends."""
    ask_for_short_turns(0)  # its parent, the service, goes first
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    clockwork = Clockwork(TICK_NS)
    world = World(surface, int(seed), clockwork, int(samples_per_frame))

    def device(name: str) -> LabDevice:
        made: LabDevice = load(offered(GROUP)[name], name)(world, int(seed), clockwork)
        return made

    robot = device(robot_name)
    gc.freeze()  # a real device does not stop for garbage collection
    parts: list[World | LabDevice] = [world, robot]
    for part in parts:
        part.start()
    _say({robot_name: robot.options})
    for line in sys.stdin:
        sensor = device(line.strip())
        sensor.start()
        parts.append(sensor)
        _say({line.strip(): sensor.options})
    for part in reversed(parts):
        part.stop()


def _say(addresses: dict[str, dict[str, Any]]) -> None:
    sys.stdout.write(json.dumps(addresses) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
