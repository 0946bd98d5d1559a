"""Whatever is asked for, each driver's own last step gives its device finite, bounded numbers.

And nothing of it lasts: after what was no number comes what is asked for again.
"""

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.arrays import Vector, bounded, step_towards
from mmt.core.guards import ForceGuard, GuardedDisplay, SampleGuard, VibrationSlew
from mmt.devices.haptuator.driver import VoltageDrive
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.openhaptics.library import CURRENT_POSITION, ErrorInfo
from mmt.devices.openhaptics.options import HdOptions, HdRobotOptions
from mmt.devices.openhaptics.robot import PositionServo
from mmt.devices.openhaptics.servo import Servo
from mmt.leader.motion.feedback import StreamedForce
from mmt.testing.simulation.actuator import SimulatedActuator
from mmt_devices.inverse3.messages import NAMES
from mmt_devices.inverse3.servo import ChosenDevice, ForceServo
from mmt_devices.universal_robots.servo import ServoPoint, ServoSettings

EXTREME = st.sampled_from(
    [math.nan, math.inf, -math.inf, 1e308, -1.7e308, 5e-324, -2.2e-308, 0.0, -0.0, 1.0, -3.0]
)
NUMBERS = st.one_of(EXTREME, st.floats(width=64))
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
GOOD = (0.5, -0.25, 1.0)
LIMIT_N = 3.0


@given(VECTORS, VECTORS, st.one_of(st.floats(0.0, 1e300), st.just(math.inf)))
def test_a_way_towards_a_goal_is_finite_and_no_longer_than_it_may_be(start, goal, most):
    point = step_towards(start, goal, most)
    if all(map(math.isfinite, start)):
        assert all(map(math.isfinite, point))
        if all(map(math.isfinite, goal)) and most < 1e9 and max(map(abs, start)) < 1e9:
            assert math.dist(start, point) <= most * (1.0 + 1e-9) + 1e-6
    elif all(map(math.isfinite, goal)):
        assert point == goal
    length = math.hypot(*bounded(goal, most))
    assert length <= most * (1.0 + 1e-9) + 1e-300


def _drive(**options):
    made = VoltageDrive(HaptuatorOptions(volts_per_m_s2=0.1, full_scale_v=6.0, **options), 1000.0)
    return made.convert, 3.0


def _in_place(change):
    def play(samples):
        array = np.array(samples, dtype=float)
        change(array)
        return array.tolist()

    return play


def _simulated():
    actuator = SimulatedActuator(limit_m_s2=20.0)

    def play(samples):
        actuator.connect()
        actuator.write(samples)
        return [actuator.statistics.rms_m_s2]

    return play, 20.0


@pytest.mark.parametrize(
    "make",
    [
        _drive,
        lambda: _drive(high_hz=300.0),
        lambda: (_in_place(SampleGuard(3.0, 10).apply), 3.0),
        lambda: (_in_place(VibrationSlew(60.0, 60.0).limit), 60.0),
        _simulated,
    ],
    ids=["haptuator", "haptuator with a low-pass", "converter", "leader", "simulated"],
)
@settings(max_examples=80)
@given(st.lists(NUMBERS, max_size=40))
def test_vibration_is_finite_and_bounded_and_goes_on(make, samples):
    play, limit = make()
    played = [*play(samples[:7]), *play(samples[7:])]
    assert all(math.isfinite(value) and abs(value) <= limit * (1.0 + 1e-12) for value in played)
    tone = [math.sin(2.0 * math.pi * 200.0 * k / 1000.0) for k in range(2000)]
    anew = make()[0]
    play(tone[:1800])
    anew(tone[:1800])
    np.testing.assert_allclose(play(tone[1800:]), anew(tone[1800:]), atol=1e-6)


class Library:
    """Takes the servo's frames; measurements are what the test sets."""

    velocity: Vector = (0.0, 0.0, 0.0)
    now_ns = 0
    shown: Vector = (0.0, 0.0, 0.0)
    hdGetError = ErrorInfo  # noqa: N815 - the library's names

    def hdBeginFrame(self, handle):  # noqa: N802
        self.now_ns += 1_000_000

    def hdGetDoublev(self, what, values):  # noqa: N802
        values[:] = (0.0, 0.0, 0.0) if what.value == CURRENT_POSITION else self.velocity

    def hdSetDoublev(self, what, values):  # noqa: N802
        self.shown = tuple(values[:])

    def hdEndFrame(self, handle):  # noqa: N802
        """Nothing is left to do."""


class HdHandle:
    """Commanded by what `tick` gets, and by nothing new where that is None."""

    def __init__(self, ramp_ms=10, axes_n=None):
        self.library = Library()
        self.servo = self.made(ramp_ms=ramp_ms, axes="x,y,z", force_limit_n=axes_n or LIMIT_N)
        self.servo.clock = lambda: self.library.now_ns
        self.servo.tick_ns = 0

    def made(self, **options):
        return Servo(self.library, self.library, 0, HdOptions(stale_ms=100, **options), LIMIT_N)

    def command(self, force_n):
        self.servo.force = force_n

    def tick(self, force_n):
        if force_n is not None:
            self.command(force_n)
            self.servo.command_ns = self.library.now_ns
        self.servo.tick(None)
        return self.library.shown


