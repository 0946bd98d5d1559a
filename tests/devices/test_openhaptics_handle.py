"""The leader's handle through OpenHaptics HD, against the emulated library."""

import math

import pytest
from emulated_arm import emulated_arm
from waiting import until, until_lost

from mmt.core.errors import DeviceLost, InputError
from mmt.devices.drivers import load_device
from mmt.testing.emulated.openhaptics.phantom import VirtualPhantomHandle

emulated = emulated_arm


@pytest.fixture
def make(emulated, connected):
    def handle(**options):
        options = {"library": emulated.address, **options}
        made = connected(load_device("openhaptics", options, role="handle"))
        made.calibrate()
        return made

    return handle


def test_the_handle_says_where_it_is_and_how_it_moves(make, emulated):
    handle = make(origin_mm=(0.0, 0.0, -30.0))
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 30.0))
    emulated.hold((0.0, 100.0, 0.0), 0.2)
    until(lambda: handle.read(1).velocity_mm_s[2] > 50.0)
    until(lambda: handle.read(1).position_mm[2] == pytest.approx(130.0, abs=0.1))
    assert handle.read(1).force_n == 0.0


def test_a_displayed_force_reaches_the_hand_and_fades_as_commands_stop(make, emulated):
    handle = make()
    emulated.hold((0.0, 0.0, 0.0), 0.5)
    until(
        lambda: handle.read(1).position_mm == pytest.approx((0.6, 0.4, 2.0), abs=0.05),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    # the display reaches the full force by a ramp, which a held-up thread is late with
    until(
        lambda: emulated.tip_state().motor_n == pytest.approx((0.3, 1.0, -0.2)),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    assert handle.faults == {"stale commands": 1}


def test_the_displayed_force_is_cut_to_the_devices_limit(make, emulated):
    emulated.limits(2.0, 3.5)
    handle = make(force_limit_n=10.0)
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    until(
        lambda: math.hypot(*emulated.tip_state().motor_n) > 2.0 - 1e-9,
        lambda: handle.write((0.0, 80.0, 60.0)),
    )
    assert math.hypot(*emulated.tip_state().motor_n) <= 2.0 + 1e-9
    for force in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        handle.write(force)
    assert handle.faults["commands that are not finite"] == 2
    handle.connect()
    assert handle.faults["commands that are not finite"] == 2
    assert emulated.tip_state().motor_n[1] <= 1.2 + 1e-9


def test_three_limits_hold_along_each_of_the_scenes_axes(make, emulated):
    """Friction takes nothing from the pressure: along the normal 3 N stay 3 N."""
    handle = make(force_limit_n=[1.0, 2.0, 3.0])
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    until(
        lambda: emulated.tip_state().motor_n == pytest.approx((1.0, 3.0, 2.0), abs=1e-6),
        lambda: handle.write((5.0, -9.0, 3.0)),
    )


def test_a_handle_that_does_not_answer_is_lost_and_comes_back(make, emulated):
    handle = make()
    emulated.unplug()
    until_lost(lambda: handle.read(1), "does not answer")
    with pytest.raises(DeviceLost):
        handle.write((0.0, 0.0, 1.0))
    handle.close()
    with pytest.raises(DeviceLost, match="not connected"):
        handle.read(1)
    emulated.plug()
    handle.connect()
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize("axes", ["x,y", "x,y,-z", 3])
def test_axes_that_are_none_are_explained_by_the_emulated_handle_too(axes):
    with pytest.raises(InputError, match="axes"):
        VirtualPhantomHandle(axes=axes)
