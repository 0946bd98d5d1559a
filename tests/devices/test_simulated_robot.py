"""The robot: bandwidth in free motion, force under contact, every stiffness."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.scene import Simulated
from mmt.testing.simulation import nominal_compliance_mm_n
from mmt.testing.simulation.robot import SimulatedRobot


@pytest.mark.parametrize("bandwidth", [5.0, 15.0, 40.0])
def test_bandwidth_is_where_motion_is_3_db_down(bandwidth):
    robot = SimulatedRobot(Simulated(robot_bandwidth_hz=bandwidth), 0.3)
    omega = 2.0 * math.pi * bandwidth * 1e-3
    count = 4000
    path = [
        robot.advance((10.0 * math.sin(omega * n), 0.0, 5.0)).position_mm[0] for n in range(count)
    ]
    tail = np.array(path[count // 2 :])
    amplitude = np.sqrt(2.0) * np.sqrt(np.mean((tail - tail.mean()) ** 2))
    assert amplitude / 10.0 == pytest.approx(math.sqrt(0.5), rel=0.04)


def test_a_step_never_overshoots():
    robot = SimulatedRobot(Simulated(), 0.3)
    heights = [robot.advance((0.0, 0.0, 8.0)).position_mm[2] for _ in range(1000)]
    assert max(heights) <= 8.0 + 1e-9
    assert heights[-1] == pytest.approx(8.0, abs=1e-6)


@pytest.mark.parametrize("stiffness", [0.05, 0.5, 5.0, 50.0])
@pytest.mark.parametrize("force", [0.2, 1.0, 2.9])
def test_commanded_depth_gives_the_nominal_force(stiffness, force):
    table = Simulated(surface_stiffness_n_mm=stiffness)
    robot = SimulatedRobot(table, 0.3)
    depth = force * nominal_compliance_mm_n(table)
    for _ in range(3000):
        tip = robot.advance((0.0, 0.0, -depth))
    assert tip.force_n[2] == pytest.approx(force, rel=1e-3)
    assert tip.velocity_mm_s[2] == pytest.approx(0.0, abs=1e-3)


@settings(max_examples=40)
@given(st.floats(0.05, 50.0), st.floats(1.0, 60.0), st.integers(0, 10_000))
def test_stays_bounded_under_erratic_commands(stiffness, bandwidth, seed):
    robot = SimulatedRobot(
        Simulated(surface_stiffness_n_mm=stiffness, robot_bandwidth_hz=bandwidth), 0.5
    )
    commands = np.random.default_rng(seed).uniform(-50.0, 50.0, (400, 3)).tolist()
    for x, y, z in commands:
        tip = robot.advance((x, y, z))
        assert tip.force_n[2] >= 0.0
        assert np.abs(tip.position_mm).max() < 150.0


def test_sliding_drags_against_the_motion():
    table = Simulated()
    robot = SimulatedRobot(table, 0.3)
    depth = 2.0 * nominal_compliance_mm_n(table)
    for tick in range(1500):
        tip = robot.advance((0.08 * tick, -0.06 * tick, -depth))
    assert tip.velocity_mm_s[:2] == pytest.approx((80.0, -60.0), rel=3e-3)
    assert tip.force_n == pytest.approx((-0.48, 0.36, 2.0), rel=5e-3)


def test_acceleration_is_the_change_of_velocity():
    robot = SimulatedRobot(Simulated(), 0.3)
    before = (0.0, 0.0, 0.0)
    for tick in range(200):
        tip = robot.advance((0.3 * tick, 0.1 * tick, -2.0))
        change = [(a - b) for a, b in zip(tip.velocity_mm_s, before, strict=True)]
        assert tip.acceleration_m_s2 == pytest.approx(tuple(change), abs=1e-9)
        before = tip.velocity_mm_s
