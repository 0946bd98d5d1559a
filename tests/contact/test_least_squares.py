"""Recursive least squares against the batch solution, and where nothing can be learned."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.contact.least_squares import LARGEST_RISE, RecursiveLeastSquares

finite = st.floats(-1e3, 1e3)
samples = st.lists(st.tuples(finite, finite, finite, finite), min_size=1, max_size=80)


def test_without_forgetting_it_is_the_batch_solution():
    rng = np.random.default_rng(0)
    phi = rng.normal(size=(300, 3)) * (1.0, 5.0, 0.1)
    y = phi @ (2.0, -1.0, 30.0) + 0.1 * rng.normal(size=300)
    estimate = RecursiveLeastSquares((100.0, 50.0, 400.0), noise_variance=0.01, forgetting=1.0)
    for row, value in zip(phi.tolist(), y.tolist(), strict=True):
        estimate.update(tuple(row), value)
    information = phi.T @ phi / 0.01 + np.diag([1 / 100, 1 / 50, 1 / 400])
    covariance = np.linalg.inv(information)
    assert estimate.parameters == pytest.approx(covariance @ (phi.T @ y / 0.01), rel=1e-9)
    assert estimate.variances() == pytest.approx(np.diag(covariance), rel=1e-9)


def test_forgetting_follows_a_change_and_weighs_as_exponentials_do():
    rng = np.random.default_rng(1)
    phi = rng.normal(size=(400, 3))
    truth = np.where(np.arange(400)[:, None] < 200, (1.0, 2.0, 3.0), (4.0, -5.0, 6.0))
    y = (phi * truth).sum(axis=1)
    estimate = RecursiveLeastSquares((1e4, 1e4, 1e4), noise_variance=1e-4, forgetting=0.95)
    for row, value in zip(phi.tolist(), y.tolist(), strict=True):
        estimate.update(tuple(row), value)
    weight = np.sqrt(0.95 ** np.arange(399, -1, -1.0))
    expected, *_ = np.linalg.lstsq(phi * weight[:, None], y * weight, rcond=None)
    assert estimate.parameters == pytest.approx(expected, abs=1e-3)
    assert estimate.parameters == pytest.approx((4.0, -5.0, 6.0), abs=0.01)


@given(samples, st.floats(0.5, 1.0))
def test_variances_stay_positive_and_bounded_whatever_comes(rows, forgetting):
    initial = (100.0, 4.0, 0.5)
    estimate = RecursiveLeastSquares(initial, noise_variance=1e-2, forgetting=forgetting)
    for *phi, value in rows:
        estimate.update(tuple(phi), value)
        for variance, most in zip(estimate.variances(), initial, strict=True):
            assert 0.0 < variance <= LARGEST_RISE * most * (1 + 1e-12)
        assert all(map(math.isfinite, estimate.parameters))


@pytest.mark.parametrize("phi", [(0.1, 10.0, 0.0), (0.1, 0.0, 10.0), (0.0, 0.1, 10.0)])
def test_a_variance_that_others_raise_begins_anew(phi):
    """One sample ties two parameters, and then nothing tells of either."""
    initial = (1.0, 1.0, 1.0)
    estimate = RecursiveLeastSquares(initial, noise_variance=0.01, forgetting=0.5)
    estimate.update(phi, 3.0)
    kept = estimate.parameters
    for _ in range(60):
        estimate.update((0.0, 0.0, 0.0), 0.0)
    assert (estimate.variances(), estimate.parameters) == (initial, kept)


@pytest.mark.parametrize("phi", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3.0, 0.0, 1.0)])
def test_the_same_sample_for_ever_does_not_wind_it_up(phi):
    estimate = RecursiveLeastSquares((10.0, 10.0, 10.0), noise_variance=0.01, forgetting=0.9)
    for _ in range(20_000):
        estimate.update(phi, 2.0)
    before = estimate.parameters
    estimate.update((1.0, -1.0, 0.5), 0.0)
    assert max(abs(p) for p in before) < 10.0
    assert max(abs(p) for p in estimate.parameters) < 100.0


@pytest.mark.parametrize(
    ("phi", "value"),
    [
        ((math.nan, 0.0, 0.0), 1.0),
        ((1.0, 0.0, 0.0), math.inf),
        ((1e200, 1e200, 1e200), 1.0),
        ((1.0, math.inf, 0.0), 0.0),
    ],
)
def test_what_is_not_finite_changes_nothing(phi, value):
    estimate = RecursiveLeastSquares((1.0, 1.0, 1.0), noise_variance=0.1, forgetting=0.99)
    estimate.update((1.0, 2.0, 3.0), 4.0)
    before = estimate.parameters, estimate.variances()
    estimate.update(phi, value)
    assert (estimate.parameters, estimate.variances()) == before
