"""The simulated robot, its forces at every stiffness, its sensors, and the actuator."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.scene import Simulated
from mmt.testing.simulation import nominal_compliance_mm_n
from mmt.testing.simulation.actuator import SimulatedActuator
from mmt.testing.simulation.instruments import (
    ACCELERATION_RANGE_M_S2,
    ACCELERATION_RESOLUTION_M_S2,
    GRAVITY_M_S2,
    TILT_RAD,
    Encoder,
    ForceGauge,
    TiltedAccelerometer,
)
from mmt.testing.simulation.robot import SimulatedRobot


@pytest.mark.parametrize("bandwidth", [5.0, 15.0, 40.0])
def test_bandwidth_is_where_motion_is_3_db_down_and_a_step_never_overshoots(bandwidth):
    robot = SimulatedRobot(Simulated(robot_bandwidth_hz=bandwidth), 0.3)
    wanted = 10.0 * np.sin(2.0 * math.pi * bandwidth * 1e-3 * np.arange(4000))
    path = [robot.advance((x, 0.0, 5.0)).position_mm[0] for x in wanted.tolist()]
    assert np.std(path[2000:]) / np.std(wanted[2000:]) == pytest.approx(math.sqrt(0.5), rel=0.04)
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


def test_sliding_drags_against_the_motion_and_acceleration_is_the_change_of_velocity():
    table = Simulated()
    robot = SimulatedRobot(table, 0.3)
    depth, before = 2.0 * nominal_compliance_mm_n(table), (0.0, 0.0, 0.0)
    for tick in range(1500):
        tip = robot.advance((0.08 * tick, -0.06 * tick, -depth))
        change = np.subtract(tip.velocity_mm_s, before)
        assert tip.acceleration_m_s2 == pytest.approx(change, abs=1e-9)
        before = tip.velocity_mm_s
    assert tip.velocity_mm_s[:2] == pytest.approx((80.0, -60.0), rel=3e-3)
    assert tip.force_n == pytest.approx((-0.48, 0.36, 2.0), rel=5e-3)


def test_the_encoder_and_the_force_gauge_have_their_resolution_noise_and_range():
    encoder, truth = Encoder(exact=False), np.linspace(0, 0.3, 500)
    values = np.array([encoder.measure((x, -x, 0.0)) for x in truth])
    steps = np.unique(np.round(values[:, 0] / 0.03, 9))
    np.testing.assert_array_equal(steps, np.arange(11))
    assert np.abs(values[:, 0] - truth).max() <= 0.015 + 1e-12
    assert Encoder(exact=True).measure((0.1234, 0.0, -1.0)) == (0.1234, 0.0, -1.0)
    gauge = ForceGauge(np.random.default_rng(1), exact=False)
    values = np.array([gauge.measure((0.5, 0.0, 2.0)) for _ in range(5000)])
    np.testing.assert_allclose(values * 320.0, np.round(values * 320.0), atol=1e-9)
    np.testing.assert_allclose(values.mean(axis=0), [0.5, 0.0, 2.0], atol=3e-4)
    assert np.all((values.std(axis=0) > 0.002) & (values.std(axis=0) < 0.005))
    assert gauge.measure((40.0, -40.0, 40.0)) == (12.0, -12.0, 17.0)
    exact = ForceGauge(np.random.default_rng(1), exact=True)
    assert exact.measure((0.1, 0.2, 99.0)) == (0.1, 0.2, 99.0)


def test_the_accelerometer_feels_gravity_leans_slowly_and_has_its_resolution_and_range():
    sensor = TiltedAccelerometer(np.random.default_rng(1), exact=True)
    values = np.array([sensor.measure((0.0, 0.0, 0.0)) for _ in range(20_000)])
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), GRAVITY_M_S2, rtol=1e-12)
    lean = np.arccos(values[:, 2] / GRAVITY_M_S2)
    assert 0.5 * TILT_RAD < lean.max() < 1.5 * TILT_RAD
    assert np.abs(np.diff(values, axis=0)).max() < 0.001
    sensor = TiltedAccelerometer(np.random.default_rng(1), exact=False)
    counts = np.divide(
        [sensor.measure((0.0, 0.0, 0.0)) for _ in range(100)], ACCELERATION_RESOLUTION_M_S2
    )
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    most = ACCELERATION_RANGE_M_S2
    assert sensor.measure((500.0, -500.0, 500.0)) == pytest.approx((most, -most, most))


def test_samples_are_limited_and_counted_until_it_is_connected_anew():
    actuator = SimulatedActuator(limit_m_s2=2.0)
    assert actuator.statistics.rms_m_s2 == 0.0
    actuator.connect()
    for samples in ([2.0, -2.0], np.array([3.0, -5.0]), []):
        actuator.write(samples)
    actuator.close()
    actuator.close()
    statistics = actuator.statistics
    assert (statistics.samples, statistics.clipped, statistics.peak_m_s2) == (4, 2, 5.0)
    assert statistics.rms_m_s2 == pytest.approx(2.0)
    actuator.connect()
    actuator.calibrate()
    assert actuator.statistics.samples == 0


@pytest.mark.parametrize("limit", [0.0, math.nan, math.inf])
def test_bad_limits_are_refused(limit):
    with pytest.raises(InputError, match="limit_m_s2"):
        SimulatedActuator(limit_m_s2=limit)
