"""Who moves the robot: the states of control, and what the robot is commanded meanwhile."""

import math
from types import SimpleNamespace

import msgpack
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.core.guards import FADE_TICKS
from mmt.devices.protocols import InterfaceState
from mmt.leader.part import Session, Tick
from mmt.scene.files import scene_from_tables
from mmt_share.control_messages import MOTION_DTYPE, control_access, encode_motion
from mmt_share.parts.control import ControlPart
from mmt_share.parts.hand_motion import Clutch, OperatorMotion
from mmt_share.parts.handover import HandOver
from mmt_share.tables import Control

HOLD, SILENCE = 5, 8
LISTENERS = st.integers(1, 2)
EVENTS = ("ask", "leave", "refuse", "give", "take back", "move", "stale")
STEPS = st.lists(
    st.one_of(
        *(st.tuples(st.just(event), LISTENERS) for event in EVENTS),
        st.tuples(st.just("tick"), st.integers(1, 12)),
    ),
    min_size=10,
    max_size=60,
)


def take(over, what, value):
    """Do one step; return whether motion was accepted."""
    try:
        match what:
            case "ask":
                over.request_control(value, f"listener {value}")
            case "leave":
                over.leave(value, "it left")
            case "refuse":
                over.refuse(value)
            case "give":
                over.grant_control(value)
            case "take back":
                over.revoke_control("wanted back")
            case "move":
                return over.accepts(value, over.grant)
            case "stale":
                return over.accepts(value, over.grant - 1)
            case "tick":
                over.tick(value)
    except InputError:
        assert value not in over.asking
    return False


@settings(max_examples=700)
@given(STEPS)
@example([("ask", 1), ("give", 1), ("tick", HOLD), ("move", 1), ("leave", 1)])
def test_one_hand_moves_at_a_time_with_a_hold_between_two_and_at_last_the_leaders(steps):
    changes = []
    over = HandOver(changes.append, hold_ticks=HOLD, silence_ticks=SILENCE)
    mover = 0  # 0 is the leader's own hand, None is nobody
    held = 0
    for what, value in steps:
        accepted = take(over, what, value)
        if what == "tick" and mover is None:
            held += value
        now = {"own": 0, "given": over.operator}.get(over.state)
        if accepted:
            assert now == value
            assert what == "move"
        if now is not None and now != mover:
            assert mover is None
            assert held >= HOLD
        if now is not None or mover is not None:
            held = 0
        mover = now
        assert (over.operator is None) == (over.state in ("own", "returning"))
        assert over.operator not in over.asking
    for _ in range(HOLD + SILENCE + 1 + HOLD):  # nothing comes any more
        over.tick(1)
    assert (over.state, over.operator) == ("own", None)
    grants = {}
    for change in changes:
        if change.what in ("giving", "given", "moves", "ended"):
            grants.setdefault(change.grant, []).append(change.what)
    for told in grants.values():
        assert (told[0], told[-1]) == ("giving", "ended")
        assert told[1:-1] in ([], ["given"], ["given", "moves"])


def test_the_hold_and_the_silence_that_ends_control_last_their_ticks_to_the_last():
    over = HandOver(lambda _: None, hold_ticks=HOLD, silence_ticks=SILENCE)
    over.request_control(1, "ann")
    over.grant_control(1)
    over.tick(HOLD - 1)
    assert not over.accepts(1, over.grant)
    over.tick(1)
    assert over.accepts(1, over.grant)
    states = []
    for ticks in (SILENCE, 1, HOLD - 1, 1):
        over.tick(ticks)
        states.append(over.state)
        if over.state != "given":  # else it would not be silent
            assert not over.accepts(1, over.grant)
    assert states == ["given", "returning", "returning", "own"]


def test_more_who_ask_than_a_person_can_read_are_refused():
    changes = []
    over = HandOver(changes.append, hold_ticks=HOLD, silence_ticks=SILENCE)
    for who in range(1, 30):
        over.request_control(who, "x")
    assert len(over.asking) == 20
    assert changes[-1].what == "refused"