class HdRobot(HdHandle):
    """Gets the numbers as its velocity, and as its target."""

    def made(self, **options):
        robot = HdRobotOptions(stiffness_n_mm=1.0, **options)
        return PositionServo(self.library, self.library, 0, robot, LIMIT_N)

    def command(self, force_n):
        self.servo.target = force_n
        self.library.velocity = (0.0, 0.0, 0.0) if force_n is GOOD else force_n


class Inverse3:
    def __init__(self, ramp_ms=10, axes_n=None):
        self.now_ns = 10**12
        names = "cursor_position", "cursor_velocity"
        state = {name: dict.fromkeys("xyz", 0.0) for name in names}
        entry = {"device_id": "049D", "state": state, "status": {}}
        found = ChosenDevice("049D", NAMES["3.5"], entry)
        self.servo = ForceServo(found, 50.0, ramp_ms, LIMIT_N, lambda: self.now_ns)

    def tick(self, force_n):
        self.now_ns += 1_000_000
        if force_n is not None:
            self.servo.command, self.servo.command_ns = force_n, self.now_ns
        (told,) = json.loads(self.servo.next_message(self.now_ns))["inverse3"]
        return tuple(told["commands"]["set_cursor_force"]["vector"][axis] for axis in "xyz")


class LeaderForce:
    """Force feedback as streamed, and the leader's own last step."""

    def __init__(self):
        self.display = GuardedDisplay(self, LIMIT_N, 0.5)
        self.feedback = StreamedForce(self.display, limit_n=LIMIT_N)
        self.shown = (0.0, 0.0, 0.0)

    def write(self, force_n):
        self.shown = force_n

    def tick(self, force_n):
        self.feedback.on_frames(np.array([(force_n,)], dtype=[("force_n", "f8", 3)]))
        self.feedback.tick(1, None)
        return self.shown


class Guard:
    def __init__(self):
        self.guard = ForceGuard(LIMIT_N, (1.0, 2.0, LIMIT_N))

    def tick(self, force_n):
        return self.guard.step(force_n)


@pytest.mark.parametrize("make", [Guard, LeaderForce, HdHandle, HdRobot, Inverse3])
@settings(max_examples=80)
@given(st.lists(VECTORS, max_size=25))
def test_a_force_is_finite_and_bounded_and_comes_back(make, forces_n):
    device = make()
    for force_n in forces_n:
        shown = device.tick(force_n)
        assert all(map(math.isfinite, shown))
        assert math.hypot(*shown) <= LIMIT_N * (1.0 + 1e-9)
    for _ in range(400):
        shown = device.tick(GOOD)
    assert shown == pytest.approx(GOOD, abs=1e-6)


BEYOND = st.builds(math.copysign, st.floats(1e6, 1e300), st.sampled_from([-1.0, 1.0]))


@pytest.mark.parametrize(
    ("make", "axes_n"),
    [(HdHandle, None), (HdHandle, (1.0, 2.0, 0.5)), (HdRobot, None), (HdRobot, (1.0, 2.0, 0.5)),
     (Inverse3, None)],
)  # fmt: skip
@settings(max_examples=30)
@given(st.tuples(BEYOND, BEYOND, BEYOND))
def test_a_force_beyond_the_limit_rises_and_falls_over_the_whole_ramp(make, axes_n, force_n):
    device = make(ramp_ms=100, axes_n=axes_n)
    full_n = LIMIT_N if axes_n is None else math.hypot(*axes_n)
    rising = [math.hypot(*device.tick(force_n)) for _ in range(150)]
    assert rising == pytest.approx([full_n * min(tick / 100, 1.0) for tick in range(150)])
    falling = [math.hypot(*device.tick(None)) for _ in range(300)]
    assert max(before - after for before, after in pairwise(falling)) <= 1.0001 * full_n / 100
    assert falling[-1] == 0.0
    assert device.servo.counts == {"stale commands": 1}


@settings(max_examples=80)
@given(st.lists(st.tuples(VECTORS, VECTORS), max_size=25))
def test_an_arm_in_a_box_is_sent_to_finite_places(moves):
    bounds = ServoSettings(
        speed_m_s=0.25, acceleration_m_s2=5.0, force_limit_n=20.0, normal=(0.0, 0.0, 1.0),
        lookahead_s=0.05, gain=1000.0,
    )  # fmt: skip
    point = ServoPoint(bounds, (0.0, 0.0, 0.0))
    for target, force_n in moves:
        inside = bounded(target, 1.0)  # as the driver cuts it to its box
        before = point.position_m
        place = point.move(inside, force_n, 0.002)
        assert all(map(math.isfinite, place))
        assert math.dist(before, place) <= 0.25 * 0.002 * (1.0 + 1e-9)
