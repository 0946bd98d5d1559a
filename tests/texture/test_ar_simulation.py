import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import lfilter

from mmt.texture.autoregression.forms import burg, output_power, reflection_to_ar
from mmt.texture.autoregression.simulation import simulate_ar

REFLECTION = np.array([-0.8, 0.6, -0.3, 0.2])


@pytest.mark.parametrize("order", [1, 2, 5, 24])
def test_the_excitation_comes_back_from_the_inverse_filter(order):
    reflection = np.random.default_rng(order).uniform(-0.7, 0.7, order)
    x = simulate_ar(reflection, 4.0, 300, np.random.default_rng(3))
    noise = np.random.default_rng(3).standard_normal(order + 300)[order:]
    excitation = lfilter(np.concatenate([[1.0], reflection_to_ar(reflection)]), [1.0], x)
    np.testing.assert_allclose(excitation[order:], 2.0 * noise[order:], atol=1e-11)


def test_the_signal_is_stationary_from_its_first_sample():
    generator = np.random.default_rng(7)
    signals = np.array([simulate_ar(REFLECTION, 1.0, 6, generator) for _ in range(20_000)])
    power = output_power(1.0, REFLECTION)
    covariance = signals.T @ signals / len(signals)
    np.testing.assert_allclose(np.diag(covariance), power, rtol=0.05)
    for lag in range(1, 6):
        along = np.diag(covariance, lag) / power
        np.testing.assert_allclose(along, along.mean(), atol=0.05)
    assert covariance[0, 1] / power == pytest.approx(-REFLECTION[0], abs=0.03)


def test_a_fit_finds_the_model_again():
    fit = burg(simulate_ar(REFLECTION, 0.25, 100_000, np.random.default_rng(8)), 4)
    np.testing.assert_allclose(fit.reflection, REFLECTION, atol=0.015)
    assert fit.variance == pytest.approx(0.25, rel=0.02)


@given(
    reflection=hnp.arrays(np.float64, st.integers(1, 64), elements=st.floats(-1 + 1e-4, 1 - 1e-4)),
    seed=st.integers(0, 99),
)
@settings(max_examples=60, deadline=None)
def test_the_lattice_is_stable_where_coefficients_would_not_be(reflection, seed):
    x = simulate_ar(reflection, 1.0, 500, np.random.default_rng(seed))
    power = output_power(1.0, reflection)
    assert np.abs(x).max() < 8 * np.sqrt(power)


def test_no_variance_is_silence():
    np.testing.assert_array_equal(simulate_ar(REFLECTION, 0.0, 20, np.random.default_rng(0)), 0)
