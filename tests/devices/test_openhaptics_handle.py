"""The leader's handle through OpenHaptics HD, against the emulated library."""

import math
from collections.abc import Callable, Iterator

import pytest
from emulated_arm import emulated_arm, until
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.errors import DeviceLost, InputError
from mmt.devices.drivers import load_device
from mmt.devices.hand_force import HandForce
from mmt.devices.openhaptics.handle import OpenHapticsHandle
from mmt.testing.emulated.hd import EmulatedHd

emulated = emulated_arm


@pytest.fixture
def make(emulated: EmulatedHd) -> Iterator[Callable[..., OpenHapticsHandle]]:
    made = []

    def handle(**options: object) -> OpenHapticsHandle:
        options = {"library": emulated.address, **options}
        made.append(load_device("openhaptics", options, role="handle"))
        made[-1].connect()
        made[-1].calibrate()
        return made[-1]

    yield handle
    for each in made:
        each.close()


def test_the_handle_says_where_it_is_and_how_it_moves(make, emulated) -> None:
    handle = make(origin_mm=(0.0, 0.0, -30.0))
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 30.0))
    emulated.hold((0.0, 100.0, 0.0), 0.2)
    until(lambda: handle.read(1).velocity_mm_s[2] > 50.0)
    until(lambda: handle.read(1).position_mm[2] == pytest.approx(130.0, abs=0.1))
    assert handle.read(1).force_n == 0.0


def test_a_displayed_force_reaches_the_hand_and_is_what_it_presses_with(make, emulated) -> None:
    handle = make()
    emulated.hold((0.0, 0.0, 0.0), 0.5)
    until(lambda: handle.read(1).force_n > 0.99, lambda: handle.write((0.3, 0.2, 1.0)))
    assert handle.read(1).contact
    until(
        lambda: handle.read(1).position_mm == pytest.approx((0.6, 0.4, 2.0), abs=0.05),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    # the display reaches the full force by a ramp, which a held-up thread is late with
    until(
        lambda: emulated.look().motor_n == pytest.approx((0.3, 1.0, -0.2)),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    until(lambda: handle.read(1).force_n == 0.0)  # commands have stopped
    assert handle.faults == {"stale commands": 1}
    assert not handle.read(1).contact


def test_the_displayed_force_is_cut_to_the_devices_limit(make, emulated) -> None:
    emulated.limits(2.0, 3.5)
    handle = make(force_limit_n=10.0)
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    until(
        lambda: math.hypot(*emulated.look().motor_n) > 2.0 - 1e-9,
        lambda: handle.write((0.0, 80.0, 60.0)),
    )
    assert math.hypot(*emulated.look().motor_n) <= 2.0 + 1e-9
    for force in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        handle.write(force)
    assert handle.faults["commands that are not finite"] == 2
    handle.connect()
    assert handle.faults["commands that are not finite"] == 2
    assert emulated.look().motor_n[1] <= 1.2 + 1e-9


def test_where_no_force_is_displayed_the_depth_tells_how_hard_the_hand_presses(
    make, emulated
) -> None:
    handle = make(hand_force="depth", depth_stiffness_n_mm=0.4)
    emulated.place((0.0, -5.0, 0.0))
    until(lambda: handle.read(1).force_n == pytest.approx(2.0))
    assert handle.read(1).contact
    emulated.place((0.0, 1.0, 0.0))
    until(lambda: handle.read(1).force_n == 0.0)


def test_a_handle_that_does_not_answer_is_lost_and_comes_back(make, emulated) -> None:
    handle = make()
    emulated.unplug()
    with pytest.raises(DeviceLost, match="does not answer"):
        until(lambda: False, lambda: handle.read(1))
    with pytest.raises(DeviceLost):
        handle.write((0.0, 0.0, 1.0))
    handle.close()
    with pytest.raises(DeviceLost, match="not connected"):
        handle.read(1)
    emulated.plug()
    handle.connect()
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 0.0))


def test_the_robots_gains_are_no_options_of_the_handle() -> None:
    with pytest.raises(InputError, match="stiffness_n_mm is not a key; allowed are library"):
        load_device("openhaptics", {"stiffness_n_mm": 1.0}, role="handle")


def test_a_hand_that_accelerates_the_handle_is_told_from_one_that_presses() -> None:
    """A hand that presses with F cos(wt) on a mass that displays nothing."""
    mass_kg, force_n, rate = 0.08, 1.0, 2 * math.pi * 1.5
    hand = HandForce(mass_kg)
    errors = []
    for tick in range(3000):
        t = 1e-3 * tick
        velocity_mm_s = -1e3 * force_n / (mass_kg * rate) * math.sin(rate * t)
        felt = hand.estimate(0.0, velocity_mm_s, round(1e9 * t))
        if t > 0.5:
            errors.append(felt - max(force_n * math.cos(rate * t), 0.0))
    assert max(map(abs, errors)) < 0.12  # 10 ms of smoothing at 1.5 Hz


@given(
    st.floats(0.0, 1.0),
    st.lists(st.tuples(*[st.floats(-1e4, 1e4)] * 2, st.integers(0, 10**10)), max_size=30),
)
def test_the_hands_force_is_a_number_and_never_negative(mass_kg, course) -> None:
    hand = HandForce(mass_kg)
    for displayed_n, velocity_mm_s, time_ns in course:
        force_n = hand.estimate(displayed_n, velocity_mm_s, time_ns)
        assert force_n >= 0.0
        assert math.isfinite(force_n)
