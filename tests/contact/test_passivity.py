"""The ports give out no more than was put in, whatever hand, force, delay and loss do."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mmt.contact.passivity import REACH_M_S2, ForcePort, MotionPort, PassivitySettings
from mmt.core.errors import InputError

SETTINGS = PassivitySettings()
REACH_M = REACH_M_S2 * SETTINGS.tick_s**2

forces = st.floats(-50.0, 50.0)
"""Wanted force of a tick."""


class Account:
    """An independent account of the hand's work on a port."""

    def __init__(self):
        self.net_j = 0.0
        self.least_j = 0.0
        self.largest_j = 0.0
        self._force = self._position = 0.0

    def move(self, position_m, force_n):
        work = -self._force * (position_m - self._position)
        self.net_j += work
        self.least_j = min(self.least_j, self.net_j)
        self.largest_j = max(self.largest_j, abs(work))
        self._position, self._force = position_m, force_n


@given(st.lists(st.tuples(forces, st.floats(-1.0, 1.0)), max_size=120))
def test_a_hand_within_reach_never_gets_more_than_the_reserve(ticks):
    """Any forces, any motion whose acceleration is below what is expected of a hand."""
    port, account = ForcePort(SETTINGS), Account()
    position = travel = 0.0
    for wanted, push in ticks:
        travel += push * REACH_M
        position += travel
        account.move(position, port.step(wanted, position))
    assert account.least_j >= -SETTINGS.reserve_j * (1 + 1e-6)
    assert port.overdrawn_j == 0.0
    assert port.in_j - port.out_j == pytest.approx(account.net_j, abs=1e-9)


@given(st.lists(st.tuples(forces, st.floats(-0.5, 0.5)), max_size=120))
@example([(50.0, 0.0), (50.0, 0.5), (50.0, -0.5)] * 20)
def test_any_jump_overdraws_at_most_its_own_work_and_that_is_told(ticks):
    """Positions that no hand takes, half a metre from tick to tick."""
    port, account = ForcePort(SETTINGS), Account()
    overdrawn = jumps = 0
    for wanted, position in ticks:
        account.move(position, port.step(wanted, position))
        jumps += port.overdrawn_j > overdrawn
        overdrawn = port.overdrawn_j
    allowed = SETTINGS.reserve_j + jumps * (SETTINGS.reserve_j + account.largest_j)
    assert account.least_j >= -allowed * (1 + 1e-6)
    assert account.least_j >= -(SETTINGS.reserve_j + port.overdrawn_j) * (1 + 1e-6)


@given(
    st.lists(
        st.tuples(forces, st.floats(-1.0, 1.0), st.floats(0.0, 1e-3), st.booleans()), max_size=120
    )
)
def test_it_gives_no_more_than_the_other_side_gave_however_late_its_counts_come(ticks):
    port, account = ForcePort(SETTINGS), Account()
    position = travel = given_j = heard_j = 0.0
    for wanted, push, more_j, lost in ticks:
        given_j += more_j
        heard_j = heard_j if lost else given_j
        travel += push * REACH_M
        position += travel
        account.move(position, port.step(wanted, position, heard_j))
        assert port.out_j <= heard_j + SETTINGS.reserve_j * (1 + 1e-6)
    assert account.least_j >= -SETTINGS.reserve_j * (1 + 1e-6)


def test_a_spring_is_displayed_as_it_is():
    """What gives back only what it got is not touched: 1 N/mm, 10 mm there and back."""
    port = ForcePort(SETTINGS)

    def depth_m(tick):
        return 0.005 * (1.0 - math.cos(2.0 * math.pi * tick / 200))

    port.step(0.0, 0.0)
    for tick in range(1, 600):
        wanted = -1000.0 * depth_m(tick + 0.5)  # the middle of the tick for which it is held
        assert port.step(wanted, depth_m(tick)) == pytest.approx(wanted, abs=0.02)


