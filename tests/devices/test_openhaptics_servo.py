"""The servo callback by itself, with a clock and a device that the test moves."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.devices.axes import Axes
from mmt.devices.openhaptics.library import (
    CONTINUE,
    CURRENT_POSITION,
    DONE,
    SENTENCES,
    HdError,
    explain,
    only_force,
)
from mmt.devices.openhaptics.options import HdRobotOptions
from mmt.devices.openhaptics.robot import PositionServo
from mmt.devices.openhaptics.servo import STUCK
from mmt.devices.reading_checks import JUMP, NOT_FINITE, OUT_OF_REACH

TICK_S = 1e-3


class Frame:
    """A mass on one axis, moved exactly from tick to tick, in the place of the library."""

    def __init__(self, mass_kg=0.1, late_ticks=0):
        self.mass, self.now_ns = mass_kg, 0
        self.seen = [(0.0, 0.0)] * (late_ticks + 1)
        self.x = self.v = self.f = 0.0  # m, m/s, N
        self.errors = []

    def hdBeginFrame(self, handle):  # noqa: N802
        self.now_ns += 1_000_000
        self.x += self.v * TICK_S + self.f / self.mass * TICK_S**2 / 2
        self.v += self.f / self.mass * TICK_S
        self.seen = [*self.seen[1:], (self.x, self.v)]

    def hdGetDoublev(self, what, values):  # noqa: N802
        values[0] = 1e3 * self.seen[0][0 if what.value == CURRENT_POSITION else 1]

    def hdSetDoublev(self, what, values):  # noqa: N802
        self.f = values[0]
        assert math.hypot(*values[:]) <= 3.0 + 1e-9

    def hdEndFrame(self, handle):  # noqa: N802
        pass

    def hdGetError(self):  # noqa: N802
        from mmt.devices.openhaptics.library import ErrorInfo

        return ErrorInfo(*self.errors.pop()) if self.errors else ErrorInfo()


def servo(frame, limit_n=3.0, **options):
    """Return a servo at the frame's time, also with options that no scene may have."""
    given = {**HdRobotOptions().model_dump(), **options}
    made = PositionServo(frame, frame, 0, HdRobotOptions.model_construct(**given), limit_n)
    made.clock = lambda: frame.now_ns
    made.tick_ns = 0
    return made


def commanded(frame, made, ticks, x_mm=5.0):
    """Return the force of each tick, with a command at each of them."""
    forces = []
    for _ in range(ticks):
        made.target = [x_mm, 0.0, 0.0]
        made.command_ns = frame.now_ns
        made.tick(None)
        forces.append(frame.f)
    return forces


def loudest_n(frame, made, ticks):
    """Return the largest force at the end, which an unstable loop drives to its limit.

    One that throws the mass faster than an arm moves gets no force any more, and is unstable.
    """
    settled_mm(frame, made, ticks)
    least = made.limit_n if made.counts else 0.0
    return max(least, *map(abs, commanded(frame, made, 300, 1.0)))


def settled_mm(frame, made, ticks=3000):
    """Return how far the mass still swings around its target at the end."""
    largest = 0.0
    for tick in range(ticks):
        made.target = [1.0, 0.0, 0.0]
        made.command_ns = frame.now_ns
        assert made.tick(None) == CONTINUE
        if tick > ticks - 300:
            largest = max(largest, abs(1e3 * frame.x - 1.0))
    return largest


@pytest.mark.parametrize("late_ticks", [0, 1])
@pytest.mark.parametrize("mass_kg", [0.03, 0.3])
def test_damping_is_bounded_from_below_and_above_by_sampling(mass_kg, late_ticks):
    """The oracle is algebra on the exactly sampled mass, not a simulation.

    Without delay Jury's test gives k T / 2 < b < 2 m / T. With measurements that are a tick old
    the roots of z (z - 1)^2 + ((T^2 / 2m) k + (T / m) b) z + ((T^2 / 2m) k - (T / m) b) decide.
    """
    stiffness = 1000.0
    for damping in (0.25, 0.9, 1.4, 1.7, 3.0, 0.9 * mass_kg / TICK_S, 2.1 * mass_kg / TICK_S):
        a, b = TICK_S**2 / (2 * mass_kg) * stiffness, TICK_S / mass_kg * damping
        motion = np.polymul([1.0, -1.0], [1.0, -1.0])
        feedback = np.array([a + b, a - b])
        roots = np.roots(np.polyadd(np.polymul(motion, [1.0] + [0.0] * late_ticks), feedback))
        largest = abs(roots).max()
        if abs(largest - 1.0) < 5e-4:
            continue  # too near to tell in a few seconds
        frame = Frame(mass_kg, late_ticks)
        made = servo(frame, stiffness_n_mm=1.0, damping_n_s_m=damping)
        force_n = loudest_n(frame, made, 8000)
        assert (force_n < 0.2) == (largest < 1.0), (damping, largest, force_n)