PLACES = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@given(PLACES, PLACES, st.lists(st.tuples(PLACES, st.integers(1, 5)), max_size=30))
def test_a_hand_that_takes_up_a_robot_moves_it_as_itself_and_by_a_bounded_rest(robot, hand, path):
    clutch = Clutch(robot, hand, 50.0)
    still = InterfaceState(hand, (0.0, 0.0, 0.0), 0.0, contact=False)
    at = clutch.step(still, 0.01)
    assert at == pytest.approx(robot, abs=1e-9)
    before = hand
    for place, ticks in path:
        elapsed_s = 1e-3 * ticks
        velocity = tuple((b - a) / elapsed_s for a, b in zip(before, place, strict=True))
        speed = math.hypot(*velocity)
        offset = clutch.offset_mm
        clutch.step(InterfaceState(place, velocity, 0.0, contact=False), elapsed_s)
        for old, new in zip(offset, clutch.offset_mm, strict=True):
            assert abs(new) <= abs(old)
            assert abs(old - new) <= min(speed, 50.0) * elapsed_s + 1e-9
        before = place


def motion(times_ms, places):
    records = np.zeros(len(times_ms), MOTION_DTYPE)
    records["time_ns"] = [round(1e6 * t) for t in times_ms]
    records["position_mm"][:, 0] = places
    return records


def test_jittering_messages_are_given_out_as_an_even_motion():
    """Ten records of 1 mm/ms a message, up to 15 ms late: the motion is as even as it was."""
    rng = np.random.default_rng(4)
    buffer = OperatorMotion(200_000_000)
    start_ms = 1e5
    arrivals = []
    for k in range(400):
        last_ms = 10 * k + 9
        arrivals.append((last_ms + 20 + 15 * rng.random(), k))
    given_out = []
    for now_ms in range(4000):
        while arrivals and arrivals[0][0] <= now_ms:
            at_ms, k = arrivals.pop(0)
            own = [10.0 * k + j for j in range(10)]
            buffer.add(motion([start_ms + t for t in own], own), round(1e6 * at_ms))
        state = buffer.at(round(1e6 * now_ms))
        if state is not None and now_ms > 2200:
            given_out.append(state.position_mm[0])
    steps = np.diff(given_out)
    assert steps.min() > 0.85
    assert steps.max() < 1.15
    assert buffer.delay_ms == pytest.approx(15.0, abs=1.0)


def test_motion_that_stops_stands_still_and_old_records_change_nothing():
    buffer = OperatorMotion(200_000_000)
    assert buffer.at(0) is None
    buffer.add(motion([1.0, 2.0], [5.0, 6.0]), 3_000_000)
    for now_ms in (3, 50, 5000):
        state = buffer.at(now_ms * 1_000_000)
    assert state.position_mm == (6.0, 0.0, 0.0)
    assert state.velocity_mm_s == (0.0, 0.0, 0.0)
    buffer.add(motion([0.5, 1.5], [90.0, 91.0]), 5_001_000_000)
    assert buffer.at(5_002_000_000) == state


class SharedPart:
    """Stands for the part that shares, and keeps whose motion it admits."""

    admitted = None

    def send_to(self, operator, message):
        """It is not looked at."""

    def admit_motion(self, operator):
        self.admitted = operator


