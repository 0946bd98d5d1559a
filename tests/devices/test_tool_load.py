"""The load of a tool is found from poses at rest, and taken out of the force however it tilts."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from instruments import Instrument
from scipy.spatial.transform import Rotation

from mmt.cli.device import calibrating
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import ALL_CHANNELS, CHANNELS, empty_frames
from mmt.devices.streaming.source import DeviceSource
from mmt.devices.streaming.tool_load import (
    LoadRemover,
    Pose,
    ToolLoad,
    identify,
    load_from,
    measure_pose,
)
from mmt.scene.files import scene_from_tables

GRAVITY = 9.80665
POSES = np.vstack([np.eye(3), -np.eye(3)])


def vector(values):
    x, y, z = values.tolist()
    return x, y, z


class Tool:
    """A tool of 120 g; both sensors are fixed to it, the accelerometer at its centre of mass."""

    def __init__(self, mass_kg=0.12, noise=0.0, seed=1):
        self.mass_kg = mass_kg
        self.turned = Rotation.from_euler("xyz", [20.0, -50.0, 110.0], degrees=True)
        self.up = np.array([0.0, 0.0, 1.0])
        self.acceleration = np.zeros(3)
        self.contact = np.zeros(3)
        self._noise, self._random = noise, np.random.default_rng(seed)

    def proper(self):
        """Return what the accelerometer measures, in its own axes."""
        true = self.turned.inv().apply(GRAVITY * self.up + self.acceleration)
        return vector(true + self._noise * self._random.standard_normal(3))

    def force(self):
        """Return what the force sensor measures, with an offset of its own."""
        load = -self.mass_kg * (GRAVITY * self.up + self.acceleration)
        noise = 0.1 * self._noise * self._random.standard_normal(3)
        return vector(self.contact + load + np.array([0.5, -0.2, 3.0]) + noise)

    def poses(self, ups=POSES):
        """Return the tool's poses with these axes up."""
        found = []
        for self.up in ups:
            found.append(Pose(self.force(), self.proper()))
        return found


class Sensor(Instrument):
    """A polled sensor of a tool, without or with its bias taken."""

    def __init__(self, read, *, takes_bias=False):
        super().__init__()
        self._read, self._takes_bias = read, takes_bias
        self._bias = np.zeros(3)

    def calibrate(self):
        if self._takes_bias:
            self._bias = np.array(self._read())

    def read(self):
        return vector(np.array(self._read()) - self._bias)


@given(
    st.floats(0.02, 5.0),
    st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3),
)
def test_mass_and_rotation_are_found_from_any_tool(mass_kg, angles, offset):
    turn = Rotation.from_euler("xyz", angles, degrees=True)
    poses = [
        Pose(
            vector(np.array(offset) - mass_kg * GRAVITY * turn.apply(up)),
            vector(GRAVITY * up),
        )
        for up in POSES
    ]
    load = identify(poses)
    assert load.mass_kg == pytest.approx(mass_kg, rel=1e-9)
    np.testing.assert_allclose(load.rotation, turn.as_matrix(), atol=1e-8)
    assert load.residual_n < 1e-9
    assert load_from(load.as_dict()) == load


def test_the_surfaces_force_is_left_while_the_tool_tilts_and_shakes():
    """120 g, tilted to 60 degrees, shaken with 10 m/s2, noise as of an ADXL335."""
    tool = Tool(noise=0.06)
    load = identify(tool.poses())
    assert load.mass_kg == pytest.approx(0.12, rel=0.02)
    assert 0.0 < load.residual_n < 0.05
    tool.up = np.array([0.0, 0.0, 1.0])
    devices = Sensor(lambda: (0.0,) * 3), Sensor(tool.force, takes_bias=True), Sensor(tool.proper)
    source = DeviceSource(*devices, CHANNELS, tool=LoadRemover(load))
    source.start(0)
    off = []
    for tick in range(1500):
        angle = math.radians(60.0) * math.sin(2e-3 * math.pi * tick)
        tool.up = np.array([0.0, math.sin(angle), math.cos(angle)])
        tool.acceleration = np.array([0.0, 3.0, 10.0 * math.sin(0.03 * tick)])
        tool.contact = np.array([0.3, 0.0, 1.0 + math.sin(0.01 * tick)])
        (frame,) = source.step(1, 10**6 * tick, None)
        off.append(frame["force_n"] - tool.contact)
    assert np.sqrt(np.mean(np.square(off), axis=0)).max() < 0.05


