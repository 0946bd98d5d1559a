"""Tridiagonal matrices against NumPy's own solutions, at the extremes too."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.texture.tridiagonal import rotated, shifted_solutions, shifted_squares, tridiagonal


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
    reduced = tridiagonal(scale * matrix)
    turned = rotated(reduced, sides)
    squares, logarithms = shifted_squares(reduced, turned, scale * shifts)
    solved = shifted_solutions(reduced, turned, scale * shifts)
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
    reduced = tridiagonal(matrix)
    turned = rotated(reduced, sides)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=0), np.linalg.norm(sides, axis=0))
    full = np.diag(reduced.diagonal) + np.diag(reduced.beside, 1) + np.diag(reduced.beside, -1)
    own, expected = np.linalg.eigvalsh(full), np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(own, expected, atol=1e-10 * expected.max())