class Robot:
    """A leader's control part with a hand, and what it commands, tick by tick."""

    def __init__(self, monkeypatch, **control):
        monkeypatch.setenv("MMT_CONTROL_TOKEN", "0123456789abcdef")
        tables = {
            **{name: {} for name in ("link", "simulated", "hand", "texture", "sharing")},
            "control": control,
        }
        self.session = Session(scene_from_tables(tables))
        self.shared = SharedPart()
        hand = SimpleNamespace(control=None)
        self.session.remote = SimpleNamespace(connected=True)
        table = self.session.scene.table(Control)
        self.part = ControlPart(self.session, table, hand, self.shared, None)
        self.ns = 1_000_000_000
        monkeypatch.setattr("mmt_share.parts.control.time.monotonic_ns", lambda: self.ns)
        self.commands = []
        self.tick = Tick()

    def step(self, own, velocity=(0.0, 0.0, 0.0), elapsed=1):
        self.ns += elapsed * 1_000_000
        tick = self.tick
        tick.now_ns, tick.elapsed = self.ns, elapsed
        tick.state = InterfaceState(own, velocity, 0.0, contact=False)
        tick.operating, tick.overridden = None, self.part.overridden
        tick.offset_mm = (0.0, 0.0, 0.0)
        self.commands.append(self.part.command(tick, own))
        self.part.tick(tick)
        return self.commands[-1]

    def hold(self, place):
        """Rest there for as long as a hold lasts."""
        for _ in range(FADE_TICKS + 1):
            self.step(place)

    def ask_and_grant(self, who):
        self.part.receive({"control": "ask", "who": who, "name": "ann"})
        self.part.grant_control(who)

    def send(self, who, grant, records):
        data = msgpack.unpackb(encode_motion(grant, records))["data"][1]
        self.part.receive({"control": "motion", "who": who, "data": data.hex()})


