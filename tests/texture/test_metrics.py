import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import lfilter, periodogram, welch

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import ar_spectrum
from mmt.texture.signals.metrics import (
    JND_DB,
    amplitude_spectra,
    expected_amplitude,
    gfc_of_rows,
    power_error_db,
    within_jnd,
)

amplitudes = hnp.arrays(np.float64, 12, elements=st.floats(0, 1e3))


def noise(samples, seed=0):
    return np.random.default_rng(seed).standard_normal(samples)


@pytest.mark.parametrize(
    ("samples", "nperseg"), [(400, 64), (401, 128), (64, 64), (90, 17), (9, 2)]
)
def test_the_amplitude_spectrum_is_that_of_an_established_package(samples, nperseg):
    x = 3 + noise(samples)
    expected_hz, density = welch(
        x, 1000.0, nperseg=nperseg, noverlap=nperseg // 2, detrend=False, window="hann"
    )
    frequencies_hz, amplitude = amplitude_spectra(x, 1000.0, nperseg)
    np.testing.assert_allclose(frequencies_hz, expected_hz, rtol=1e-14)
    np.testing.assert_allclose(amplitude, np.sqrt(density), rtol=1e-12)


@pytest.mark.parametrize("samples", [64, 301])
def test_raw_amplitudes_are_those_of_a_periodogram(samples):
    signal = np.random.default_rng(samples).standard_normal(samples)
    frequencies_hz, amplitude = amplitude_spectra(signal, 1000.0, None)
    at_hz, density = periodogram(signal, 1000.0, detrend=False)
    np.testing.assert_allclose(frequencies_hz, at_hz)
    np.testing.assert_allclose(amplitude, np.sqrt(density), rtol=1e-10, atol=1e-15)


def test_many_amplitude_spectra_are_those_of_each():
    signals = noise(600).reshape(4, 150) * [[1.0], [1e-200], [0.0], [1e200]]
    frequencies_hz, amplitudes = amplitude_spectra(signals, 1000.0, 32)
    for signal, amplitude in zip(signals, amplitudes, strict=True):
        expected_hz, expected = amplitude_spectra(signal, 1000.0, 32)
        np.testing.assert_array_equal(frequencies_hz, expected_hz)
        np.testing.assert_allclose(amplitude, expected, rtol=1e-14)


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e-160, 1e160, 1e300])
def test_the_amplitude_spectrum_is_linear_at_every_level(scale):
    x = noise(200)
    reference = amplitude_spectra(x, 1000.0)[1]
    np.testing.assert_allclose(
        amplitude_spectra(scale * x, 1000.0)[1], scale * reference, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("x", "nperseg"),
    [(np.ones(63), 64), (np.ones(9), 1), (np.ones((2, 9, 9)), 4), (np.full(99, np.nan), 64)],
)
def test_signals_without_a_spectrum_are_refused(x, nperseg):
    with pytest.raises(InputError):
        amplitude_spectra(x, 1000.0, nperseg)


def test_gfc_of_known_vectors():
    assert gfc_of_rows(np.array([3.0, 0.0]), np.array([1.0, 1.0])) == pytest.approx(math.sqrt(0.5))
    assert gfc_of_rows(np.array([1.0, 0.0]), np.array([0.0, 2.0])) == 0


@given(a=amplitudes, b=amplitudes, power=st.integers(-900, 900))
@settings(max_examples=80)
def test_gfc_is_symmetric_bounded_and_ignores_the_level(a, b, power):
    value = gfc_of_rows(a, b)
    assert 0 <= value <= 1
    assert gfc_of_rows(b, a) == value
    if a.any() and a[a > 0].min() > 1e-30:
        assert gfc_of_rows(np.ldexp(a, power), b) == pytest.approx(value, abs=1e-14)
        assert gfc_of_rows(a, a) == pytest.approx(1, abs=1e-14)


def test_gfc_where_there_is_no_vibration():
    zero, some = np.zeros(8), np.ones(8)
    assert gfc_of_rows(zero, zero) == 1
    assert gfc_of_rows(zero, some) == gfc_of_rows(some, zero) == 0


def test_gfc_of_rows_is_that_of_each_row():
    a, b = noise(60).reshape(5, 12) ** 2, noise(60, 1).reshape(5, 12) ** 2
    a[1] = a[2] = b[2] = 0
    a[3] *= 1e300
    b[3] *= 1e-300
    expected = [gfc_of_rows(first, second) for first, second in zip(a, b, strict=True)]
    np.testing.assert_allclose(gfc_of_rows(a, b), expected, rtol=1e-14)
    assert expected[1:3] == [0, 1]
    assert gfc_of_rows(a[4:], b[4:])[0] == pytest.approx(
        np.sum(a[4] * b[4]) / np.sqrt(np.sum(a[4] ** 2) * np.sum(b[4] ** 2))
    )


@pytest.mark.parametrize(
    ("a", "b"), [([1.0, 2.0], [1.0]), ([np.nan, 1.0], [1.0, 1.0]), ([], []), ([1.0], [np.inf])]
)
def test_spectra_that_cannot_be_compared_are_refused(a, b):
    with pytest.raises(InputError):
        gfc_of_rows(np.array(a), np.array(b))


def test_negative_densities_are_refused():
    with pytest.raises(InputError, match="negative"):
        power_error_db(-1.0, 1.0)


def test_the_jnd_is_17_percent_in_amplitude():
    assert pytest.approx(1.3637, abs=1e-4) == JND_DB
    assert power_error_db(1.17**2, 1.0) == pytest.approx(JND_DB)
    assert within_jnd(np.array([0.0, JND_DB, -JND_DB, 1.4, -9.0, math.inf])) == 0.5
    with pytest.raises(InputError):
        within_jnd(np.array([]))


def test_power_errors_with_zeros():
    errors = power_error_db(np.array([0.0, 0.0, 1.0, 10.0]), np.array([0.0, 1.0, 0.0, 1.0]))
    np.testing.assert_array_equal(errors, [0.0, -math.inf, math.inf, 10.0])
    assert power_error_db(1e300, 1e-300) == pytest.approx(6000)
    assert power_error_db(np.ones((2, 3)), 1.0).shape == (2, 3)


def test_the_expected_amplitude_is_the_mean_of_welch_over_realisations():
    ar, variance = np.array([-1.6, 0.95]), 0.7
    density = ar_spectrum(ar[None], np.array([variance]), np.arange(501.0), 1000.0)
    expected = expected_amplitude(density)[0]
    noise = np.random.default_rng(5).standard_normal(401_000) * np.sqrt(variance)
    signal = lfilter([1.0], np.concatenate([[1.0], ar]), noise)[1000:]
    _, measured = amplitude_spectra(signal, 1000.0)
    np.testing.assert_allclose(measured, expected, rtol=0.04)


def test_the_expected_amplitude_of_white_noise_is_flat_and_keeps_its_power():
    amplitude = expected_amplitude(np.full((2, 501), 0.01))
    np.testing.assert_allclose(amplitude[:, 1:-1], 0.1, rtol=1e-12)
    np.testing.assert_allclose(amplitude[:, [0, -1]], 0.1 / np.sqrt(2), rtol=1e-12)
