"""Burg's and Levinson's methods against an established package and many digits."""

import autoregressive_oracles as oracles
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter
from spectrum import arburg

from mmt.core.errors import InputError
from mmt.texture.autoregression.burg import LARGEST_OF_SPECTRA, burg, burg_batch, levinson
from mmt.texture.autoregression.forms import output_power, reflection_to_ar


def noise(samples, seed=0):
    return np.random.default_rng(seed).standard_normal(samples)


def filtered(poles, samples, seed=0):
    return lfilter([1.0], np.poly(poles).real, noise(samples, seed))


def pairs(radius, angles):
    return [radius * np.exp(sign * 1j * angle) for angle in angles for sign in (1, -1)]


def assert_sound(fit):
    assert (np.abs(fit.reflection) < 1).all()
    assert np.isfinite(fit.variances).all()
    assert (fit.variances >= 0).all()
    assert (np.diff(fit.variances) <= 0).all()
    assert np.isfinite(reflection_to_ar(fit.reflection)).all()


@pytest.mark.parametrize(("samples", "order"), [(50, 1), (200, 4), (400, 13), (1000, 20)])
def test_well_conditioned_segments_agree_with_an_established_package(samples, order):
    x = filtered(pairs(0.9, [0.4, 1.3, 2.2]), samples, seed=order)
    coefficients, variance, reflection = arburg(x, order)
    fit = burg(x, order)
    np.testing.assert_allclose(fit.reflection, np.real(reflection), atol=1e-11)
    np.testing.assert_allclose(reflection_to_ar(fit.reflection), np.real(coefficients), atol=1e-10)
    assert fit.variance == pytest.approx(variance, rel=1e-10)


@pytest.mark.parametrize("offset", [1e3, 1e6, 1e10])
def test_an_offset_costs_the_variance_no_digits(offset):
    x = offset + noise(400)
    reflection = oracles.burg(x, 6)
    fit = burg(x, 6)
    assert oracles.largest_error(fit.reflection, reflection) < 1e-14
    power = mpmath.fsum(oracles.exact(x), squared=True) / len(x)
    for order, found in enumerate(fit.variances):
        expected = power * oracles.inverse_gain(reflection[:order])
        assert oracles.relative_error(found, expected) < 3e-14


@pytest.mark.parametrize("scale", [5e-324, 1e-322, 1e-310, 1e-200, 1.0, 1e200, 1e300, 5e307])
def test_every_amplitude_gives_the_exact_reflection_coefficients(scale):
    x = np.random.default_rng(5).integers(-3, 4, 120) * scale
    fit = burg(x, 8)
    assert_sound(fit)
    assert oracles.largest_error(fit.reflection, oracles.burg(x, 8)) < 1e-14


@given(
    x=hnp.arrays(np.float64, st.integers(17, 60), elements=st.floats(-1e6, 1e6, width=32)),
    power=st.integers(-600, 600),
)
@settings(max_examples=60)
def test_a_power_of_two_changes_no_digit(x, power):
    np.testing.assert_array_equal(burg(x, 16).reflection, burg(np.ldexp(x, power), 16).reflection)


@given(
    x=hnp.arrays(
        np.float64, st.integers(2, 80), elements=st.floats(allow_nan=False, allow_infinity=False)
    ),
    data=st.data(),
)
@settings(max_examples=150)
def test_every_finite_signal_gives_a_stable_model(x, data):
    assert_sound(burg(x, data.draw(st.integers(1, min(64, len(x) - 1)))))


