"""The nearest valid line spectral frequencies, against a quadratic program."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import isotonic_regression, minimize

from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.networks import (
    LEAST_GAP,
    least_gap,
    nearest_valid_lsf,
)

ANY = st.floats(allow_nan=True, allow_infinity=True)
NEAR = st.floats(-1.0, 5.0)


def bounds(count, gap, low=0.0, high=np.pi):
    """Return the widest bounds, each a gap apart."""
    steps = gap * np.arange(count)
    return low + gap + steps, high - gap * count + steps


def valid(lsf, gap, lowest=None, highest=None):
    moved = np.array(lsf, dtype=float)
    if lowest is None:
        lowest, highest = bounds(len(moved), gap)
    nearest_valid_lsf(moved, gap, lowest, highest, np.empty(3 * len(moved)))
    return moved


@given(st.lists(st.one_of(ANY, NEAR), min_size=1, max_size=64), st.floats(0.0, 0.03))
def test_whatever_comes_in_a_stable_filter_comes_out(lsf, gap):
    moved = valid(lsf, gap)
    assert (np.diff(moved, prepend=0.0, append=np.pi) >= gap - 1e-12).all()
    assert (np.diff(moved, prepend=0.0, append=np.pi) > 0.0).all()
    assert (np.abs(lsf_to_reflection(moved[None])) < 1.0).all()


@given(st.lists(NEAR, min_size=1, max_size=20), st.floats(0.0, 0.1))
def test_it_is_isotonic_regression_clipped_to_the_bounds(lsf, gap):
    steps = gap * np.arange(len(lsf))
    ascending = isotonic_regression(np.array(lsf) - steps).x
    expected = np.clip(ascending, gap, np.pi - gap * len(lsf)) + steps
    np.testing.assert_allclose(valid(lsf, gap), expected, atol=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_no_valid_vector_is_nearer(seed):
    generator = np.random.default_rng(seed)
    wild = generator.normal(1.6, 1.5, 7)
    ends = np.sort(generator.uniform(0.0, 0.35, (2, 7)), axis=1)
    steps = np.arange(1, 8) * 0.35
    lowest, highest = steps + 0.2 * ends[0] - 0.3, steps + ends[1]
    gap = {"type": "ineq", "fun": lambda x: np.diff(x) - 0.1}
    least = minimize(
        lambda x: ((x - wild) ** 2).sum(),
        0.5 * (lowest + highest),
        bounds=np.column_stack([lowest, highest]),
        constraints=[gap],
        options={"ftol": 1e-12},
    )
    np.testing.assert_allclose(valid(wild, 0.1, lowest, highest), least.x, atol=1e-4)


def test_a_valid_vector_stays():
    lsf = np.array([0.1, 0.5, 0.55, 2.0, 3.0])
    np.testing.assert_allclose(valid(lsf, 0.03), lsf, atol=1e-15)


def test_the_gap_is_the_samples_own_where_that_is_smaller():
    apart = np.array([[0.2, 0.9, 1.7], [0.3, 1.0, 3.0]])
    assert least_gap(apart) == LEAST_GAP
    assert least_gap(np.vstack([apart, [[0.2, 0.21, 1.0]]])) == pytest.approx(0.01)
    assert least_gap(np.vstack([apart, [[0.005, 0.5, 1.0]]])) == pytest.approx(0.005)
    assert least_gap(np.full((1, 64), np.pi) * np.arange(1, 65) / 65) == LEAST_GAP
