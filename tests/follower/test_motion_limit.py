"""The robot stays in its workspace, and its acceleration is bounded, whatever is commanded."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.follower.guarded_source import MotionLimit
from mmt.scene import Simulated

BOX_MM = ((-50.0, -40.0, -10.0), (50.0, 60.0, 80.0))
NAN = (math.nan, 0.0, 0.0)


def limited(speed_mm_s=1000.0, rate_hz=1000.0, **keys):
    return MotionLimit(Simulated(**{"workspace_mm": BOX_MM, **keys}), speed_mm_s, rate_hz)


def run(limit, wanted, elapsed=None):
    """Return the positions (n, 3); the first position wanted must be known."""
    ticks = elapsed or [1] * len(wanted)
    return np.array([limit.step(n, place) for n, place in zip(ticks, wanted, strict=True)])


inside = st.tuples(*(st.floats(low, high) for low, high in zip(*BOX_MM, strict=True)))
anywhere = st.tuples(*[st.floats(-1e6, 1e6)] * 3)
broken = st.sampled_from([None, NAN, (math.inf, -math.inf, 0.0), (0.0, math.inf, 0.0)])
stretch = st.tuples(st.one_of(inside, anywhere, broken), st.integers(1, 60))
accelerations = st.floats(100.0, 1e6)
speeds = st.floats(10.0, 10_000.0)
rates = st.sampled_from([100.0, 333.0, 1000.0, 5000.0])


@given(
    first=inside,
    stretches=st.lists(stretch, min_size=1, max_size=12),
    missed=st.lists(st.integers(0, 30), min_size=1, max_size=7),
    acceleration=accelerations,
    speed=speeds,
    rate_hz=rates,
)
def test_no_command_leaves_the_workspace_or_exceeds_a_limit(
    first, stretches, missed, acceleration, speed, rate_hz
):
    limit = limited(speed, rate_hz, acceleration_limit_mm_s2=acceleration)
    wanted = [first]
    wanted += [place for place, ticks in stretches for _ in range(ticks)]
    elapsed = [1 + missed[k % len(missed)] * (k % 5 == 4) for k in range(len(wanted))]
    places = run(limit, wanted, elapsed)
    low, high = np.array(BOX_MM)
    assert (places >= low - 1e-9).all()
    assert (places <= high + 1e-9).all()
    steps = np.diff(places, axis=0, prepend=places[:1])
    assert np.linalg.norm(steps, axis=1).max() <= speed / rate_hz * (1 + 1e-6)
    changes = np.abs(np.diff(steps, axis=0)).max(axis=1)
    most = acceleration / rate_hz**2 * np.array(elapsed[1:])
    assert (changes <= most * (1 + 1e-6) + 1e-9).all()


@given(
    path=st.lists(inside, min_size=1, max_size=40),
    goal=inside,
    acceleration=st.floats(2000.0, 1e6),
    speed=st.floats(50.0, 10_000.0),
)
@settings(max_examples=25)
def test_each_axis_passes_a_standing_target_once_at_most_and_arrives(
    path, goal, acceleration, speed
):
    """Once, where the target has jumped to where the robot could no longer stop."""
    limit = limited(speed, acceleration_limit_mm_s2=acceleration)
    before = run(limit, [place for place in path for _ in range(7)])
    fastest = min(speed / 1000.0, math.sqrt(2 * acceleration * 150) / 1000)
    slow_ticks = math.ceil(4 * fastest / (acceleration / 1e6))
    ticks = 3 * (math.ceil(200 / (speed / 1000.0)) + slow_ticks) + 2000
    places = np.concatenate([before[-1:], run(limit, [goal] * ticks)])
    for axis in range(3):
        sides = np.sign(np.round(places[:, axis] - goal[axis], 9))
        sides = sides[sides != 0]
        assert np.count_nonzero(np.diff(sides)) <= 1
    assert tuple(places[-1]) == pytest.approx(goal, abs=1e-6)


@given(start=inside, goal=inside, acceleration=accelerations, speed=speeds)
@settings(max_examples=40)
def test_from_rest_no_axis_ever_passes_the_target(start, goal, acceleration, speed):
    limit = limited(speed, acceleration_limit_mm_s2=acceleration)
    places = run(limit, [start] + [goal] * 3000)
    behind = (np.array(goal) - places) * np.sign(np.array(goal) - np.array(start))
    assert behind.min() >= -1e-9


def test_a_stop_from_full_speed_is_planned_and_exact():
    """100 mm at 10 m/s2 and 1 m/s: 100 ms to gain speed over 50 mm, 100 ms to lose it."""
    limit = limited(acceleration_limit_mm_s2=10_000.0)
    places = run(limit, [(-50.0, 0.0, 0.0)] + [(50.0, 0.0, 0.0)] * 250)[:, 0]
    speed_mm_s = 1000.0 * np.diff(places)
    assert speed_mm_s.max() == pytest.approx(1000.0, rel=0.001)
    arrived = int(np.argmax(places == 50.0))
    assert 199 <= arrived <= 201
    assert (places[arrived:] == 50.0).all()


def test_a_hand_that_one_ticks_acceleration_can_stop_is_followed_without_lag():
    limit = limited()  # 0.3 mm a tick
    path = [(0.29 * k, -0.2 * k, 0.1 * k) for k in range(100)] + [(28.71, -19.8, 9.9)] * 20
    np.testing.assert_allclose(run(limit, path), path, atol=1e-9)


@pytest.mark.parametrize("wanted", [NAN, (math.inf, -math.inf, 0.0), (0.0, math.inf, 0.0)])
def test_a_position_that_is_not_finite_stops_the_robot_as_none_does(wanted):
    path = [(0.0, 0.0, 0.0)] + [(40.0, 0.0, 0.0)] * 30
    stopped = run(limited(), [*path, *[None] * 200])
    np.testing.assert_array_equal(run(limited(), [*path, *[wanted] * 200]), stopped)


def test_a_robot_that_was_not_moved_is_assumed_to_have_slowed_down():
    limit = limited(acceleration_limit_mm_s2=5000.0)  # 0.005 mm a tick
    places = run(limit, [(0.0, 0.0, 0.0)] + [(40.0, 0.0, 0.0)] * 41, [1] * 41 + [11])
    assert np.diff(places[:, 0])[-2:] == pytest.approx([0.2, 0.2 - 10 * 0.005 + 0.005])


@pytest.mark.parametrize("sideways", [-0.04, 0.0])
def test_no_axis_gets_faster_or_turns_while_another_has_to_slow_down(sideways):
    limit = limited(workspace_mm="off", acceleration_limit_mm_s2=100_000.0)  # 0.1 mm a tick
    places = run(limit, [(0.0, 0.0, 0.0)] + [(7e4, 1e5 * sideways, 7e4)] * 20)
    here, before = places[-1], places[-1] - places[-2]
    after = limit.step(1, tuple(here + np.array([5e4, 6e3, 8e4]))) - here
    assert after == pytest.approx([before[0] - 0.1, 0.0, before[2]])


def test_at_a_low_limit_the_robot_follows_by_what_it_needs_to_stop():
    """At 100 mm/s and 5 m/s2: 1 mm."""
    limit = limited(acceleration_limit_mm_s2=5000.0)
    path = [(0.1 * k - 40.0, 0.0, 0.0) for k in range(800)]
    behind = np.array(path, dtype=float)[:, 0] - run(limit, path)[:, 0]
    assert behind[-1] == pytest.approx(1.0, rel=0.06)
    assert behind.min() >= 0.0


def test_what_is_off_does_not_bound():
    limit = limited(workspace_mm="off", acceleration_limit_mm_s2="off", speed_mm_s=10_000.0)
    path = [(0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    path += [(10.0 * k, 0.0, 0.0) for k in range(30)]
    np.testing.assert_array_equal(run(limit, path), np.array(path, dtype=float))


def test_after_a_restart_it_begins_where_the_robot_is_and_goes_no_farther_out():
    limit = limited()
    run(limit, [(0.0, 0.0, 0.0)] + [(40.0, 0.0, 0.0)] * 50)
    limit.restart()
    assert limit.step(1, None) is None
    assert limit.step(1, NAN) is None
    assert limit.step(1, (7.0, 0.0, 0.0)) == (7.0, 0.0, 0.0)
    assert 7.0 < limit.step(1, (40.0, 0.0, 0.0))[0] <= 7.3 + 1e-9
    limit.restart()  # where the robot is outside its workspace
    places = run(limit, [(70.0, 0.0, 0.0)] + [(90.0, 0.0, 0.0)] * 10 + [(0.0, 0.0, 0.0)] * 200)
    assert places[:11, 0].tolist() == [70.0] * 11
    assert (np.diff(places[:, 0]) <= 1e-9).all()
    assert tuple(places[-1]) == (0.0, 0.0, 0.0)