@given(
    kind=st.sampled_from(["tone", "ramp", "parabola", "constant", "impulse", "nyquist", "step"]),
    samples=st.integers(2, 300),
    level=st.sampled_from([5e-324, 1e-320, 1e-160, 1e-8, 1.0, 1e8, 1e160, 1e300]),
    data=st.data(),
)
@settings(max_examples=150)
def test_predictable_signals_give_a_stable_model(kind, samples, level, data):
    n = np.arange(samples)
    x = {
        "tone": np.sin(data.draw(st.floats(0.001, 3.1)) * n),
        "ramp": n / samples,
        "parabola": (n / samples - 0.3) ** 2,
        "constant": np.ones(samples),
        "impulse": 1.0 * (n == data.draw(st.integers(0, samples - 1))),
        "nyquist": (-1.0) ** n,
        "step": 1.0 * (n >= samples // 2),
    }[kind]
    assert_sound(burg(level * x, data.draw(st.integers(1, min(64, samples - 1)))))


def test_a_vanished_residual_ends_the_recursion():
    zero, constant, nyquist = burg_batch(
        [np.zeros(9), np.ones(9), (-1.0) ** np.arange(9)], 5
    ).reflection
    np.testing.assert_array_equal(zero, 0)
    np.testing.assert_allclose(constant, [-1, 0, 0, 0, 0], atol=2e-16)
    np.testing.assert_allclose(nyquist, [1, 0, 0, 0, 0], atol=2e-16)
    assert burg(np.ones(9), 5).variance == 0
    assert burg(np.ones(9), 5).power == 1


def test_a_power_beyond_all_numbers_is_held_at_the_largest():
    fit = burg(1e300 * noise(50), 3)
    assert fit.power == fit.variance == np.finfo(float).max


@given(order=st.integers(1, 40), seed=st.integers(0, 99))
@settings(max_examples=30)
def test_the_model_has_the_power_of_the_segment(order, seed):
    x = noise(100, seed) + 0.3 * np.sin(np.arange(100))
    fit = burg(x, order)
    assert fit.power == pytest.approx(np.mean(x**2), rel=1e-13)
    assert output_power(fit.variance, fit.reflection) == pytest.approx(fit.power, rel=1e-12)


def test_a_batch_of_different_lengths_is_the_single_fits():
    segments = [noise(samples, samples) for samples in (17, 400, 33, 120)]
    fits = burg_batch(segments, 16)
    for row, segment in enumerate(segments):
        fit = burg(segment, 16)
        np.testing.assert_array_equal(fits.reflection[row], fit.reflection)
        assert fits.variance[row] == fit.variance
        assert fits.power[row] == fit.power


def test_a_batch_takes_rows_lists_strided_arrays_and_nothing():
    rows = noise(200).reshape(4, 50)
    expected = burg_batch(list(rows), 5).reflection
    np.testing.assert_array_equal(burg_batch(rows, 5).reflection, expected)
    np.testing.assert_array_equal(burg_batch(np.asfortranarray(rows), 5).reflection, expected)
    assert burg_batch([], 5).reflection.shape == (0, 5)
    assert burg_batch([], 5).variance.shape == (0,)


@pytest.mark.parametrize(
    ("x", "order", "words"),
    [
        (np.ones(5), 5, "more than 5 samples"),
        (np.ones(5), 0, "order is 0, allowed is a whole number at least 1 and at most 64"),
        (np.ones(100), 2.5, "order is 2.5, allowed is a whole number"),
        (np.ones(100), 65, "at most 64"),
        (np.ones((5, 5)), 2, "shape"),
        (np.array([0, np.nan, 1, 2, 3]), 2, "not finite"),
        (np.array([0, np.inf, 1, 2, 3]), 2, "not finite"),
    ],
)
def test_what_cannot_be_fitted_is_said(x, order, words):
    with pytest.raises(InputError, match=words):
        burg(x, order)
    with pytest.raises(InputError, match="segment 1"):
        burg_batch([np.ones(9), np.full(9, np.nan)], 2)


def lags_of(density, order):
    return np.fft.irfft(density, axis=1)[:, : order + 1]


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize("order", [1, 2, 24])
def test_the_filters_solve_the_normal_equations(order, scale):
    density = scale * np.exp(np.random.default_rng(order).normal(size=(20, 129)))
    lags = lags_of(density, order)
    found = reflection_to_ar(levinson(lags))
    expected = [-solve_toeplitz(row[:-1], row[1:]) for row in lags / scale]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_a_pure_tone_stays_stable_and_its_rounding_is_not_fitted():
    lags = np.cos(0.7 * np.arange(65))[np.newaxis]
    reflection = levinson(lags)
    assert np.abs(reflection).max() <= LARGEST_OF_SPECTRA
    assert reflection[0, 0] == pytest.approx(-np.cos(0.7))
    assert not reflection[0, 8:].any()
