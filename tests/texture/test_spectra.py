"""Spectra of filters and of signals, what they are compared by, and what their power is worth."""

import itertools
import math

import autoregressive_oracles as oracles
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import freqz, lfilter, periodogram, welch

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import (
    LEAST_SIZE,
    ar_spectra,
    ar_spectrum,
    effective_samples,
    lsf_spectrum,
    lsf_to_ar,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.model.fits import fit_segments, unpacked
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.metrics import (
    JND_DB,
    amplitude_spectra,
    expected_amplitude,
    gfc_of_rows,
    power_error_db,
    within_jnd,
)
from mmt.texture.space import ISOTROPIC

RATE_HZ = 1000.0
FREQUENCIES_HZ = np.linspace(0, 500, 4001)


def reflection_of(order):
    return np.random.default_rng(order).uniform(-0.5, 0.5, order)


@pytest.mark.parametrize("order", [1, 2, 3, 8, 15, 24])
def test_the_densities_agree_with_a_frequency_response(order):
    ar = reflection_to_ar(reflection_of(order))
    _, response = freqz([1.0], [1.0, *ar], worN=FREQUENCIES_HZ, fs=RATE_HZ)
    expected = 2 * 3.0 / RATE_HZ * np.abs(response) ** 2
    lsf = reflection_to_lsf(reflection_of(order))
    np.testing.assert_allclose(ar_spectrum(ar, 3.0, FREQUENCIES_HZ, RATE_HZ), expected, rtol=1e-9)
    np.testing.assert_allclose(lsf_spectrum(lsf, 3.0, FREQUENCIES_HZ, RATE_HZ), expected, rtol=1e-9)


@pytest.mark.parametrize(("order", "period"), [(1, 4), (16, 1000), (64, 10000)])
def test_densities_from_0_to_half_the_rate_are_those_at_each_frequency(order, period):
    ar = reflection_to_ar(np.array([reflection_of(order), reflection_of(order) / 2]))
    frequencies_hz = np.linspace(0.0, RATE_HZ / 2, period // 2 + 1)
    expected = ar_spectrum(ar, np.array([1.0, 3.0]), frequencies_hz, RATE_HZ)
    found = ar_spectra(ar, np.array([1.0, 3.0]), period, RATE_HZ)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_batch_is_its_rows():
    reflection = np.array([reflection_of(6), reflection_of(6) / 2])
    variance = np.array([1.0, 0.0])
    for spectrum, form in (
        (ar_spectrum, reflection_to_ar(reflection)),
        (lsf_spectrum, reflection_to_lsf(reflection)),
    ):
        batch = spectrum(form, variance, FREQUENCIES_HZ, RATE_HZ)
        assert batch.shape == (2, len(FREQUENCIES_HZ))
        for row in range(2):
            single = spectrum(form[row], variance[row], FREQUENCIES_HZ, RATE_HZ)
            np.testing.assert_allclose(batch[row], single, rtol=1e-12)


@pytest.mark.parametrize("order", [30, 31, 64])
def test_the_frequencies_keep_the_digits_of_a_low_pass_filter(order):
    lsf = oracles.low_pass_lsf(order)
    ar = oracles.lsf_to_ar(lsf)
    for frequency_hz in (0.0, 20.0, 60.0, 350.0, 500.0):
        with mpmath.workdps(100):
            angle = mpmath.mpf(frequency_hz) * 2 * mpmath.pi / 1000
            response = 1 + sum(a * mpmath.expj(-angle * (j + 1)) for j, a in enumerate(ar))
            expected = mpmath.mpf(2) / 1000 / abs(response) ** 2
        found = lsf_spectrum(lsf, 1.0, np.array([frequency_hz]), RATE_HZ)[0]
        assert oracles.relative_error(found, expected) < 1e-11
    lost = ar_spectrum(lsf_to_ar(lsf), 1.0, np.array([20.0]), RATE_HZ)[0]
    kept = lsf_spectrum(lsf, 1.0, np.array([20.0]), RATE_HZ)[0]
    assert lost < 0.5 * kept


@pytest.mark.parametrize("frequency_hz", [-1.0, 500.1, np.nan])
def test_frequencies_beyond_half_the_rate_are_refused(frequency_hz):
    with pytest.raises(InputError, match="half the rate"):
        ar_spectrum(np.zeros(2), 1.0, np.array([frequency_hz]), RATE_HZ)


def test_white_noise_is_worth_all_its_samples_and_a_first_order_filter_what_bartlett_says():
    filters = np.array([[1e-12], [-0.6], [0.9]])
    found = effective_samples(reflection_to_lsf(filters), np.array([200, 400, 1000]), 1000.0)
    share = (1 - filters[:, 0] ** 2) / (1 + filters[:, 0] ** 2)
    np.testing.assert_allclose(found, share * [200, 400, 1000], rtol=1e-6)


def test_a_line_that_nothing_resolves_is_worth_the_least_and_no_samples_give_none():
    assert effective_samples(np.array([[1.0, 1.0 + 1e-9]]), np.array([150]), 1000.0) == LEAST_SIZE
    assert effective_samples(np.empty((0, 4)), np.empty(0), 1000.0).shape == (0,)


def test_segments_of_narrow_lines_are_worth_what_their_spectrum_says_whatever_the_order():
    count, random = 300, np.random.default_rng(7)
    modes = [(40.0, 7.0, 2.5), (80.0, 11.0, 1.0), (120.0, 15.0, 0.4), (150.0, 180.0, 0.5)]
    filters = [  # of each mode's frequency and width in Hz
        np.poly([np.exp(np.pi * (-width + 2j * sign * hz) / 1000.0) for sign in (1, -1)]).real
        for hz, width, _ in modes
    ]
    bins = np.linspace(0.0, np.pi, 4097)
    responses = [np.abs(freqz([1.0], taps, bins)[1]) ** 2 for taps in filters]
    gains = [power / r.mean() for r, (_, _, power) in zip(responses, modes, strict=True)]
    density = sum(gain * response for gain, response in zip(gains, responses, strict=True))
    exact = count * density.mean() ** 2 / np.mean(density**2)
    segments = []
    for number in range(60):
        parts = [
            np.sqrt(gain) * lfilter([1.0], taps, random.normal(size=1000 + count))
            for gain, taps in zip(gains, filters, strict=True)
        ]
        start, vibration = 1000 * number, sum(parts)[1000:]
        segments.append(Segment(start, start + count, 100.0, (100.0, 0.0), 1.0, vibration, 0, True))
    for order in (4, 12):
        fits = fit_segments(segments, itertools.count(), ModellingSettings(order=order))
        found = unpacked([fit.packed for fit in fits], ISOTROPIC)
        assert set(found.counts) == {count}
        alone = found.effective
        counts = np.full(60, float(count))
        assert np.log(alone.mean() / exact) == pytest.approx(0.0, abs=0.25)
        rough = effective_samples(found.lsf, counts, 1000.0)
        assert np.log(rough.mean() / exact) > 0.35


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
    zero, some = np.zeros(8), np.ones(8)  # where there is no vibration
    assert gfc_of_rows(zero, zero) == 1
    assert gfc_of_rows(zero, some) == gfc_of_rows(some, zero) == 0


@given(a=amplitudes, b=amplitudes, power=st.integers(-900, 900))
@settings(max_examples=80)
def test_gfc_is_symmetric_bounded_and_ignores_the_level(a, b, power):
    value = gfc_of_rows(a, b)
    assert 0 <= value <= 1
    assert gfc_of_rows(b, a) == value
    if a.any() and a[a > 0].min() > 1e-30:
        assert gfc_of_rows(np.ldexp(a, power), b) == pytest.approx(value, abs=1e-14)
        assert gfc_of_rows(a, a) == pytest.approx(1, abs=1e-14)


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
    with pytest.raises(InputError, match="negative"):
        power_error_db(-1.0, 1.0)


def test_the_expected_amplitude_is_the_mean_of_welch_over_realisations():
    ar, variance = np.array([-1.6, 0.95]), 0.7
    density = ar_spectrum(ar[None], np.array([variance]), np.arange(501.0), 1000.0)
    expected = expected_amplitude(density)[0]
    noise = np.random.default_rng(5).standard_normal(401_000) * np.sqrt(variance)
    signal = lfilter([1.0], np.concatenate([[1.0], ar]), noise)[1000:]
    _, measured = amplitude_spectra(signal, 1000.0)
    np.testing.assert_allclose(measured, expected, rtol=0.04)