def test_a_port_that_gave_its_reserve_away_is_of_use_again_once_energy_comes():
    port = ForcePort(SETTINGS)
    position = 0.0
    for _ in range(500):
        position += 5e-5
        port.step(5.0, position)  # pushes the way the hand goes
    assert abs(port.step(5.0, position + 5e-5)) < 0.05
    for _ in range(200):
        position -= 5e-5
        force = port.step(5.0, position)
    assert force == pytest.approx(5.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_no_motion_and_no_force(bad):
    port = ForcePort(SETTINGS)
    port.step(1.0, 0.0)
    port.step(1.0, 0.0)
    assert math.isfinite(port.step(1.0, bad))
    assert port.step(bad, 0.0) == 0.0
    assert port.in_j == port.out_j == 0.0


def test_missed_ticks_count_with_all_their_work():
    port = ForcePort(SETTINGS)
    port.step(-1.0, 0.0)
    port.step(-1.0, 0.0)
    port.step(-1.0, 5e-4, ticks=5)
    assert port.in_j == pytest.approx(5e-4)


def test_over_missed_ticks_the_damper_takes_the_speed_of_the_whole_time():
    """0.1 mm in 5 ms is 20 mm/s: at most 10 N s/m brake by 0.2 N."""
    port = ForcePort(SETTINGS)
    port.step(0.0, 0.0)
    assert port.step(1.0, 1e-4, ticks=5) == pytest.approx(1.0 - 10.0 * 1e-4 / 5e-3)


def test_after_a_rest_it_begins_at_a_new_position():
    """The way during the rest is neither a speed to be damped nor work."""
    port = ForcePort(SETTINGS)
    port.step(0.0, 0.0)
    port.step(-1.0, 1e-4)
    port.pause()
    assert port.step(-1.0, 0.05) == 0.0
    assert port.step(-1.0, 0.05) == pytest.approx(-1.0)
    assert port.in_j == port.out_j == 0.0


@given(
    st.lists(st.tuples(st.floats(-2e-4, 2e-4), st.floats(0.0, 20.0)), min_size=1, max_size=120),
    st.floats(0.0, 1e-2),
)
def test_a_surface_gets_what_was_sent_and_the_reserve_while_there_is_drift_left(ticks, given_j):
    """A force that only pushes; overdrawn by no more than the work of a tick at each touch."""
    settings = PassivitySettings(drift_m=1e9)
    port = MotionPort(settings)
    wanted = command = force = touches = 0.0
    largest = out = 0.0
    port.step(0.0, given_j)
    for step, next_force in ticks:
        wanted += step
        now = port.step(wanted, given_j)
        rise = max(0.0, next_force - max(force, 0.05))
        work = -next_force * (now - command)
        out += max(0.0, work)
        touches += rise > 0.0
        largest = max(largest, abs(work))
        port.measure(next_force)
        command, force = now, next_force
    assert out <= given_j + settings.reserve_j + touches * largest + 0.05 * 2e-4 * len(ticks)


def test_free_motion_is_followed_exactly():
    port = MotionPort(SETTINGS)
    for step in range(1000):
        wanted = 0.05 * math.sin(step / 100)
        assert port.step(wanted, 0.0) == pytest.approx(wanted)
        port.measure(0.03 * math.sin(step))
    assert port.largest_drift_m == pytest.approx(0.0)
    assert port.in_j == port.out_j == 0.0


def test_first_contact_is_held_back_until_the_leader_pays_then_caught_up():
    port = MotionPort(SETTINGS)
    command = 0.0
    for step in range(100):
        command = port.step(-5e-5 * step, 0.0)
        port.measure(max(0.0, -5000.0 * command))
    assert port.drift_m == pytest.approx(SETTINGS.drift_m)
    for _ in range(500):
        command = port.step(-5e-3, 1.0)
        port.measure(max(0.0, -5000.0 * command))
    assert command == pytest.approx(-5e-3, abs=1e-5)


def test_catching_up_is_slow_however_far_the_command_was_held_back():
    port = MotionPort(PassivitySettings(drift_m=0.05))
    for step in range(1000):
        port.step(-4e-5 * step, 0.0)
        port.measure(50.0)
    held = port.step(-0.04, 0.0)
    assert port.drift_m > 0.03
    port.measure(0.0)
    assert port.step(-0.04, 0.0) == pytest.approx(held - 5e-5)


def test_a_robot_that_seems_to_return_more_than_it_got_is_not_believed():
    port = MotionPort(SETTINGS)
    for step in range(200):
        port.step(1e-4 * step, 1.0)  # moves away while pushed all the time
        port.measure(5.0)
    assert port.in_j == port.out_j == 0.0


@pytest.mark.parametrize(
    "wrong", [{"reserve_j": 0.0}, {"tick_s": math.nan}, {"damping_n_s_m": -1.0}, {"drift_m": -1.0}]
)
def test_bounds_out_of_range_are_named(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        PassivitySettings(**wrong)


UNDAMPED = PassivitySettings(reserve_j=1e-3, damping_n_s_m=0.0, drift_m=3e-3, tick_s=1e-3)
"""For accounts by hand: a reserve of 1 mJ, ticks of 1 ms, no damper."""


def test_the_bound_of_the_force_and_what_it_withholds():
    """Over 0.1 mm at rest, and as much and twice the last travel in motion."""
    for displayed_n, dissipated_j in ((None, 1e-3 / 3), (1.0, 4e-4)):
        port = ForcePort(UNDAMPED)
        assert port.step(5.0, 0.0) == 0.0
        assert port.step(5.0, 0.0) == 5.0
        assert port.step(5.0, 1e-4) == pytest.approx(5e-4 / 3e-4)
        assert (port.in_j, port.out_j) == (0.0, pytest.approx(5e-4))
        assert port.dissipated_j == 0.0
        if displayed_n is not None:
            port.displayed(displayed_n)
        port.step(5.0, 2e-4)
        assert port.dissipated_j == pytest.approx(dissipated_j)


def test_a_tick_beyond_the_reach_is_written_off_with_all_its_work():
    port = ForcePort(UNDAMPED)
    port.step(5.0, 0.0)
    port.step(5.0, 0.0)
    port.step(5.0, 3e-4)
    assert port.overdrawn_j == port.out_j == pytest.approx(1.5e-3)
    port.step(5.0, 3e-4)
    assert port.overdrawn_j == port.out_j == pytest.approx(1.5e-3)


def test_a_motion_is_held_back_to_what_the_reserve_pays():
    port = MotionPort(UNDAMPED)
    assert port.step(math.nan, 0.0) == 0.0
    port.measure(2.0)
    assert port.step(-1e-3, 0.0) == pytest.approx(-0.5e-3)
    assert port.drift_m == port.largest_drift_m == pytest.approx(0.5e-3)


def test_without_a_force_a_motion_is_free_and_costs_nothing():
    for force_n in (None, math.nan):
        port = MotionPort(UNDAMPED)
        port.step(0.0, 0.0)
        if force_n is not None:
            port.measure(force_n)
        assert port.step(-0.01, 0.0) == -0.01
        assert port.step(math.nan, 0.0) == -0.01
        assert (port.in_j, port.out_j) == (0.0, 0.0)


def test_the_work_of_a_measured_force_is_over_all_steps_since_the_last_one():
    port = MotionPort(UNDAMPED)
    port.measure(3.0)
    assert (port.in_j, port.out_j) == (0.0, 0.0)
    port = MotionPort(UNDAMPED)
    for wanted_m in (0.0, 1e-3, 2e-3):
        port.step(wanted_m, 0.0)
    for _ in range(2):
        port.measure(-1.0)
        assert (port.in_j, port.out_j) == (0.0, pytest.approx(2e-3))


def test_a_port_may_neither_damp_nor_hold_back():
    port = MotionPort(PassivitySettings(damping_n_s_m=0.0, drift_m=0.0))
    port.step(0.0, 0.0)
    port.measure(50.0)
    assert port.step(-1.0, 0.0) == -1.0
