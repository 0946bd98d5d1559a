"""The interface of a follower's source, and the source of a scene; no other one is imported."""

from typing import TYPE_CHECKING, Protocol

from mmt.core.arrays import RecordArray, Vector
from mmt.core.errors import InputError
from mmt.scene import Devices, Replay, Scene, Simulated

if TYPE_CHECKING:
    from mmt.devices.streaming.tool_load import LoadRemover
    from mmt.testing.simulation.surfaces.course import SurfaceCourse
    from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface


class FollowerSource(Protocol):
    """The source of a follower's frames: real devices, a simulation or a recorded session."""

    def start(self, start_time_ns: int) -> None:
        """Begin at the follower's monotonic time of the first tick.

        A source without a clock of its own stamps frame k with ``start_time_ns`` plus k
        periods; one that reads devices stamps the time of the reading.
        """

    def step(self, elapsed: int, now_ns: int, command_position_mm: Vector | None) -> RecordArray:
        """Return the frames of the ticks that passed since the last call.

        Parameters
        ----------
        elapsed
            Ticks since the last call, at least 1; more than 1 after missed ticks.
        now_ns
            The follower's monotonic time.
        command_position_mm
            The newest motion command, repeated until the next one; None before the first.

        Returns
        -------
        frames
            Shape (n,), the scene's frame dtype; n equals `elapsed` unless the source
            ends or lacks frames.
        """

    @property
    def finished(self) -> bool:
        """Whether no further frame will come."""

    @property
    def annotations(self) -> bytes:
        """Opaque bytes that the leader stores in the recording, such as the simulated truth."""

    def describe(self) -> str:
        """Return one line about the source for the user who starts the follower."""

    def close(self) -> None:
        """Release all resources of the source; calling it twice is harmless."""


def build_source(scene: Scene) -> FollowerSource:
    """Return the scene's source.

    Raises
    ------
    InputError
        The scene has no source, or its file, surface or device cannot be used.
    """
    if scene.simulated is not None:
        return _simulated(scene, scene.simulated)
    if scene.replay is not None:
        return _replay(scene, scene.replay)
    if scene.devices is not None:
        return _devices(scene, scene.devices)
    raise InputError("the scene has no follower: add one of [simulated], [replay], [devices]")


def _simulated(scene: Scene, table: Simulated) -> FollowerSource:
    from mmt.testing.simulation.follower import SimulatedFollower
    from mmt.testing.simulation.surfaces.textures import get_surface

    session = scene.session
    surface: KnownSurface | SurfaceCourse
    rate_hz = float(session.acceleration_rate_hz)
    if table.course is None:
        surface = get_surface(table.surface, rate_hz)
    else:
        from mmt.testing.simulation.surfaces.course import surface_of

        surface = surface_of(table, session.duration_s, session.seed, rate_hz)
    return SimulatedFollower(table, channels=scene.channels(), seed=session.seed, surface=surface)


def _replay(scene: Scene, table: Replay) -> FollowerSource:
    if table.file is None:
        raise InputError("[replay] names no file: set its key 'file' or give --replay FILE")
    from mmt.session.files import read_session
    from mmt.session.replay import ReplaySource

    return ReplaySource(
        read_session(table.file),
        channels=scene.channels(),
        speed=table.speed,
        loop=table.loop,
        gaps=table.gaps,
        samples_per_frame=scene.session.samples_per_frame,
    )


def _devices(scene: Scene, table: Devices) -> FollowerSource:
    from mmt.devices.drivers import load_device
    from mmt.devices.streaming.source import DeviceSource

    force, acceleration = table.force_sensor, table.accelerometer
    return DeviceSource(
        load_device(table.robot.driver, table.robot.options, role="robot"),
        load_device(force.driver, force.options, role="force_sensor") if force else None,
        load_device(acceleration.driver, acceleration.options, role="accelerometer")
        if acceleration
        else None,
        scene.channels(),
        on_lost=table.on_lost,
        samples_per_frame=scene.session.samples_per_frame,
        tool=None if table.tool is None else _load_remover(table.tool),
        tool_axes=table.tool_axes or (),
    )


def _load_remover(name: str) -> "LoadRemover":
    from mmt.devices.calibrations import load_calibration
    from mmt.devices.streaming.tool_load import CALIBRATED_AS, LoadRemover, load_from

    stored = load_calibration(CALIBRATED_AS, name)
    if stored is None:
        raise InputError(
            f"[devices] tool = {name!r} was never calibrated on this machine: hold it in six poses "
            f"with: mmt device calibrate SCENE --tool {name}"
        )
    return LoadRemover(load_from(stored))
