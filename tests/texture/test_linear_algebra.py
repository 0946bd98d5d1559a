"""Factors and solutions against LAPACK's and NumPy's own, at the extremes too."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from mmt.texture.linear_algebra import (
    cholesky,
    condition,
    log_evidence,
    product,
    solve_backward,
    solve_forward,
)
from mmt.texture.tridiagonal import shifted_systems

EPSILON = np.finfo(float).eps
SIZES = [0, 1, 2, 7, 8, 9, 15, 16, 17, 64, 101, 230]


def covariance(size, seed=0, noise=0.1):
    """Return the covariance (n, n) of a smooth process at random points."""
    at = np.random.default_rng(seed).random((size, 2))
    apart = np.square(at[:, None] - at[None]).sum(axis=2)
    return np.asarray(np.exp(-apart) + noise * np.eye(size))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("count", [0, 1, 5])
def test_systems_are_solved_as_lapack_solves_them(size, count):
    matrix = covariance(size)
    right = np.random.default_rng(1).normal(size=(count, size))
    upper = np.linalg.cholesky(matrix).T
    whitened = solve_forward(cholesky(matrix), right)
    expected = scipy.linalg.solve_triangular(upper, right.T, trans="T").T if size else right
    np.testing.assert_allclose(whitened, expected, atol=1e-11)
    solved = solve_backward(cholesky(matrix), whitened)
    np.testing.assert_allclose(solved @ matrix, right, atol=1e-11)


@given(size=st.integers(1, 40), seed=st.integers(0, 99), logarithm=st.floats(-300.0, 300.0))
def test_the_factor_has_the_errors_that_rounding_allows(size, seed, logarithm):
    matrix = covariance(size, seed, noise=1e-13) * 10.0**logarithm  # nearly singular
    factor = cholesky(matrix)
    np.testing.assert_array_equal(factor, factor.T)
    upper = np.triu(factor)
    error = np.abs(upper.T @ upper - matrix).max()
    assert error <= (size + 1) * EPSILON * np.diagonal(matrix).max()  # Higham 2002, theorem 10.3


@given(size=st.integers(1, 40), seed=st.integers(0, 99), count=st.integers(1, 6))
def test_a_row_is_solved_alike_alone_and_among_others(size, seed, count):
    factor = cholesky(covariance(size, seed))
    rows = np.random.default_rng(seed).normal(size=(count, size))
    for solve in (solve_forward, solve_backward):
        together = solve(factor, rows)
        for row, solved in zip(rows, together, strict=True):
            np.testing.assert_array_equal(solve(factor, row), solved)


def test_arguments_stay_as_they_were():
    matrix, rows = covariance(9), np.ones((2, 9))
    before = matrix.copy()
    factor = cholesky(matrix)
    solve_backward(factor, solve_forward(factor, rows))
    np.testing.assert_array_equal(matrix, before)
    np.testing.assert_array_equal(rows, 1.0)


@pytest.mark.parametrize("size", [1, 8, 20])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 0.0])
def test_what_is_not_positive_definite_has_no_factor(size, bad):
    matrix = covariance(size)
    matrix[-1, -1] = bad
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        cholesky(matrix)


@given(
    shape=st.tuples(*[st.integers(0, 20)] * 3), seed=st.integers(0, 99), transposed=st.booleans()
)
def test_a_product_is_that_of_numpy(shape, seed, transposed):
    rows, inner, columns = shape
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(rows, inner)), rng.normal(size=(inner, columns))
    if transposed:
        a = np.asfortranarray(a)
    np.testing.assert_allclose(product(a, b), a @ b, atol=1e-13)


@given(size=st.integers(0, 40), count=st.integers(0, 3), seed=st.integers(0, 99))
def test_observations_say_what_the_inverse_of_their_covariance_says(size, count, seed):
    rng = np.random.default_rng(seed)
    priors = np.array([covariance(size, seed + each) for each in range(count)])
    priors = priors.reshape(count, size, size)
    errors, rest = rng.uniform(0.1, 2.0, size), rng.normal(size=size)
    evidence, (gains, precision) = np.empty(count), np.empty((2, count, size))
    assert condition(priors, errors, rest, True, evidence, gains, precision)
    for each, prior in enumerate(priors):
        inverse = np.linalg.inv(prior + np.diag(errors))
        logarithm = np.linalg.slogdet(prior + np.diag(errors))[1]
        assert evidence[each] == pytest.approx(-0.5 * (rest @ inverse @ rest + logarithm))
        np.testing.assert_allclose(gains[each], inverse @ rest, atol=1e-9)
        np.testing.assert_allclose(precision[each], np.diagonal(inverse), rtol=1e-9)
    np.testing.assert_array_equal(log_evidence(priors, errors, rest), evidence)


def test_a_prior_that_is_no_covariance_is_refused():
    priors = np.array([covariance(9), -covariance(9)])
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        log_evidence(priors, np.full(9, 0.1), np.ones(9))
    found = np.empty(2), np.empty((2, 9)), np.empty((2, 9))
    assert not condition(priors, np.full(9, 0.1), np.ones(9), True, *found)


def matrices(kind, size, seed):
    random = np.random.default_rng(seed)
    if kind == "nothing":
        return np.zeros((size, size))
    if kind == "diagonal":
        return np.diag(random.uniform(0.0, 9.0, size))
    rank = {"full": size, "low": 1 + size // 4}[kind]
    root = random.normal(size=(size, rank)) * 10.0 ** random.uniform(-3, 3, rank)
    return root @ root.T


@given(
    kind=st.sampled_from(["nothing", "diagonal", "full", "low"]),
    size=st.integers(1, 40),
    seed=st.integers(0, 999),
    scale=st.sampled_from([1e-120, 1e-6, 1.0, 1e6, 1e120]),
)
def test_shifted_systems_have_the_solutions_of_numpy(kind, size, seed, scale):
    matrix = matrices(kind, size, seed)
    random = np.random.default_rng(seed)
    shifts = max(np.abs(matrix).max(), 1.0) * 10.0 ** random.uniform(-4.0, 1.0, 5)
    sides = random.normal(size=(size, 5))
    systems = shifted_systems(scale * matrix, sides)
    squares, logarithms = systems.squares(scale * shifts)
    solved = systems.solutions(scale * shifts)
    for number, shift in enumerate(shifts):
        system = matrix + shift * np.eye(size)
        expected = np.linalg.solve(system, sides)
        found = scale * solved[:, number]
        np.testing.assert_allclose(found, expected[:, number], atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(scale * squares[number], (sides * expected).sum(0), rtol=1e-8)
        wanted = np.linalg.slogdet(system)[1] + size * np.log(scale)
        assert logarithms[number] == pytest.approx(wanted, rel=1e-9, abs=1e-9 * size)


@given(size=st.integers(1, 40), seed=st.integers(0, 999))
def test_rows_are_rotated(size, seed):
    matrix, random = matrices("full", size, seed), np.random.default_rng(seed)
    sides = random.normal(size=(size, 3))
    made = shifted_systems(matrix, sides)
    np.testing.assert_allclose(np.linalg.norm(made.rotated, axis=0), np.linalg.norm(sides, axis=0))
    full = np.diag(made.diagonal) + np.diag(made.beside, 1) + np.diag(made.beside, -1)
    own, expected = np.linalg.eigvalsh(full), np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(own, expected, atol=1e-10 * expected.max())