def test_the_normal_force_of_a_tilting_tool_is_found_by_its_orientation():
    """As before, but both sensors turn with the tool, and begin tilted by 20 degrees."""
    tool = Tool(noise=0.06)
    tool.turned = Rotation.identity()  # the sensors' options say how they are mounted
    load = identify(tool.poses())
    tilt = Rotation.from_euler("xyz", [20.0, 0.0, 5.0], degrees=True)
    arm = Sensor(lambda: (0.0, 0.0, 0.0))
    arm.orientation = lambda: tuple(np.roll(tilt.as_quat(), 1).tolist())
    tool.up = tilt.inv().apply([0.0, 0.0, 1.0])
    sensors = Sensor(tool.force, takes_bias=True), Sensor(tool.proper)
    turned = ("force", "acceleration")
    source = DeviceSource(arm, *sensors, ALL_CHANNELS, tool=LoadRemover(load), tool_axes=turned)
    source.start(0)
    off_n = []
    for tick in range(1500):
        angle = 60.0 * math.sin(2e-3 * math.pi * tick)
        tilt = Rotation.from_euler("xyz", [angle, 0.3 * angle, 2.0 * angle], degrees=True)
        shaken = np.array([0.0, 3.0, 10.0 * math.sin(0.03 * tick)])
        contact = np.array([0.3, 0.0, 3.0 + math.sin(0.01 * tick)])
        tool.up, tool.acceleration, tool.contact = (
            tilt.inv().apply(each) for each in ([0.0, 0.0, 1.0], shaken, contact)
        )
        (frame,) = source.step(1, 10**6 * tick, None)
        off_n.append(frame["force_n"][2] - contact[2])
        proper = shaken + np.array([0.0, 0.0, GRAVITY])
        np.testing.assert_allclose(frame["acceleration_m_s2"], proper, atol=0.5)
    assert np.sqrt(np.mean(np.square(off_n))) < 0.05


@pytest.mark.parametrize("samples", [1, 10])
def test_the_newest_sample_of_a_frame_counts(samples):
    frames = empty_frames(2, CHANNELS, samples)
    frames["acceleration_m_s2"].reshape(2, samples, 3)[:, -1] = [[0.0, 0.0, 9.8], [1.0, 0.0, 9.8]]
    identity = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    remover = LoadRemover(ToolLoad(0.5, identity))
    remover.learn_rest(Sensor(lambda: (0.0, 0.0, 9.8)))
    remover.remove(frames)
    np.testing.assert_allclose(frames["force_n"], [[0.0] * 3, [0.5, 0.0, 0.0]], atol=1e-6)


