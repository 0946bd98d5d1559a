"""What is said to the Haply Inverse Service and what is taken of its answers, without a service."""

import json
import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.devices.reading_checks import JUMP, NOT_FINITE, OUT_OF_REACH
from mmt_devices.inverse3.exchange import ABSENT
from mmt_devices.inverse3.messages import NAMES, OtherFormatError, listed, parse, version_of
from mmt_devices.inverse3.servo import (
    UNCALIBRATED,
    UNREADABLE,
    ChosenDevice,
    ForceServo,
    Inverse3PositionServo,
)

MS = 1_000_000


class Clock:
    now_ns = 10**12

    def __call__(self):
        return self.now_ns


def entry(x_m=0.0, y_m=-0.15, z_m=0.15, **status):
    position = {"x": x_m, "y": y_m, "z": z_m}
    state = {"cursor_position": position, "cursor_velocity": {"x": 0.1, "y": 0.0, "z": -0.2}}
    return {"device_id": "049D", "state": state, "status": status}


def answer(*arguments, **status):
    return json.dumps({"inverse3": [entry(*arguments, **status)]})


def handle(clock, names="3.5"):
    return ForceServo(ChosenDevice("049D", NAMES[names], entry()), 50.0, 100.0, 3.0, clock)


def robot(clock, **options):
    given = {"speed_limit_mm_s": 500.0, "lead_limit_mm": 10.0, **options}
    return Inverse3PositionServo(
        ChosenDevice("049D", NAMES["3.5"], entry()), 50.0, **given, clock=clock
    )


def said(text):
    (only,) = json.loads(text)["inverse3"]
    assert only["device_id"] == "049D"
    return only["commands"]


def force_n(commands, name="vector"):
    return tuple(commands["set_cursor_force"][name][axis] for axis in "xyz")


def place_m(commands):
    return tuple(commands["set_cursor_position"]["position"][axis] for axis in "xyz")


def commanded(servo, clock, answered=""):
    """Let a millisecond pass with a command and an answer; return what the device is told."""
    clock.now_ns += MS
    servo.command_ns = clock()
    if answered:
        servo.handle_answer(answered)
    return said(servo.next_message(clock()))


@pytest.mark.parametrize("version", NAMES)
def test_each_version_is_told_forces_by_its_own_names(version):
    clock = Clock()
    servo = handle(clock, version)
    assert force_n(said(servo.release()), NAMES[version].force) == (0, 0, 0)
    greeting = json.loads(servo.first_message())
    assert ("session" in greeting) == (version == "3.5")


def test_the_version_is_known_by_the_first_message_and_what_is_none_is_told():
    assert version_of({"session_id": 7}, entry()) == "3.5"
    assert version_of({}, {**entry(), "state": {"control_mode": "idle"}}) == "3.5"
    assert version_of({}, {**entry(), "state": {"mode": "idle"}}) == "3.1"
    with pytest.raises(OtherFormatError):
        listed({"inverse3": {"049D": {}}})
    for without in ({}, {"inverse3": []}, {"inverse3": None}, {"inverse3": [3, {"device_id": 4}]}):
        assert listed(without) == {}
    for text in ("", "<html>", "[1]", "3", "null", "[" * 100_000):
        with pytest.raises(ValueError):  # noqa: PT011 - whichever says it
            parse(text)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (answer(math.nan), NOT_FINITE),
        (answer(math.inf), NOT_FINITE),
        (answer(3.0), OUT_OF_REACH),
        (answer(0.1), JUMP),
        (answer("0.1"), UNREADABLE),
        (answer(True), UNREADABLE),
        (answer(10**400), UNREADABLE),
        ("{", UNREADABLE),
        ('{"inverse3": [{"device_id": "049D"}]}', UNREADABLE),
        ('{"inverse3": [{"device_id": "049D", "state": []}]}', UNREADABLE),
        ('{"inverse3": []}', ABSENT),
        ('{"inverse3": [{"device_id": "0000"}]}', ABSENT),
    ],
)
def test_an_answer_that_makes_no_sense_is_counted_and_takes_the_force_away(text, problem):
    clock = Clock()
    servo = handle(clock)
    servo.command = (0.0, 0.0, 2.0)
    for _ in range(200):
        told = commanded(servo, clock, answer())
    assert force_n(told) == (0.0, 0.0, 2.0)
    before = servo.measured
    assert before.position_mm == pytest.approx((0.0, -150.0, 150.0))
    assert before.velocity_mm_s == pytest.approx((100.0, 0.0, -200.0))
    servo.handle_answer(text)
    assert servo.counts == {problem: 1}
    assert servo.measured == before
    assert force_n(said(servo.next_message(clock()))) == (0.0, 0.0, 0.0)
    told = commanded(servo, clock, answer())
    assert servo.implausible is None
    assert 0.0 <= force_n(told)[2] <= 2.0 * 10 / 100  # by its ramp


