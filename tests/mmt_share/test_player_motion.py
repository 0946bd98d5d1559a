"""What velocity and force a pointer is taken to have."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt_share.player.motion import FASTEST_MM_S, PointerMotion

numbers = st.floats(-1e4, 1e4)


def stroked(interval_ms: float, speed_mm_s: float, reports: int = 40) -> PointerMotion:
    motion = PointerMotion()
    for report in range(reports):
        now_ms = 1000.0 + report * interval_ms
        x_mm = 1e-3 * speed_mm_s * now_ms
        motion.follow([(now_ms, x_mm, -x_mm, 1.5)], now_ms)
    return motion


@pytest.mark.parametrize("interval_ms", [4.0, 8.3, 16.7, 33.3])
def test_a_steady_stroke_has_its_speed_and_force(interval_ms: float) -> None:
    motion = stroked(interval_ms, 150.0)
    assert motion.velocity_mm_s == pytest.approx((150.0, -150.0), rel=1e-3)
    assert motion.force_n == pytest.approx(1.5)
    assert motion.touches


def test_reports_that_come_together_count_as_those_that_come_one_by_one() -> None:
    points = [(10.0 * n, 0.1 * n * n, 1.0 * n, 0.1 * n) for n in range(12)]
    together, apart = PointerMotion(), PointerMotion()
    together.follow(points, 110.0)
    for point in points:
        apart.follow([point], point[0])
    assert together.velocity_mm_s == pytest.approx(apart.velocity_mm_s)
    assert together.force_n == pytest.approx(apart.force_n)


def test_the_velocity_is_held_between_reports_and_dies_away_after_the_last() -> None:
    motion = stroked(16.0, 100.0)
    last_ms = 1000.0 + 39 * 16.0
    motion.follow([], last_ms + 20.0)
    assert motion.velocity_mm_s[0] == pytest.approx(100.0, rel=1e-3)
    for later_ms in range(20, 300, 5):
        motion.follow([], last_ms + later_ms)
    assert math.hypot(*motion.velocity_mm_s) < 1e-3
    assert motion.touches


def test_a_pointer_that_is_put_down_elsewhere_has_not_moved_there() -> None:
    motion = stroked(16.0, 100.0)
    motion.lift()
    assert (motion.velocity_mm_s, motion.force_n, motion.touches) == ((0.0, 0.0), 0.0, False)
    motion.follow([(5000.0, 900.0, 900.0, 2.0)], 5000.0)
    assert motion.velocity_mm_s == (0.0, 0.0)
    assert motion.force_n == 2.0


@given(st.lists(st.tuples(st.floats(0, 1e6), numbers, numbers, st.floats(0, 100)), max_size=20))
def test_whatever_is_reported_velocity_and_force_stay_bounded(
    points: list[tuple[float, float, float, float]],
) -> None:
    motion = PointerMotion()
    for point in points:
        motion.follow([point, point], point[0])
        assert math.hypot(*motion.velocity_mm_s) <= FASTEST_MM_S * (1 + 1e-9)
        assert 0.0 <= motion.force_n <= 100.0 * (1 + 1e-9)
