"""A memory of forces over depth and speed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.contact.force_map import ForceMap, SmoothSpeed


def stroke(memory, speed_m_s, offset_n=0.0, times=1):
    """Pass over 10 mm at a speed, where the force is bilinear in depth and speed."""
    for _ in range(times):
        for tick in range(1000):
            depth_m = 1e-5 * tick
            memory.add(depth_m, speed_m_s, bilinear(depth_m, speed_m_s) + offset_n)


def bilinear(depth_m, speed_m_s):
    return 500.0 * depth_m + 10.0 * speed_m_s


@pytest.mark.parametrize("speed_m_s", [-0.2, 0.1, 0.2])
def test_what_was_met_is_recalled_at_its_place_and_speed(speed_m_s):
    memory = ForceMap()
    stroke(memory, 0.2)
    stroke(memory, 0.1)
    stroke(memory, -0.2)
    for depth_m in (1e-3, 4.1e-3, 8.3e-3):
        force_n, weight = memory.look_up(depth_m, speed_m_s)
        assert force_n == pytest.approx(bilinear(depth_m, speed_m_s), abs=0.1)
        assert weight > 0.8


def test_where_the_tool_has_not_been_nothing_is_believed():
    memory = ForceMap()
    assert memory.look_up(0.0, 0.1) == (0.0, 0.0)
    stroke(memory, 0.2)
    assert memory.look_up(5e-3, -0.2) == (0.0, 0.0)
    assert memory.look_up(20e-3, 0.2) == (0.0, 0.0)


def test_slow_motion_is_left_to_the_model():
    memory = ForceMap()
    for speed_m_s in (0.0, 0.02, 0.1):
        stroke(memory, speed_m_s)
    weights = [memory.look_up(5e-3, speed_m_s)[1] for speed_m_s in (0.0, 1e-4, 0.02, 0.1)]
    assert weights[0] == 0.0
    assert weights == sorted(weights)
    assert weights[1] < 1e-4
    assert weights[3] > 0.8


def test_newer_samples_replace_older_ones():
    memory = ForceMap()
    stroke(memory, 0.2, times=20)
    stroke(memory, 0.2, offset_n=5.0, times=2)
    force_n, _ = memory.look_up(5e-3, 0.2)
    assert force_n == pytest.approx(bilinear(5e-3, 0.2) + 5.0, abs=0.2)


@given(
    st.lists(
        st.tuples(st.floats(), st.floats(), st.floats(-50.0, 50.0) | st.just(math.nan)),
        min_size=1,
        max_size=100,
    ),
    st.floats(),
    st.floats(),
)
def test_any_data_give_a_force_within_what_was_met(data, depth_m, speed_m_s):
    memory = ForceMap()
    for sample in data:
        memory.add(*sample)
    met = [sample[2] for sample in data if math.isfinite(sample[2])]
    for place in [(depth_m, speed_m_s), *(sample[:2] for sample in data)]:
        force_n, weight = memory.look_up(*place)
        assert 0.0 <= weight <= 1.0
        if weight > 0.0:
            assert min(met) - 1e-9 <= force_n <= max(met) + 1e-9


def test_a_long_way_does_not_fill_the_memory_without_bound():
    memory = ForceMap()
    for tick in range(12_000):
        memory.add(5e-4 * tick, 0.01, 1.0)
    assert memory.look_up(5e-4 * 11_999, 0.2)[1] == 0.0
    assert memory.look_up(5e-4 * 11_999, 0.01)[0] == pytest.approx(1.0)
    assert memory.look_up(0.0, 0.01) == (0.0, 0.0)


@pytest.mark.parametrize("period_s", [1e-3, 5e-3])
def test_a_steady_speed_is_found(period_s):
    speed = SmoothSpeed()
    last = [speed.step(0.1 * period_s * tick, period_s) for tick in range(200)][-1]
    assert last == pytest.approx(0.1)
    assert SmoothSpeed().step(3.0, period_s) == 0.0


def test_a_place_that_is_not_finite_leaves_the_speed():
    speed = SmoothSpeed()
    for tick in range(200):
        speed.step(1e-4 * tick, 1e-3)
    assert speed.step(math.nan, 1e-3) == 0.0
    assert speed.step(0.02, 1e-3) == pytest.approx(0.1, rel=0.01)
