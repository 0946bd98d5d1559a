"""The orientation of a tool: in frames, and used to turn what sensors in its axes measure."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from instruments import Instrument
from scipy.spatial.transform import Rotation, Slerp
from synthetic_sensors import MS, START_NS

from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, FIELD_OF_CHANNEL, empty_frames
from mmt.core.quaternions import (
    product,
    quaternion_of_axes,
    quaternion_of_vector,
    unit_quaternion,
)
from mmt.core.rotations import rotation_matrices, turn_into_scene, without_flips
from mmt.devices.axes import Axes
from mmt.devices.streaming.lanes import OrientationLane, Waiting
from mmt.devices.streaming.source import DeviceSource
from mmt.scene import Scene

vectors = st.tuples(*[st.floats(-4.0, 4.0)] * 3)
NO_NUMBER = (math.nan, 0.0, 0.0, 0.0)


def rotation(quaternion):
    return Rotation.from_quat(np.roll(quaternion, -1))


def alike(first, second, degrees=1e-5):
    return bool(np.degrees((first * second.inv()).magnitude()) < degrees)


class Arm(Instrument):
    """A robot with a tool that turns, which measures no more than that."""

    def __init__(self, turn):
        super().__init__()
        self.orientation = turn


@given(vectors, vectors)
def test_quaternions_are_those_of_an_independent_library(a, b):
    first, second = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    assert alike(rotation(quaternion_of_vector(a)), first)
    of_axes = quaternion_of_axes(*map(tuple, first.as_matrix().T))
    assert alike(rotation(of_axes), first)
    assert math.hypot(*of_axes) == pytest.approx(1.0)
    both = product(quaternion_of_vector(b), quaternion_of_vector(a))
    assert alike(rotation(both), second * first)
    assert unit_quaternion([1.009 * each for each in both]) == pytest.approx(both)
    matrices = rotation_matrices(np.array([both]))
    np.testing.assert_allclose(matrices, [(second * first).as_matrix()], atol=1e-12)


@given(st.permutations("xyz"), st.tuples(*[st.sampled_from(["", "-"])] * 3), vectors)
def test_a_drivers_axes_turn_an_orientation_as_they_turn_vectors(names, signs, turn):
    try:
        axes = Axes(",".join(map("".join, zip(signs, names, strict=True))))
    except ValueError:  # mirrored
        return
    tool = Rotation.from_rotvec(turn)
    found = rotation(axes.turn_in_scene(quaternion_of_vector(turn)))
    expected = [axes.to_scene(tool.apply(vector)) for vector in np.eye(3)]
    np.testing.assert_allclose(found.apply(np.eye(3)), expected, atol=1e-9)


@pytest.mark.parametrize("off", [NO_NUMBER, (math.inf, 0, 0, 0), (0.0,) * 4, (0.98, 0.0, 0.0, 0.0)])
def test_what_is_no_unit_quaternion_is_found(off):
    assert unit_quaternion(off) is None
    assert unit_quaternion((0.0, 1.009, 0.0, 0.0)) == (0.0, 1.0, 0.0, 0.0)
    for wrong in (math.nan, math.inf, 2.0):
        axes = quaternion_of_axes((wrong, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        assert unit_quaternion(axes) is None
        if not math.isfinite(wrong):
            assert unit_quaternion(quaternion_of_vector((wrong, 0.0, 0.0))) is None


@given(vectors, vectors, st.floats(0.0, math.radians(20.0)), st.booleans(), st.floats(0.0, 1.0))
def test_between_two_orientations_lies_one_near_the_rotation_at_constant_speed(
    start, axis, angle, flips, share
):
    span = np.array(axis) * (angle / max(float(np.linalg.norm(axis)), 1e-9))
    first = Rotation.from_rotvec(start)
    last = Rotation.from_rotvec(span) * first
    lane = OrientationLane()
    lane.record(quaternion_of_vector(start), START_NS)
    x, y, z, w = last.as_quat() * (-1.0 if flips else 1.0)
    lane.record((w, x, y, z), START_NS + 5 * MS)
    found = lane.at(START_NS + round(5 * MS * share))
    assert isinstance(found, tuple)
    assert math.hypot(*found) == pytest.approx(1.0, abs=1e-12)
    exact = Slerp([0.0, 1.0], Rotation.concatenate([first, last]))(share)
    assert alike(rotation(found), exact, 0.01)


def test_a_lane_gives_nothing_outside_in_long_gaps_and_beside_what_is_invalid():
    lane = OrientationLane()
    assert isinstance(lane.at(START_NS), Waiting)
    turn = (1.0, 0.0, 0.0, 0.0)
    for at_ms, value in ((0, turn), (50, turn), (101, turn), (102, NO_NUMBER), (103, turn)):
        lane.record(value, START_NS + at_ms * MS)
    found = [lane.at(START_NS + round(at_ms * MS)) for at_ms in (-1, 25, 75, 101, 101.5, 102, 103)]
    assert found == [None, turn, None, turn, None, None, turn]
    assert lane.invalid == 1
    assert isinstance(lane.at(START_NS + 104 * MS), Waiting)


def test_an_orientation_that_is_none_makes_a_gap_and_no_force():
    turns = [(1.0, 0.0, 0.0, 0.0), NO_NUMBER, (0.5, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.004)]
    devices = Arm(iter(turns).__next__), Instrument(20.0), Instrument(30.0)
    source = DeviceSource(*devices, ALL_CHANNELS, tool_axes=("force", "acceleration"))
    source.start(0)
    frames = np.concatenate([source.step(1, MS * tick, None) for tick in range(4)])
    assert frames["sequence"].tolist() == [0, 3]
    assert frames["orientation"].tolist() == [[1, 0, 0, 0], [0, 0, 0, 1]]
    assert frames["force_n"].tolist() == [[20, 21, 22], [-20, -21, 22]]
    assert frames["acceleration_m_s2"][1].tolist() == [-30, -31, 32]
    assert source.summary["robot"]["faults"]["invalid_orientations"] == 2


@pytest.mark.parametrize("samples", [1, 10])
@given(st.lists(vectors, min_size=1, max_size=5), st.integers(0, 2**31))
def test_every_vector_of_a_frame_is_turned(samples, turns, seed):
    frames = empty_frames(len(turns), ALL_CHANNELS, samples)
    for channel in ("force", "acceleration"):
        field = frames[FIELD_OF_CHANNEL[channel]]
        field[...] = np.random.default_rng(seed).normal(size=field.shape)
    frames["orientation"] = list(map(quaternion_of_vector, turns))
    before = frames.copy()
    turn_into_scene(frames, ("force", "acceleration"))
    for row, turn in enumerate(map(Rotation.from_rotvec, turns)):
        for field in ("force_n", "acceleration_m_s2"):
            expected = turn.apply(before[field][row].reshape(-1, 3))
            np.testing.assert_allclose(frames[field][row].reshape(-1, 3), expected, atol=1e-5)
    unit, turned, end = [1.0, 0.0, 0.0, 0.0], [0.6, 0.8, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]
    flipped = without_flips(np.array([unit, [-2.0, 0.0, 0.0, 0.0], turned, [0.0, 0.5, 0.0, 0.0]]))
    np.testing.assert_allclose(flipped, [unit, unit, turned, end], atol=1e-12)


def test_who_cannot_give_an_orientation_is_told_who_can():
    devices = Instrument(), Instrument(), Instrument()
    with pytest.raises(InputError, match=r"Instrument does not.* franka, openhaptics, .*ur, virt"):
        DeviceSource(*devices, ALL_CHANNELS)
    devices_table = {"robot": "ur", "force_sensor": "x", "accelerometer": "y"}
    scene = {"link": {}, "texture": {}, "devices": {**devices_table, "tool_axes": ["force"]}}
    with pytest.raises(ValueError, match="add orientation = true to"):
        Scene(**scene)
    with pytest.raises(ValueError, match=r"add \[devices\] or \[replay\], or leave it out"):
        Scene(session={"orientation": True})
    with pytest.raises(ValueError, match="name both in tool_axes, or neither"):
        Scene(**{**scene, "devices": {**scene["devices"], "tool": "probe"}})
    assert Scene(**scene, session={"orientation": True}).channels() == ALL_CHANNELS
    plain = Scene(**{**scene, "devices": devices_table})
    assert plain.channels() == ALL_CHANNELS[:3]
    assert "orientation" not in str(plain.dump())
