"""The robot is safe from a leader that falls silent, speaks too late, or jumps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.arrays import Vector
from mmt.core.frames import COMMAND_DTYPE, frame_dtype
from mmt.core.output.logs import RepeatLimit
from mmt.follower.command_guard import CommandGuard
from mmt.scene import Link

HOME = (0.0, 0.0, 5.0)
SECOND_NS = 1_000_000_000


def command(*position_mm, round_trip_ns=0, time_ns=0, number=0):
    """A command and its arrival; it echoes a frame of time 1 s, which the leader had for 2 s."""
    block = np.zeros(1, dtype=COMMAND_DTYPE)
    block["position_mm"] = position_mm
    block["sequence"] = number
    block["time_ns"] = time_ns
    block["echo_time_ns"] = SECOND_NS
    block["echo_age_ns"] = 2 * SECOND_NS
    return block, 3 * SECOND_NS + round_trip_ns


def sent_at(*times_ns):
    """Frames of these times."""
    frames = np.zeros(len(times_ns), dtype=frame_dtype())
    frames["time_ns"] = times_ns
    return frames


class Guarded:
    """A guard whose positions and sentences are noted."""

    def __init__(
        self, measured=HOME, normal="z", box_mm=None, rate_hz=1000.0, measures_position=True, **keys
    ):
        self.said = []
        self.measured = measured
        self.positions = []
        self.guard = CommandGuard(
            Link.model_validate(keys),
            rate_hz,
            normal,
            measures_position=measures_position,
            say=self.said.append,
            box_mm=box_mm,
        )
        self.send(SECOND_NS)

    def send(self, *times_ns):
        """Send frames of these times."""
        self.guard.echoes.note(sent_at(*times_ns))

    def run(self, ticks, position_mm=None):
        """Let ticks pass, with a command before each where there is one."""
        for _ in range(ticks):
            if position_mm is not None:
                self.guard.receive(*command(*position_mm))
            self.positions.append(self.guard.step(1, lambda: self.measured))

    @property
    def newest(self) -> Vector:
        position = self.positions[-1]
        assert position is not None
        return position


def steps_mm(positions):
    known = np.array([position for position in positions if position is not None])
    return [float(step) for step in np.linalg.norm(np.diff(known, axis=0), axis=1)]


@pytest.mark.parametrize("measured", [HOME, None])
def test_commands_pass_as_they_are_where_the_robot_is_there_already_or_not_measured(measured):
    robot = Guarded(measured, measures_position=measured is not None)
    path = [(0.2 * k, -0.1 * k, 5.0 - 0.1 * k) for k in range(200)]
    for position in path:
        robot.run(1, position)
    assert robot.positions == [pytest.approx(position) for position in path]
    summary = robot.guard.summary
    assert summary.pop("silence_limit_ms") == 100.0
    assert set(summary.values()) == {0}


def test_the_robot_begins_where_it_is_once_the_leader_commands():
    robot = Guarded(measured=None)
    robot.run(300)
    robot.run(3, (10.0, 0.0, 5.0))
    assert robot.positions == [None] * 303
    assert (robot.said, robot.guard.summary["silences"]) == ([], 0)
    robot.measured = HOME
    robot.run(250, (10.0, 0.0, 5.0))
    assert robot.positions[303] == pytest.approx((0.05, 0.0, 5.0))
    assert max(steps_mm(robot.positions)) == pytest.approx(0.05)
    assert robot.newest == (10.0, 0.0, 5.0)


@pytest.mark.parametrize("normal", ["x", "y", "z"])
def test_in_silence_the_robot_retracts_along_the_normal(normal):
    robot = Guarded(normal=normal, on_silence="retract", retract_mm=8.0, silence_ms=40.0)
    robot.run(10, HOME)
    robot.run(39)
    assert robot.newest == HOME
    robot.run(200)
    moved = np.subtract(robot.newest, HOME)
    np.testing.assert_allclose(moved, [8.0 * (axis == normal) for axis in "xyz"])
    assert max(steps_mm(robot.positions)) == pytest.approx(0.05)
    assert robot.said == ["leader silent for 0.04 s: retracting"]


@pytest.mark.parametrize(
    ("sent_meanwhile", "lost", "reason"),
    [
        (300, 0, ", in which the network held it up"),
        (300, 2, ", in which the network held it up"),
        (300, 300, " and 300 lost commands"),
        (300, 50, " and 50 lost commands"),  # half of the time that counts as silence
        (300, 49, ", in which the network held it up"),
        (252, 0, ", in which the network held it up"),
        (251, 0, ", in which it sent nothing"),
        (0, 0, ", in which it sent nothing"),
        (-500, 0, ""),  # another process, which counts anew
    ],
)
@pytest.mark.parametrize("first", [1000, 2**32 - 120])
@pytest.mark.parametrize("stale", [0, 5])
def test_why_commands_were_missing_is_told_when_they_come_again(
    sent_meanwhile, lost, reason, first, stale
):
    """A backlog that arrives at once, its first commands stale, was held up by the network."""
    robot = Guarded(recovery_mm_s=100.0)
    period_ns = SECOND_NS // 1000

    def receive(k, tick, round_trip_ns=0):
        number = (first + k) % 2**32
        robot.guard.receive(
            *command(*HOME, time_ns=tick * period_ns, number=number, round_trip_ns=round_trip_ns)
        )

    for k in range(100):
        receive(k, k)
        robot.run(1)
    robot.run(300)
    late = 300 - max(sent_meanwhile, 0)  # of the leader's own ticks
    for k in range(100 + lost, 110 + max(sent_meanwhile, 0)):
        number = k if sent_meanwhile >= 0 else k - 500
        receive(number, k + late, SECOND_NS if k < 100 + lost + stale else 0)
    robot.run(1)
    assert robot.said[-1] == (
        f"leader is back after 0.3 s{reason}: taking up its commands at 100 mm/s"
    )


def test_stale_commands_are_thrown_away_and_are_no_end_of_the_silence():
    robot = Guarded(stale_ms=300.0)
    robot.run(10, HOME)
    for _ in range(150):
        robot.guard.receive(*command(50.0, 0.0, 0.0, round_trip_ns=SECOND_NS))
        robot.run(1)
    assert robot.newest == HOME
    assert robot.said == ["leader silent for 0.1 s: holding"]
    assert robot.guard.summary["stale_commands"] == 150
    robot.guard.receive(*command(5.0, 0.0, 5.0, round_trip_ns=299_000_000))
    robot.run(200)
    assert robot.newest == pytest.approx((5.0, 0.0, 5.0))


def test_a_command_that_echoes_nothing_is_as_old_as_the_first_frame():
    robot = Guarded(stale_ms=300.0)
    block, _ = command(1.0, 0.0, 5.0)
    block["echo_time_ns"] = block["echo_age_ns"] = 0
    robot.guard.receive(block, SECOND_NS + 300_000_001)
    robot.run(10)
    assert robot.positions[-1] is None
    robot.guard.receive(block, SECOND_NS + 300_000_000)
    robot.run(100)
    assert robot.newest == (1.0, 0.0, 5.0)
    robot.guard.echoes.connect()  # another leader, before the first frame for it
    block["position_mm"] = HOME
    robot.guard.receive(block, 9 * SECOND_NS)
    robot.run(100)
    assert robot.newest == HOME


@pytest.mark.parametrize(
    ("echo_time_ns", "echo_age_ns"),
    [
        (SECOND_NS + 1, 0),  # between two frames
        (2 * SECOND_NS, 0),  # newer than any
        (2**62, 0),
        (-1, 0),
        (SECOND_NS - 1, 0),  # older than any
        (SECOND_NS, 2 * SECOND_NS + 10_000_000),  # since before it was sent
        (SECOND_NS, 2**62),
        (SECOND_NS, -1),
        (SECOND_NS, -(2**63)),
    ],
)
def test_an_echo_that_cannot_be_true_makes_no_command_fresh(echo_time_ns, echo_age_ns):
    robot = Guarded()
    robot.send(SECOND_NS + 2_000_000)
    robot.run(10, HOME)
    block, arrival_ns = command(50.0, 0.0, 0.0)
    block["echo_time_ns"], block["echo_age_ns"] = echo_time_ns, echo_age_ns
    robot.guard.receive(block, arrival_ns)
    robot.run(200)
    assert robot.newest == HOME
    assert robot.guard.summary["implausible_commands"] == 1
    robot.guard.receive(np.concatenate([block, block]), arrival_ns)
    assert robot.guard.summary["implausible_commands"] == 3
    assert robot.said[0] == "the leader's commands echo no frame that was sent: they are left out"


def test_a_frame_of_a_minute_ago_may_be_echoed_but_none_of_an_earlier_connection():
    robot = Guarded()
    robot.send(*range(2 * SECOND_NS, 200 * SECOND_NS, 1_000_000))
    block, _ = command(*HOME)
    block["echo_time_ns"], block["echo_age_ns"] = 140 * SECOND_NS, 60 * SECOND_NS
    robot.guard.receive(block, 200 * SECOND_NS)
    assert robot.guard.summary["implausible_commands"] == 0
    robot.guard.echoes.connect()
    robot.guard.receive(block, 200 * SECOND_NS)
    assert robot.guard.summary["implausible_commands"] == 1


def test_after_the_frames_clock_jumped_back_newer_echoes_count_again():
    robot = Guarded()
    robot.send(SECOND_NS // 2, SECOND_NS)
    robot.run(1, HOME)
    assert robot.newest == HOME
    assert robot.guard.summary["implausible_commands"] == 0


def test_a_jump_of_the_commands_is_slowed_down_and_counted():
    robot = Guarded(limit_mm_s=500.0)
    robot.run(10, HOME)
    robot.run(900, (40.0, 0.0, 5.0))
    assert max(steps_mm(robot.positions)) == pytest.approx(0.5)
    assert max(steps_mm(robot.positions[11:])) == pytest.approx(0.05)
    assert robot.newest == (40.0, 0.0, 5.0)
    assert robot.guard.summary["slowed_ticks"] == pytest.approx(790, abs=1)


def stroke(robot, stalled, *, late_ticks=False):
    """Lead 1.5 s at 300 mm/s; commands of the stall come with the first one after it.

    With `late_ticks` the follower is what stalls: its ticks are made up for by one call.
    """
    missed = 0
    for k in range(1500):
        if k in stalled:
            missed += 1
            if not late_ticks:
                robot.positions.append(robot.guard.step(1, lambda: HOME))
            continue
        robot.guard.receive(*command(0.3 * k, 0.0, 5.0, time_ns=k * 1_000_000))
        elapsed = 1 + missed if late_ticks else 1
        robot.positions.append(robot.guard.step(elapsed, lambda: HOME))
        missed = 0
    return [position for position in robot.positions if position is not None]


@pytest.mark.parametrize("stall_ms", [80, 165, 500, 1000])
def test_after_a_stall_of_the_commands_it_recovers_at_its_rate_beyond_the_hand(stall_ms):
    positions = stroke(Guarded(), range(400, 400 + stall_ms))
    assert max(steps_mm(list(positions))) <= 0.35 + 1e-4
    travel = [b[0] - a[0] for a, b in zip(positions, positions[100:], strict=False)]
    assert max(travel) <= 35.0 + 1e-2


@pytest.mark.parametrize("stall_ms", [10, 80, 1000])
def test_after_missed_ticks_a_call_moves_by_no_more_than_the_limit_of_one(stall_ms):
    positions = stroke(Guarded(), range(400, 400 + stall_ms), late_ticks=True)
    steps = sorted(steps_mm(list(positions)))
    assert steps[-1] <= 1.0 + 1e-4
    assert steps[-2] <= 0.35 + 1e-4


@pytest.mark.parametrize("way", [1, -1])
def test_a_robot_that_is_behind_is_not_hastened_by_uneven_stamps(way):
    robot = Guarded(measured=(0.0, 0.0, 0.0))
    robot.run(1, (0.0, 0.0, 0.0))
    robot.guard.receive(*command(60.0 * way, 0.0, 0.0, time_ns=SECOND_NS))  # the hand is ahead
    for tick in range(1, 401):
        # ticks of the leader in pairs: two together, late, and the next pair right after it
        if tick % 2 == 0:
            late_ns = 900_000 if tick % 4 == 0 else 0
            place = (way * (60.0 + 0.2 * tick), 0.0, 0.0)
            robot.guard.receive(*command(*place, time_ns=SECOND_NS + tick * 1_000_000 + late_ns))
        robot.run(1)
    travelled_mm = way * (robot.newest[0] - robot.positions[100][0])
    assert 60.0 < travelled_mm < (0.2 + 0.05) * 300 + 0.5  # the hand's motion, and the recovery


def test_a_fast_stroke_along_the_surface_does_not_hasten_the_way_to_it():
    robot = Guarded()
    for k in range(200):
        robot.guard.receive(*command(0.3 * k, 0.0, 0.0, time_ns=k * 1_000_000))
        robot.positions.append(robot.guard.step(1, lambda: HOME))
    heights = np.array([position[2] for position in robot.positions if position is not None])
    assert np.abs(np.diff(heights)).max() <= 0.05 + 1e-9


coordinates = st.floats(-1e6, 1e6)


@given(
    st.sampled_from(["hold", "retract"]),
    st.lists(
        st.tuples(
            st.none() | st.tuples(coordinates, coordinates, coordinates), st.integers(1, 120)
        ),
        max_size=60,
    ),
)
def test_whatever_comes_and_whenever_the_robot_never_jumps(on_silence, ticks):
    robot = Guarded(on_silence=on_silence)
    limit_mm = Link().limit_mm_s / 1000.0
    before = HOME
    for position, elapsed in ticks:
        if position is not None:
            robot.guard.receive(*command(*position))
        after = robot.guard.step(elapsed, lambda: HOME)
        if after is None:
            continue
        assert math.dist(before, after) <= limit_mm * (1 + 1e-6) + 1e-9
        before = after


@pytest.mark.parametrize("along", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.6, -0.8)])
def test_on_each_axis_the_robot_begins_and_recovers_at_its_rate_beyond_the_hand(along):
    """The hand goes at 300 mm/s and commands every second tick, with a silence in between."""
    robot = Guarded(silence_ms=50.0)
    start = np.add(HOME, np.multiply(3.0, along))
    robot.run(150, tuple(start.tolist()))
    for k in range(0, 1300, 2):
        if not 300 <= k < 400:
            x, y, z = start + 0.3 * k * np.array(along)
            robot.guard.receive(*command(x, y, z, time_ns=k * 1_000_000))
        robot.run(2)
    ways = np.dot(np.subtract(robot.positions[1:], robot.positions[:-1]), along)
    assert ways[:20] == pytest.approx(np.full(20, 0.05))
    assert ways.max() <= 0.35 + 1e-4
    assert ways.min() >= 0.0
    assert max(steps_mm(robot.positions)) == pytest.approx(ways.max(), abs=1e-4)
    assert robot.newest == pytest.approx(tuple(start + 0.3 * 1298 * np.array(along)), abs=0.3)


@pytest.mark.parametrize(
    ("silence_ms", "rate_hz", "ticks"), [(1000.0, 1000.0, 1000), (10.0, 100.0, 1)]
)
def test_silence_is_counted_in_ticks(silence_ms, rate_hz, ticks):
    robot = Guarded(silence_ms=silence_ms, rate_hz=rate_hz)
    robot.run(1, HOME)
    robot.run(ticks - 1)
    assert robot.guard.summary["silences"] == 0
    robot.run(1)
    assert robot.guard.summary["silences"] == 1
    robot.run(1, HOME)
    robot.run(ticks)
    assert robot.guard.summary["silences"] == 2


def test_missed_ticks_count_for_the_retraction_and_the_recovery():
    robot = Guarded(on_silence="retract", silence_ms=10.0)
    robot.guard.receive(*command(9.0, 0.0, 5.0))
    assert robot.guard.step(4, lambda: HOME) == pytest.approx((4 * 0.05, 0.0, 5.0))
    robot.run(10)
    before = robot.newest
    after = robot.guard.step(4, lambda: HOME)
    assert after[2] - before[2] == pytest.approx(4 * 0.05)


BOX_MM = ((-10.0, -10.0, 0.0), (10.0, 10.0, 12.0))


def test_commands_outside_the_workspace_are_clipped_counted_and_said_when_they_leave_it(
    monkeypatch,
):
    monkeypatch.setattr("mmt.follower.command_guard.RepeatLimit", lambda: RepeatLimit(0.0))
    robot = Guarded(box_mm=BOX_MM, recovery_mm_s=1000.0)
    robot.run(5, HOME)
    robot.run(60, (30.0, 3.0, -40.0))
    assert robot.newest == (10.0, 3.0, 0.0)
    assert robot.guard.summary["clipped_commands"] == 60
    assert robot.said == ["commanded to (30, 3, -40) mm, outside workspace_mm: clipped"]
    for _ in range(2):
        robot.run(60, HOME)
        assert robot.newest == HOME
        robot.run(5, (30.0, 0.0, 5.0))
    assert robot.said[1:] == ["commanded to (30, 0, 5) mm, outside workspace_mm: clipped"] * 2
    assert robot.guard.summary["clipped_commands"] == 70


def test_a_retraction_ends_at_the_workspace():
    robot = Guarded(box_mm=BOX_MM, on_silence="retract", retract_mm=50.0, recovery_mm_s=100.0)
    robot.run(20, HOME)
    robot.run(400)
    assert robot.newest == pytest.approx((0.0, 0.0, 12.0))


def test_a_robot_outside_its_workspace_comes_in_at_the_recovery_speed():
    robot = Guarded(measured=(30.0, 0.0, 5.0), box_mm=BOX_MM, recovery_mm_s=50.0)
    robot.run(500, (40.0, 0.0, 5.0))
    assert robot.newest == pytest.approx((10.0, 0.0, 5.0))
    assert robot.said == ["commanded to (40, 0, 5) mm, outside workspace_mm: clipped"]
    assert max(steps_mm(robot.positions)) <= 0.05 + 1e-9


@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_counts_as_none(broken):
    robot = Guarded()
    robot.run(20, HOME)
    robot.run(300, (broken, 0.0, 0.0))
    assert set(robot.positions) == {HOME}
    assert robot.guard.summary["silences"] == 1


@pytest.mark.parametrize("measures_position", [True, False])
def test_a_halt_holds_whatever_the_leader_commands_and_is_no_silence(measures_position):
    robot = Guarded(measures_position=measures_position)
    for halts in (1, 2):
        robot.positions.clear()
        robot.run(20, HOME)
        robot.guard.halt("hold")
        robot.guard.halt("hold")
        robot.run(100, (50.0, 0.0, 0.0))
        robot.run(100)
        assert set(robot.positions) == {HOME}
        robot.guard.release()
        summary = robot.guard.summary
        assert (summary["halts"], summary["halted_s"]) == (halts, pytest.approx(0.2 * halts))
        assert (summary["silences"], summary["silent_s"], robot.said) == (0, 0.0, [])
    robot.run(5)
    assert robot.positions[-5:] == [HOME] * 5  # what was commanded meanwhile is forgotten
    assert robot.guard.summary["silent_s"] == pytest.approx(0.005)
    for k in range(100):  # the hand is followed at its own speed
        robot.guard.receive(*command(0.3 * k, 0.0, 5.0, time_ns=k * 1_000_000))
        robot.run(1)
    assert robot.newest == pytest.approx((29.7, 0.0, 5.0))


def test_a_halt_retracts_along_the_normal_where_the_scene_says_so():
    robot = Guarded(normal="x", on_silence="hold", retract_mm=5.0, recovery_mm_s=100.0)
    robot.run(20, HOME)
    robot.guard.halt("retract")
    robot.run(30, HOME)
    robot.guard.halt("retract")  # a second device is lost on the way
    robot.run(100, HOME)
    assert robot.newest == pytest.approx((5.0, 0.0, 5.0))
    assert max(steps_mm(robot.positions)) <= 0.1 + 1e-9


@pytest.mark.parametrize("measured", [HOME, (3.0, 0.0, 5.0)])
def test_a_robot_that_was_lost_gets_no_position_and_then_begins_where_it_is(measured):
    robot = Guarded(recovery_mm_s=50.0)
    robot.run(20, HOME)
    robot.guard.halt("hold")
    robot.guard.halt("hold", of_robot=True)  # while a sensor is still lost
    robot.positions.clear()
    robot.run(100, (10.0, 0.0, 5.0))
    robot.guard.release()
    robot.run(100)
    assert set(robot.positions) == {None}
    robot.measured = measured
    robot.positions.clear()
    robot.run(1000, (10.0, 0.0, 5.0))
    assert math.dist(robot.positions[0], measured) <= 0.05 + 1e-9
    assert max(steps_mm(robot.positions)) <= 0.05 + 1e-9
    assert robot.newest == pytest.approx((10.0, 0.0, 5.0))


def test_a_halt_before_the_first_command_commands_nothing():
    robot = Guarded()
    robot.guard.halt("retract")
    robot.run(50, HOME)
    assert set(robot.positions) == {None}
    robot.guard.release()
    robot.run(5, HOME)
    assert robot.newest == HOME