@settings(max_examples=20)
@given(stiffness=st.floats(0.05, 5.0), mass_kg=st.floats(0.03, 0.5))
def test_every_allowed_pair_of_gains_settles_on_a_mass_it_can_hold(stiffness, mass_kg):
    half_critical = math.sqrt(1e3 * stiffness * mass_kg)
    damping = min(30.0, max(1.5 * stiffness, half_critical))
    allowed = HdRobotOptions(stiffness_n_mm=stiffness, damping_n_s_m=damping)
    made = servo(frame := Frame(mass_kg), **allowed.model_dump())
    assert settled_mm(frame, made, 4000) < 0.01


def test_a_force_error_takes_the_force_away_for_a_second():
    made = servo(frame := Frame(1e9))
    forces = commanded(frame, made, 200)
    frame.errors = [(0x0203, 7), (0x0202, 8)]
    forces += commanded(frame, made, 1300)
    assert forces[200] > 2.0
    assert set(forces[201:1199]) == {0.0}
    assert forces[-1] > 2.0
    assert made.counts == {"EXCEEDED_MAX_VELOCITY": 1, "EXCEEDED_MAX_FORCE_IMPULSE": 1}
    assert made.fault is None


def pushed(frame, spoil):
    """Push towards 5 mm with measurements that a function of tick and values spoils."""
    read = frame.hdGetDoublev

    def spoilt(what, values):
        read(what, values)
        spoil(frame.now_ns // 1_000_000 - 1, what.value == CURRENT_POSITION, values)

    frame.hdGetDoublev = spoilt
    made = servo(frame)
    return made, commanded(frame, made, 700)


@pytest.mark.parametrize(
    ("value", "problem"), [(math.nan, NOT_FINITE), (1e300, OUT_OF_REACH), (90.0, JUMP)]
)
def test_a_measurement_that_makes_no_sense_takes_the_force_away_for_a_moment(value, problem):
    def spoil(tick, is_position, values):
        values[1] = value if tick == 300 and is_position else 0.0

    made, forces = pushed(Frame(1e9), spoil)
    assert forces[299] > 2.0
    assert forces[300] == 0.0
    steps = [abs(b - a) for a, b in pairwise(forces[300:])]
    assert max(steps) < 0.05  # it returns by its ramp
    assert forces[-1] > 2.0
    assert made.position[1] == 0.0
    assert made.counts == {problem: 1}
    assert made.senseless is None

    def spoil_velocity(tick, is_position, values):
        if tick >= 300 and not is_position:
            values[2] = math.inf

    made, forces = pushed(Frame(1e9), spoil_velocity)
    assert set(forces[300:]) == {0.0}
    assert made.senseless == (NOT_FINITE, 300_000_000)


def test_a_position_that_stays_the_same_under_the_largest_force_is_stuck():
    made = servo(frame := Frame(math.inf))
    forces = commanded(frame, made, 701, 40.0)  # beyond what the limit allows
    assert made.senseless[0] == STUCK
    forces += commanded(frame, made, 199, 40.0)
    assert max(forces) == pytest.approx(3.0)
    assert sum(force > 2.99 for force in forces) == pytest.approx(201, abs=2)
    assert set(forces[500:]) == {0.0}
    frame.x = 1e-6
    made.tick(None)
    assert made.senseless is None


def test_a_device_with_a_fault_gets_no_force_again():
    made = servo(frame := Frame(1e9))
    forces = commanded(frame, made, 200)
    frame.errors = [(0x0300, 7)]
    forces += commanded(frame, made, 200)
    assert forces[200] > 2.0
    assert set(forces[201:]) == {0.0}
    assert made.fault == HdError(0x0300, 7)


def test_a_mistake_in_the_callback_ends_it_without_force():
    made = servo(frame := Frame())
    assert max(commanded(frame, made, 200)) > 0.0
    made.target = None
    assert frame.f != 0.0
    assert made.tick(None) == DONE
    assert isinstance(made.failure, TypeError)
    assert frame.f == 0.0


@pytest.mark.parametrize("code", sorted(SENTENCES))
def test_every_error_of_hd_says_what_was_seen_and_what_to_do(code):
    assert "HD_0x0999" in explain("the arm", HdError(0x999, 0))
    sentence = explain("the arm", HdError(code, 3))
    assert sentence.startswith("the arm: ")
    name, seen, to_do = SENTENCES[code]
    assert f"{seen} (HD_{name}, device's own code 3): {to_do}" in sentence
    assert only_force(code) == (code >> 8 == 2)


@given(
    st.sampled_from(["x,-z,y", "x,y,z", "-x,z,y", "y,z,x", " z, x ,y", "-x,-y,z", "+x,-z,+y"]),
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
)
def test_axes_turn_there_and_back(text, position, origin):
    assert Axes("x,-z,y").to_scene([1.0, 2.0, 3.0]) == (1.0, -3.0, 2.0)  # up is its y
    axes = Axes(text, origin)
    assert axes.to_scene(axes.to_device(position)) == position
    back = axes.place_in_scene(axes.place_on_device(position))
    assert back == pytest.approx(position, abs=1e-9)
    assert math.hypot(*axes.to_device(position)) == pytest.approx(math.hypot(*position))