@settings(max_examples=30)
@given(st.data())
def test_whatever_happens_the_command_moves_by_no_more_than_the_limit(data):
    """Hands that jump, hostile motion, hand-overs at any moment: 1000 mm/s is 1 mm a tick."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        robot = Robot(monkeypatch)
        robot.step((0.0, 0.0, 0.0))
        robot.ask_and_grant(1)
        for _ in range(data.draw(st.integers(5, 30))):
            match data.draw(
                st.sampled_from(["step", "send", "send", "ask", "back", "give", "wait"])
            ):
                case "step":
                    place = data.draw(PLACES)
                    velocity = data.draw(PLACES)
                    robot.step(place, velocity)
                case "send":
                    count = data.draw(st.integers(1, 5))
                    records = np.zeros(count, MOTION_DTYPE)
                    first = data.draw(st.integers(0, 2**62))
                    records["time_ns"] = first + 1_000_000 * np.arange(count)
                    records["position_mm"] = data.draw(PLACES)
                    records["velocity_mm_s"] = data.draw(st.sampled_from([0.0, 1e3, 3e38]))
                    robot.send(1, data.draw(st.sampled_from([1, 1, 1, 0, 2])), records)
                case "ask":
                    robot.part.receive({"control": "ask", "who": 1, "name": ""})
                case "back":
                    robot.part.revoke_control()
                case "give":
                    robot.part.toggle()
                case "wait":
                    robot.hold(robot.commands[-1])
        steps = np.linalg.norm(np.diff(np.array(robot.commands), axis=0), axis=1)
        assert np.isfinite(steps).all()
        assert steps.max(initial=0.0) <= 1.0 + 1e-9


def test_the_robot_holds_follows_the_operator_holds_and_follows_the_leader(monkeypatch):
    robot = Robot(monkeypatch, silence_ms=200)
    for k in range(100):
        robot.step((0.1 * k, 0.0, 0.0), (100.0, 0.0, 0.0))
    held = robot.commands[-1]
    robot.part.receive({"control": "ask", "who": 7, "name": "ann"})
    assert robot.part.shown()["control"]["asking"] == [[7, "ann"]]
    robot.part.grant_control(7)
    for _ in range(FADE_TICKS):
        robot.step((50.0, 5.0, 5.0), (100.0, 0.0, 0.0))
    assert set(robot.commands[-FADE_TICKS + 1 :]) == {held}
    assert robot.shared.admitted == 7
    place, own_ns = np.array(held), 77_000_000_000
    for _ in range(50):
        records = np.zeros(10, MOTION_DTYPE)
        for k in range(10):
            own_ns += 1_000_000
            place += np.array([0.0, 0.05, 0.0])
            records[k] = (own_ns, place, (0.0, 50.0, 0.0), 1.0, 1)
        robot.send(7, 1, records)
        for _ in range(10):
            robot.step((50.0, 5.0, 5.0))
    assert robot.tick.operating.contact
    assert robot.commands[-1][0] == pytest.approx(held[0], abs=1e-4)
    assert 23.0 < robot.commands[-1][1] <= 25.0
    for _ in range(201):
        robot.step((50.0, 5.0, 5.0))
    assert robot.part.shown()["control"]["state"] == "returning"
    last = robot.commands[-1]
    robot.hold((50.0, 5.0, 5.0))
    assert robot.commands[-1] == last  # the leader's hand rests, and so does the robot
    assert robot.part.shown()["control"]["state"] == "own"
    for k in range(3000):
        robot.step((50.0 + 0.05 * k, 5.0, 5.0), (50.0, 0.0, 0.0))
    assert robot.commands[-1] == pytest.approx((50.0 + 0.05 * 2999, 5.0, 5.0))
    assert robot.tick.offset_mm == (0.0, 0.0, 0.0)


def test_motion_of_another_grant_or_listener_is_refused_and_counted(monkeypatch):
    robot = Robot(monkeypatch)
    robot.step((1.0, 2.0, 3.0))
    robot.ask_and_grant(1)
    robot.hold((1.0, 2.0, 3.0))
    far = np.zeros(1, MOTION_DTYPE)
    far["time_ns"], far["position_mm"] = 1, 40.0
    robot.send(2, 1, far)
    robot.send(1, 0, far)
    robot.send(1, 2, far)
    robot.part.receive({"control": "motion", "who": 1, "data": "00"})
    assert robot.step((9.0, 9.0, 9.0)) == (1.0, 2.0, 3.0)
    assert robot.part.summary(1.0)["control"]["refused_messages"] == 4
    with pytest.raises(InputError, match="does not ask"):
        robot.part.grant_control(5)


def test_the_metrics_say_whose_hand_moves_the_robot(monkeypatch):
    robot = Robot(monkeypatch, silence_ms=200)

    def values():
        return {
            sample.labels.get("hand", sample.name): sample.value
            for metric in robot.part.metrics()
            for sample in metric.samples
        }

    def mover():
        (one,) = (hand for hand in ("leader", "listener", "none") if values()[hand])
        return one

    robot.step((0.0, 0.0, 0.0))
    assert mover() == "leader"
    robot.part.receive({"control": "ask", "who": 2, "name": "bob"})
    robot.part.orders()["control"]({"decision": "refuse", "who": 2})
    robot.ask_and_grant(1)
    for _ in range(FADE_TICKS):
        assert mover() == "none"
        robot.step((0.0, 0.0, 0.0))
    robot.send(2, 1, motion([1.0], [0.0]))
    robot.send(1, 1, motion([1.0], [0.0]))
    assert mover() == "listener"
    for _ in range(202 + FADE_TICKS):  # silence, and a hold
        robot.step((0.0, 0.0, 0.0))
    assert mover() == "leader"
    found = values()
    assert found["mmt_hand_overs_total"] == found["mmt_control_refusals_total"] == 1
    assert found["mmt_control_refused_messages_total"] == 1
    assert found["mmt_control_holds_total"] == 2
    held_s = 2e-3 * FADE_TICKS
    assert found["mmt_control_held_seconds_total"] == pytest.approx(held_s, abs=0.01)
    assert found["mmt_control_given_seconds_total"] == pytest.approx(0.2 + held_s, abs=0.01)


def test_control_is_not_given_where_there_is_no_robot(monkeypatch):
    robot = Robot(monkeypatch)
    robot.part.receive({"control": "ask", "who": 1, "name": "ann"})
    with pytest.raises(InputError, match="no robot"):
        robot.part.grant_control(1)
    robot.part.toggle()
    assert robot.part.shown()["control"]["state"] == "own"


def test_without_its_own_token_control_cannot_be_had(monkeypatch):
    monkeypatch.delenv("MMT_CONTROL_TOKEN", raising=False)
    with pytest.raises(InputError, match="openssl rand"):
        control_access(None)
    monkeypatch.setenv("MMT_CONTROL_TOKEN", "short")
    with pytest.raises(InputError, match="at least 16"):
        control_access(None)
