"""How a tool turns is found from its orientations, and with it the force of its centre of mass."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from mmt.cli.device import calibrating
from mmt.cli.main import app
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import ALL_CHANNELS, empty_frames
from mmt.core.running.ticking import Ticker
from mmt.devices.streaming.tool_load import LoadRemover, ToolLoad, load_from, with_centre
from mmt.devices.streaming.tool_turning import DELAY, SPAN, TurningEstimator
from mmt.follower.sources import build_source
from mmt.scene.files import load_scene

GRAVITY = 9.80665
BIAS_N = np.array([0.2, -0.4, 1.5])
ARM_M = np.array([0.05, -0.03, 0.08])
UNTURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
LOAD = ToolLoad(0.12, UNTURNED)


def quaternions(turns):
    return np.roll(turns.as_quat(), 1, axis=-1)


@given(
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: math.hypot(*axis) > 0.1),
    began=st.tuples(*[st.floats(-1.8, 1.8)] * 3),
    rad_s=st.floats(-10.0, 10.0),
    rad_s2=st.floats(-300.0, 300.0),
    missing=st.sets(st.integers(SPAN, 2 * SPAN - 2), max_size=12),
    flips=st.sets(st.integers(0, 2 * SPAN)),
)
def test_constant_angular_acceleration_is_found_exactly(axis, began, rad_s, rad_s2, missing, flips):
    """Whatever the orientation, the side of the quaternions, and with frames missing."""
    unit = np.array(axis) / math.hypot(*axis)
    times_s = 1e-3 * np.arange(2 * SPAN)
    angles = rad_s * times_s + 0.5 * rad_s2 * times_s**2
    turned = quaternions(Rotation.from_rotvec(began) * Rotation.from_rotvec(angles[:, None] * unit))
    estimator, turning = TurningEstimator(), None
    for number, quaternion in enumerate(turned):
        if number not in missing:
            turning = estimator.step(number, -quaternion if number in flips else quaternion)
    at_s = times_s[-1 - DELAY]
    np.testing.assert_allclose(turning.velocity, (rad_s + rad_s2 * at_s) * unit, atol=1e-6)
    np.testing.assert_allclose(turning.acceleration, rad_s2 * unit, atol=1e-4)
    place = np.array([0.3, -0.1, 0.2])
    expected = np.cross(turning.acceleration, place) + np.cross(
        turning.velocity, np.cross(turning.velocity, place)
    )
    np.testing.assert_allclose(turning.matrix() @ place, expected, atol=1e-9)


def test_there_is_no_estimate_before_half_of_the_frames_or_after_they_begin_anew():
    estimator, still = TurningEstimator(), np.array([1.0, 0.0, 0.0, 0.0])
    first = [estimator.step(number, still) is not None for number in range(SPAN)]
    assert first == [False] * DELAY + [True] * (SPAN - DELAY)
    assert estimator.step(3 * SPAN, still) is None, "a gap"
    for number in range(4 * SPAN, 5 * SPAN):
        estimator.step(number, still)
    assert estimator.step(5 * SPAN - 1, still) is None, "begun anew, if only by one frame"


def turned_frames(turns, *, contact_n=0.0, noise_m_s2=0.06):
    """Return frames of a tool with these rotation vectors (n, 3), and its rotations' matrices."""
    count, random = len(turns), np.random.default_rng(3)
    rotations = Rotation.from_rotvec(turns)
    matrices = rotations.as_matrix()
    centre = matrices @ ARM_M  # the accelerometer stands still, gravity aside
    of_centre = np.gradient(np.gradient(centre, 1e-3, axis=0), 1e-3, axis=0)
    up = np.array([0.0, 0.0, GRAVITY])
    shaken = np.zeros((count, 3))
    shaken[:, 2] = 10.0 * np.sin(0.03 * np.arange(count))
    frames = empty_frames(count, ALL_CHANNELS)
    frames["sequence"] = np.arange(count)
    frames["orientation"] = quaternions(rotations)
    frames["acceleration_m_s2"] = np.einsum("nji,nj->ni", matrices, up + shaken)
    frames["acceleration_m_s2"] += noise_m_s2 * random.standard_normal((count, 3))
    load = -0.12 * np.einsum("nji,nj->ni", matrices, up + shaken + of_centre)
    frames["force_n"] = load + BIAS_N
    frames["force_n"][: count // 2, 0] += contact_n
    return frames, matrices


def swung(count, degrees, hz=1.0):
    times_s = 1e-3 * np.arange(count)
    phases = 2.0 * np.pi * hz * times_s[:, None] * [1.0, 1.3, 0.8]
    return np.radians(degrees) * np.sin(phases)


def test_the_centre_of_mass_is_found_from_a_tool_that_is_turned():
    frames, _ = turned_frames(swung(6000, (50.0, 40.0, 60.0)))
    found = with_centre(LOAD, frames)
    assert found.centre_m is not None
    np.testing.assert_allclose(found.centre_m, ARM_M, atol=0.002)
    assert load_from(found.as_dict()) == found
    assert load_from(LOAD.as_dict()).centre_m is None
    lossy = with_centre(LOAD, frames[np.random.default_rng(1).random(6000) > 0.1])
    np.testing.assert_allclose(lossy.centre_m or (), ARM_M, atol=0.002)


def test_with_the_centre_of_mass_turning_leaves_no_force():
    """120 g at 10 cm from the accelerometer, tilted by 60 degrees, shaken with 10 m/s2."""
    frames, matrices = turned_frames(swung(3000, (60.0, 18.0, 40.0), 0.7))
    left = {}
    for name, centre_m in (("known", tuple(ARM_M.tolist())), ("unknown", None)):
        remover = LoadRemover(ToolLoad(0.12, UNTURNED, centre_m=centre_m))
        freed = frames.copy()
        for start in range(0, len(freed), 7):  # as many at once as come
            remover.remove(freed[start : start + 7])
        force = np.einsum("nij,nj->ni", matrices, freed["force_n"] - BIAS_N)
        left[name] = float(np.sqrt(np.mean(np.square(force[SPAN:, 2]))))
    assert left["known"] < 0.05 < 0.15 < left["unknown"]


@pytest.mark.parametrize(
    ("degrees", "contact_n", "reason"),
    [
        ((0.0, 0.0, 0.0), 0.0, "turned too little to tell its centre of mass within 10 mm"),
        ((0.0, 60.0, 0.0), 0.0, "turned too little .* about each of its axes"),
        ((50.0, 40.0, 60.0), 1.0, r"the force is 0\.\d\d N rms off .* something touched it"),
    ],
)
def test_a_tool_that_is_hardly_turned_or_touched_is_refused(degrees, contact_n, reason):
    frames, _ = turned_frames(swung(4000, degrees), contact_n=contact_n)
    with pytest.raises(InputError, match=reason):
        with_centre(LOAD, frames)
    with pytest.raises(InputError, match="turned too little"):
        with_centre(LOAD, frames[:10])


class LiveTool:
    """A tool in the hand, held in poses or turned. Its time is that of the ticks."""

    def __init__(self):
        self.pose = np.array([0.0, 0.0, 1.0])
        self.turns = False
        self.now_s = 0.0

    def rotation(self, shift_s=0.0):
        """Return the rotation from the tool's axes to the scene's."""
        phases = 2.0 * math.pi * (self.now_s + shift_s) * np.array([1.0, 1.3, 0.8])
        return Rotation.from_rotvec(np.radians([50.0, 40.0, 60.0]) * np.sin(phases))

    def proper(self):
        """Return what the accelerometer measures: it stands still."""
        if not self.turns:
            return tuple((GRAVITY * self.pose).tolist())
        return tuple(self.rotation().inv().apply([0.0, 0.0, GRAVITY]).tolist())

    def force(self):
        """Return what the force sensor measures of the centre of mass."""
        proper = np.array(self.proper())
        if self.turns:
            before, now, after = (
                self.rotation(shift_s).apply(ARM_M) for shift_s in (-1e-3, 0, 1e-3)
            )
            proper = proper + self.rotation().inv().apply((before - 2.0 * now + after) / 1e-6)
        return tuple((BIAS_N - 0.12 * proper).tolist())

    def orientation(self):
        """Return the orientation that the robot measures."""
        return tuple(quaternions(self.rotation()).tolist())


SCENE = """[link]
[session]
orientation = true
[devices]
robot = "virtual-phantom"
force_sensor = "virtual-net-ft"
accelerometer = "virtual-adxl335"
tool = "probe"
tool_axes = ["force", "acceleration"]
[texture]
"""


@pytest.mark.parametrize("end", ["turned", "skipped", "lost"])
def test_the_command_asks_to_turn_the_tool_of_a_scene_with_its_orientation(
    tmp_path, monkeypatch, end
):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (tmp_path / "lab.toml").write_text(SCENE, encoding="utf-8")
    tool, prompts = LiveTool(), []

    def device(driver, options, *, role):
        if role == "robot" and end == "lost":
            raise MmtError("the robot does not answer")
        read = {"robot": tool.orientation, "force_sensor": tool.force}.get(role, tool.proper)
        nothing = dict.fromkeys(("connect", "close", "calibrate"), lambda: None)
        return SimpleNamespace(read=read, orientation=tool.orientation, **nothing)

    def prompt(text, **_):
        prompts.append(text)
        tool.turns = "turn it free" in text
        if not tool.turns:
            tool.pose = np.vstack([np.eye(3), -np.eye(3)])[len(prompts) - 1]
        return "s" if text.startswith("pose 2") or (tool.turns and end == "skipped") else ""

    class Counted(Ticker):
        def __init__(self, period_ns, callback, **more):
            def tick(elapsed):
                tool.now_s += 1e-9 * period_ns * elapsed
                callback(elapsed)

            super().__init__(period_ns, tick, **more)

    monkeypatch.setattr(calibrating, "Ticker", Counted)
    monkeypatch.setattr(calibrating, "load_device", device)
    monkeypatch.setattr("mmt.cli.common.typer.prompt", prompt)
    arguments = ["device", "calibrate", str(tmp_path / "lab.toml"), "--tool", "probe"]
    run = CliRunner().invoke(app, [*arguments, "--duration", "0.5"])
    assert isinstance(run.exception, MmtError if end == "lost" else type(None)), run.output
    assert ["pose" in text for text in prompts[:7]] == [True] * 6 + [False]
    stored = json.loads((tmp_path / "mmt-haptics/calibrations/tool-probe.json").read_text())
    assert load_from(stored).mass_kg == pytest.approx(0.12, rel=0.01)
    assert (load_from(stored).centre_m is None) == (end != "turned")
    if end == "turned":
        assert "centre" in run.output
        np.testing.assert_allclose(load_from(stored).centre_m or (), ARM_M, atol=0.01)
        build_source(scene := load_scene(tmp_path / "lab.toml"))  # finds what was stored
        (tmp_path / "mmt-haptics/calibrations/tool-probe.json").unlink()
        with pytest.raises(InputError, match="'probe' was never calibrated on this machine"):
            build_source(scene)