def test_where_calibration_is_needed_a_position_without_it_makes_no_sense():
    servo = handle(Clock())
    servo.handle_answer(answer(calibrated=False))
    assert servo.counts == {}
    servo.needs_calibration = True
    servo.handle_answer(answer(calibrated=False))
    assert servo.counts == {UNCALIBRATED: 1}
    servo.handle_answer(answer())  # an answer that does not tell leaves it as it was
    assert servo.counts == {UNCALIBRATED: 2}
    servo.handle_answer(answer(calibrated=True))
    assert servo.implausible is None


@settings(max_examples=40)
@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text() | st.integers(),
                    lambda c: st.lists(c, max_size=3) | st.dictionaries(
                        st.sampled_from(["inverse3", "device_id", "state", "status", "x",
                                         "cursor_position", "cursor_velocity"]), c)))  # fmt: skip
def test_no_answer_ends_the_conversation_or_moves_the_device(message):
    servo = handle(Clock())
    before = servo.measured
    servo.handle_answer(json.dumps(message))
    assert servo.measured == before
    assert servo.implausible is not None


def test_the_point_starts_at_the_tip_and_moves_at_a_bounded_speed():
    clock = Clock()
    servo = robot(clock, speed_limit_mm_s=100.0, lead_limit_mm=100.0)
    assert "set_cursor_force" in said(servo.next_message(clock()))  # limp before the first command
    servo.command = (50.0, -150.0, 150.0)
    at = [0.0]
    for _ in range(700):
        place = place_m(commanded(servo, clock))
        assert place[1:] == pytest.approx((-0.15, 0.15))
        at.append(1e3 * place[0])
    assert max(late - early for early, late in pairwise(at)) < 0.1 + 1e-9
    assert at[250] == pytest.approx(25.0)
    assert at[-1] == pytest.approx(50.0)


def test_a_tip_that_does_not_move_although_it_is_pulled_ends_the_connection():
    clock = Clock()
    servo = robot(clock, lead_limit_mm=4.0)
    servo.command = (50.0, -150.0, 150.0)
    told = [commanded(servo, clock, answer()) for _ in range(600)]
    leads = [1e3 * place_m(each)[0] for each in told if "set_cursor_position" in each]
    assert max(leads) == pytest.approx(4.0)
    assert servo.fault.startswith("a position that stays the same")
    assert "set_cursor_force" in said(servo.next_message(clock()))
    near = robot(clock)
    near.command = (3.0, -150.0, 150.0)  # held by friction close to its target
    for _ in range(2000):
        commanded(near, clock, answer())
    assert near.fault == ""


def test_an_arm_without_fresh_commands_is_limp_and_starts_anew_where_it_is():
    clock = Clock()
    servo = robot(clock)
    servo.command, servo.command_ns = (50.0, -150.0, 150.0), clock()
    clock.now_ns += 5 * MS
    assert "set_cursor_position" in said(servo.next_message(clock()))
    clock.now_ns += 60 * MS
    assert force_n(said(servo.next_message(clock()))) == (0, 0, 0)
    assert servo.counts == {"stale commands": 1}
    servo.handle_answer(answer(0.02))
    servo.command_ns = clock()
    place = place_m(said(servo.next_message(clock())))
    assert place == pytest.approx((0.02, -0.15, 0.15))