def test_poses_that_do_not_determine_a_load_are_refused_with_the_reason():
    poses = Tool().poses()
    tetrahedron = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3.0)
    assert identify(Tool().poses(tetrahedron)).mass_kg == pytest.approx(0.12)
    cone = np.array([[0.35, 0, 1], [-0.35, 0, 1], [0, 0.35, 1], [0, -0.35, 1], [0, 0, 1]])
    narrow = cone / np.linalg.norm(cone, axis=1, keepdims=True)

    def third(force_n):
        return [*poses[:2], poses[2]._replace(force_n=force_n), *poses[3:]]

    for wrong, words in (
        (Tool().poses(narrow), r"5 poses, too alike: .* down, six poses are best$"),
        (poses[:3], "3 poses, too alike"),
        ([], "0 poses, too alike"),
        ([poses[number] for number in (0, 1, 3, 4)], "4 poses, too alike"),
        (third((0.0, 0.0, 0.0)), r"pose 3 is \d\.\d\d N off the load of \d+ g that "),
        (third((0.8, -0.2, 1.8)), r"the load of 1\d\d g that .* is not fixed to the tool$"),
        (Tool(mass_kg=0.004).poses(), r"by 0\.039 N .* sensor carries no tool, or does"),
        (
            [pose._replace(proper_acceleration_m_s2=(0.0, 0.0, 5.0)) for pose in poses],
            r"pose 1: the accelerometer feels 5\.00 m/s2 at rest",
        ),
    ):
        with pytest.raises(InputError, match=words):
            identify(wrong)


def test_a_stored_load_that_is_damaged_is_refused():
    stored = identify(Tool().poses()).as_dict()
    rotations = (
        [[1, 0, 0], [0, 1, 0], [0, 0, math.nan]],
        [[math.inf, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[1, 0.001, 0], [0, 1, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0]],
        [[2, 0, 0], [0, 1, 0], [0, 0, 1]],
    )
    for damage in (
        *({"mass_kg": mass_kg} for mass_kg in (-1.0, math.nan, 0.0, 100.0)),
        *({"rotation": rotation} for rotation in rotations),
        {"residual_n": "much"},
        *({"centre_m": c} for c in ([0.0, math.nan, 0.0], [1.0], "there", [math.inf] * 3)),
    ):
        with pytest.raises(InputError, match="calibrate again with mmt device calibrate"):
            load_from(stored | damage)


def test_a_tool_that_moves_or_a_silent_sensor_is_no_pose():
    tool = Tool()

    def swung():
        tool.acceleration = tool.acceleration + 0.5
        return tool.proper()

    with pytest.raises(InputError, match=r"the tool moved .* by \d.* still and measure again$"):
        measure_pose(Sensor(tool.force), Sensor(swung), 0.2)
    still = Tool(noise=0.01)
    began = time.monotonic()
    found = measure_pose(Sensor(still.force), Sensor(still.proper), 0.1)
    assert 0.1 <= time.monotonic() - began < 5.0
    np.testing.assert_allclose(found.force_n, [0.5, -0.2, 3.0 - 0.12 * GRAVITY], atol=0.01)
    np.testing.assert_allclose(found.proper_acceleration_m_s2, still.proper(), atol=0.1)
    silent = Sensor(tool.proper)
    silent.latency_ns, silent.read = 0, lambda: None
    with pytest.raises(MmtError, match=r"^accelerometer: 0 readings came in 0\.1 s"):
        measure_pose(Sensor(tool.force), silent, 0.1)


def test_a_tool_without_both_sensors_or_with_a_driver_is_refused():
    robot = Sensor(lambda: (0.0, 0.0, 0.0))
    remover = LoadRemover(identify(Tool().poses()))
    with pytest.raises(InputError, match="must need force and acceleration"):
        DeviceSource(robot, robot, robot, ("position", "force"), tool=remover)
    with pytest.raises(MmtError, match=r"accelerometer \(Sensor\) failed: division"):
        DeviceSource(robot, robot, Sensor(lambda: 1 / 0), CHANNELS, tool=remover).open()
    devices = {"robot": "virtual-phantom", "force_sensor": "virtual-net-ft", "tool": "probe"}
    with pytest.raises(InputError, match="needs a force_sensor and an accelerometer"):
        scene_from_tables({"link": {}, "devices": devices, "texture": {}})
    with pytest.raises(InputError, match="virtual-adxl335 is a driver"):
        calibrating.calibrate_tool("virtual-adxl335", [], "probe", 0.2, None)
    with pytest.raises(InputError, match="a scene has its own"):
        calibrating.calibrate_tool("virtual-lab", ["port=x"], "probe", 0.2, None)
