"""Build the source that a scene names; the other two are not even imported."""

from mmt.core.errors import InputError
from mmt.devices.protocols import FollowerSource
from mmt.scene import Devices, Replay, Scene, Simulated


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
    from mmt.testing.simulation.course import SurfaceCourse
    from mmt.testing.simulation.follower import SimulatedFollower

    session = scene.session
    course = SurfaceCourse.of(table, session.duration_s, session.seed)
    return SimulatedFollower(table, channels=scene.channels(), seed=session.seed, surface=course)


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
    )


def _devices(scene: Scene, table: Devices) -> FollowerSource:
    from mmt.devices.drivers import load_device
    from mmt.devices.source import DeviceSource

    force, acceleration = table.force_sensor, table.accelerometer
    return DeviceSource(
        load_device(table.robot.driver, table.robot.options, role="robot"),
        load_device(force.driver, force.options, role="force_sensor") if force else None,
        load_device(acceleration.driver, acceleration.options, role="accelerometer")
        if acceleration
        else None,
        scene.channels(),
        on_lost=table.on_lost,
    )
