"""A force goes out in a silence and comes in again, tick by tick."""

import pytest

from mmt.devices.protocols import Vector
from mmt.leader.motion.force_ramp import ForceRamp

FORCE_N = (1.0, 2.0, -4.0)


def shares(ramp: ForceRamp, ticks: int, force_n: Vector = FORCE_N, elapsed: int = 1) -> list[float]:
    """Shape a force in each tick and return which share of it is displayed on all axes."""
    found = []
    for _ in range(ticks):
        shown = ramp.shape(force_n, elapsed)
        assert shown == pytest.approx(tuple(shown[0] / force_n[0] * each for each in force_n))
        found.append(shown[0] / force_n[0])
    return found


def test_the_force_goes_out_after_a_silence_and_in_over_the_ramp() -> None:
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    for _ in range(2):
        assert shares(ramp, 7) == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0]
        assert ramp.silent
        ramp.renew()
        assert not ramp.silent
        assert shares(ramp, 1) == [0.25]
        for share in (0.5, 0.75, 1.0, 1.0):
            ramp.renew()
            assert shares(ramp, 1) == [share]
        ramp.renew()


def test_it_comes_in_from_what_is_displayed_on_each_axis() -> None:
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    shares(ramp, 4)  # half of it is left
    ramp.renew()
    shown = ramp.shape((9.0, 8.0, 7.0), 1)
    assert shown == pytest.approx((0.75 * 0.5 + 9 / 4, 0.75 * 1.0 + 2.0, -0.75 * 2.0 + 7 / 4))


def test_missed_ticks_count_for_the_silence_alone() -> None:
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    assert shares(ramp, 3, elapsed=50) == [0.75, 0.5, 0.25]


def test_a_source_that_has_left_is_silent_at_once() -> None:
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    ramp.fall_silent()
    assert ramp.silent
    assert shares(ramp, 5) == [0.75, 0.5, 0.25, 0.0, 0.0]


def test_after_a_rest_the_force_returns_from_zero() -> None:
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    shares(ramp, 1)
    ramp.pause(1)
    assert not ramp.silent
    ramp.renew()
    assert shares(ramp, 1) == [0.25]
    ramp.renew()
    ramp.pause(1)
    ramp.pause(2)
    assert ramp.silent
    ramp.renew()
    assert shares(ramp, 2) == [0.25, 0.5]
