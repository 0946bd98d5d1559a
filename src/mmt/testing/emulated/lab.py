"""A lab in a process of its own: the world, and emulated devices that measure it or move its tip.

The devices are entry points of the group ``mmt.emulators``: functions that take the world, a seed
and the lab's clockwork. See `mmt.testing.emulated.lab_process`.
"""

import sys
from typing import Final

from mmt.core.plugins import load, offered
from mmt.core.running.process import ask_for_short_turns
from mmt.testing.emulated.clockwork import Clockwork
from mmt.testing.emulated.lab_process import LabDevice, run_lab
from mmt.testing.emulated.world import TICK_NS, World

GROUP: Final = "mmt.emulators"


def main(surface: str, samples_per_frame: str, seed: str) -> None:
    """Run the lab until standard input ends."""
    ask_for_short_turns(0)  # its parent, the service, goes first
    clockwork = Clockwork(TICK_NS)
    world = World(surface, int(seed), clockwork, int(samples_per_frame))

    def device(name: str) -> LabDevice:
        made: LabDevice = load(offered(GROUP)[name], name)(world, int(seed), clockwork)
        return made

    world.start()
    run_lab(device)
    world.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
