"""A lab in a process of its own: robot and surface in real time, and devices that measure them.

The devices are entry points of the group ``mmt.emulators``: functions that take the world, a seed
and the lab's clockwork. See `mmt.testing.emulated.lab_process`.
"""

import sys
import time
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError
from mmt.core.frames import CHANNELS, acceleration_samples
from mmt.core.plugins import load, offered
from mmt.core.running.process import ask_for_short_turns
from mmt.core.units import GRAVITY_M_S2
from mmt.scene import Simulated
from mmt.testing.emulated import Clockwork
from mmt.testing.emulated.lab_process import LabDevice, run_lab
from mmt.testing.simulation import RATE_HZ, START_MM
from mmt.testing.simulation.follower import MovedTip, SimulatedFollower
from mmt.testing.simulation.surfaces.textures import get_surface

TICK_NS: Final = 1_000_000

_BEHIND_TICKS: Final = 4
"""Delay of the world's values, so that those after an instant are known too."""
_KEPT: Final = 256
_MOST_AT_ONCE: Final = 200
"""Ticks; after a longer hold-up the world's time skips."""


class World:
    """A robot that follows commands on a surface of known texture.

    Parameters
    ----------
    surface
        Name of a simulated surface.
    seed
        Seed of the texture.
    clockwork
        Clockwork whose thread runs it; None for one of its own.
    samples_per_frame
        Samples of acceleration in a millisecond, which bound the band of the vibration.

    Raises
    ------
    InputError
        No surface has the name given.
    """

    def __init__(
        self,
        surface: str = "plastic",
        seed: int = 1,
        clockwork: Clockwork | None = None,
        samples_per_frame: int = 1,
    ) -> None:
        self.samples_per_frame: Final = samples_per_frame
        self._follower = SimulatedFollower(
            Simulated(noise=False),
            channels=CHANNELS,
            seed=seed,
            surface=get_surface(surface, samples_per_frame * RATE_HZ),
        )
        self._positions: list[Vector] = [START_MM] * _KEPT
        self._forces: list[Vector] = [(0.0, 0.0, 0.0)] * _KEPT
        self._accelerations: list[Vector] = [(0.0, 0.0, GRAVITY_M_S2)] * _KEPT * samples_per_frame
        self._newest = 0
        self._begun_ns = time.monotonic_ns()
        self._due = 0
        self._clockwork = clockwork or Clockwork()
        self.command_mm: Vector | None = None
        """Commanded position of the robot; set from any thread."""
        self._has_robot = False

    def take_robot(self) -> None:
        """Note that a device moves the tip.

        Raises
        ------
        MmtError
            Another device moves it.
        """
        if self._has_robot:
            raise MmtError(
                "the virtual lab has another robot already: a scene whose force sensor is that of "
                "a robot has this as its robot too"
            )
        self._has_robot = True

    def place_tip(self, tip: MovedTip) -> None:
        """Put another tip onto the surface, in the robot's place; see `take_robot`."""
        self.take_robot()
        tip.friction_coefficient = self._follower.robot.friction_coefficient
        self._follower.robot = tip

    def start(self) -> None:
        """Begin to move."""
        self._begun_ns = time.monotonic_ns()
        self._clockwork.add(self._turn)

    def stop(self) -> None:
        """End; calling it twice is harmless."""
        self._clockwork.remove(self._turn)

    def position_mm(self, time_ns: int) -> Vector:
        """Return the tip's position at a time of the monotonic clock."""
        return self._at(time_ns, self._positions)

    def force_n(self, time_ns: int) -> Vector:
        """Return the force of the surface on the tool."""
        return self._at(time_ns, self._forces)

    def acceleration_m_s2(self, time_ns: int) -> Vector:
        """Return the proper acceleration of the tool, gravity included."""
        return self._at(time_ns, self._accelerations)

    def _at(self, time_ns: int, values: list[Vector]) -> Vector:
        """Interpolate by the cubic through four values; times outside the history are clamped."""
        count = len(values)
        a_tick = count // _KEPT
        place = ((time_ns - self._begun_ns) / TICK_NS - _BEHIND_TICKS) * a_tick
        newest = self._newest * a_tick
        place = min(max(place, newest - count // 2, 1.0), max(newest - 2.0, 1.0))
        first = int(place)
        u = place - first
        before, start, end, after = (values[(first + k) % count] for k in (-1, 0, 1, 2))
        a = -u * (u - 1) * (u - 2) / 6
        b = (u + 1) * (u - 1) * (u - 2) / 2
        c = -(u + 1) * u * (u - 2) / 2
        d = (u + 1) * u * (u - 1) / 6
        x, y, z = (a * before[i] + b * start[i] + c * end[i] + d * after[i] for i in range(3))
        return x, y, z

    def _turn(self, now_ns: int) -> int:
        passed = (now_ns - self._begun_ns) // TICK_NS
        if passed - self._due > _MOST_AT_ONCE:  # held up: time went on without the world
            self._begun_ns += (passed - self._due) * TICK_NS
            passed = self._due
        while self._due < passed:
            self._due += 1
            self._advance(self._due)
        return self._begun_ns + (self._due + 1) * TICK_NS

    def _advance(self, tick: int) -> None:
        frame = self._follower.step(1, 0, self.command_mm)
        samples = acceleration_samples(frame)
        first = (tick - 1) * len(samples) + 1
        for values, measured, place in (
            (self._positions, frame["position_mm"], tick),
            (self._forces, frame["force_n"], tick),
            (self._accelerations, samples, first),
        ):
            for row, (x, y, z) in enumerate(measured.tolist(), place):
                values[row % len(values)] = (x, y, z)
        self._newest = tick


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
