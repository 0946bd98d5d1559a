"""Levinson's recursion against a general solver of the same equations."""

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz

from mmt.texture.autoregression.burg import LARGEST_OF_SPECTRA, levinson
from mmt.texture.autoregression.forms import reflection_to_ar


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


def test_a_pure_tone_stays_stable():
    lags = np.cos(0.7 * np.arange(9))[np.newaxis]
    reflection = levinson(lags)
    assert np.abs(reflection).max() <= LARGEST_OF_SPECTRA
    assert reflection[0, 0] == pytest.approx(-np.cos(0.7))


def test_white_noise_needs_no_filter():
    np.testing.assert_array_equal(levinson(np.array([[2.0, 0.0, 0.0]])), np.zeros((1, 2)))
