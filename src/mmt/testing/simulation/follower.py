"""A whole follower without hardware: robot, surface of known texture, sensors."""

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING, Protocol

from mmt.core.arrays import RecordArray, Vector
from mmt.scene import Simulated
from mmt.testing.simulation import START_MM
from mmt.testing.simulation.instruments import Instruments
from mmt.testing.simulation.robot import SimulatedRobot, TipState

if TYPE_CHECKING:
    from mmt.testing.simulation.surfaces.course import SurfaceCourse
    from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface


class MovedTip(Protocol):
    """The tip on the surface."""

    friction_coefficient: float

    def advance(self, command_mm: Vector) -> TipState:
        """Move for one tick towards the command; return the state at its end."""


class SimulatedFollower:
    """Follows motion commands on a known surface; implements `FollowerSource`.

    Until the first command the tip waits above the surface. Without a new command it holds the
    last one; it ignores a command that is not finite. It never finishes by itself.
    Cost: about 20 us a tick, and 6 us for each further sample of acceleration.

    Parameters
    ----------
    settings
        The scene's ``[simulated]``.
    channels
        The channels of the frames.
    seed
        The scene's seed.
    surface
        A surface, or a course over several; its rate says how many samples of acceleration a frame
        has.
    """

    def __init__(
        self,
        settings: Simulated,
        *,
        channels: Sequence[str],
        seed: int,
        surface: "KnownSurface | SurfaceCourse",
    ) -> None:
        self._settings = settings
        self._surface = surface
        self.robot: MovedTip = SimulatedRobot(settings, surface.friction_coefficient)
        """The tip that is moved; another one may take its place before the first step."""
        self._instruments = Instruments(surface, channels, seed, noise=settings.noise)
        self.dtype = self._instruments.dtype
        """Dtype of the frames."""
        self._command = START_MM

    def start(self, start_time_ns: int) -> None:
        """Set the time of the first frame; every later one is a period after the last."""
        self._instruments.start_time_ns = start_time_ns

    def step(
        self,
        elapsed: int,
        now_ns: int,  # noqa: ARG002 - simulated time runs with the ticks alone
        command_position_mm: Vector | None,
    ) -> RecordArray:
        """Return `elapsed` frames; see `FollowerSource.step`."""
        if command_position_mm is not None and all(map(isfinite, command_position_mm)):
            self._command = command_position_mm
        friction = self._instruments.friction_coefficient
        if friction is not None:
            self.robot.friction_coefficient = friction
        return self._instruments.frames([self.robot.advance(self._command) for _ in range(elapsed)])

    @property
    def finished(self) -> bool:
        """False: a robot waits for the next command."""
        return False

    @property
    def annotations(self) -> bytes:
        """The surface's truth, see `mmt.testing.simulation.surfaces.surface`."""
        return self._surface.annotations()

    def describe(self) -> str:
        """Return one line for the person who starts the follower."""
        return (
            f"simulated robot of {self._settings.robot_bandwidth_hz:g} Hz on "
            f"{self._surface.name} of {self._settings.surface_stiffness_n_mm:g} N/mm, "
            f"{'noisy' if self._settings.noise else 'exact'} sensors"
        )

    def close(self) -> None:
        """Do nothing: there is no device."""
