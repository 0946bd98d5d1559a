"""Sensors: resolution, range, noise and gravity as the data sheets say."""

import numpy as np
import pytest

from mmt.testing.simulation.instruments import (
    ACCELERATION_RANGE_M_S2,
    ACCELERATION_RESOLUTION_M_S2,
    GRAVITY_M_S2,
    TILT_RAD,
    Encoder,
    ForceGauge,
    TiltedAccelerometer,
)


def _generator(seed=1):
    return np.random.default_rng(seed)


def test_encoder_steps():
    encoder = Encoder(exact=False)
    values = np.array([encoder.measure((x, -x, 0.0)) for x in np.linspace(0, 0.3, 500)])
    steps = np.unique(np.round(values[:, 0] / 0.03, 9))
    np.testing.assert_array_equal(steps, np.arange(11))
    truth = np.linspace(0, 0.3, 500)
    assert np.abs(values[:, 0] - truth).max() <= 0.015 + 1e-12
    assert Encoder(exact=True).measure((0.1234, 0.0, -1.0)) == (0.1234, 0.0, -1.0)


def test_force_gauge_resolution_noise_and_range():
    gauge = ForceGauge(_generator(), exact=False)
    values = np.array([gauge.measure((0.5, 0.0, 2.0)) for _ in range(5000)])
    counts = values * 320.0
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    np.testing.assert_allclose(values.mean(axis=0), [0.5, 0.0, 2.0], atol=3e-4)
    assert np.all(values.std(axis=0) < 0.005)
    assert np.all(values.std(axis=0) > 0.002)
    assert gauge.measure((40.0, -40.0, 40.0)) == (12.0, -12.0, 17.0)
    assert ForceGauge(_generator(), exact=True).measure((0.1, 0.2, 99.0)) == (0.1, 0.2, 99.0)


def test_accelerometer_feels_gravity_and_leans_slowly():
    sensor = TiltedAccelerometer(_generator(), exact=True)
    values = np.array([sensor.measure((0.0, 0.0, 0.0)) for _ in range(20_000)])
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), GRAVITY_M_S2, rtol=1e-12)
    lean = np.arccos(values[:, 2] / GRAVITY_M_S2)
    assert 0.5 * TILT_RAD < lean.max() < 1.5 * TILT_RAD
    assert np.abs(np.diff(values, axis=0)).max() < 0.001


def test_accelerometer_noise_resolution_and_range():
    sensor = TiltedAccelerometer(_generator(), exact=False)
    values = np.array([sensor.measure((0.0, 0.0, 0.0)) for _ in range(8000)])
    counts = values / ACCELERATION_RESOLUTION_M_S2
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    noise = np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
    expected = 150e-6 * GRAVITY_M_S2 * np.sqrt(500.0)
    quantisation = ACCELERATION_RESOLUTION_M_S2 / np.sqrt(12.0)
    np.testing.assert_allclose(noise, np.hypot(expected, quantisation), rtol=0.05)
    assert sensor.measure((500.0, -500.0, 500.0)) == pytest.approx(
        (ACCELERATION_RANGE_M_S2, -ACCELERATION_RANGE_M_S2, ACCELERATION_RANGE_M_S2)
    )
