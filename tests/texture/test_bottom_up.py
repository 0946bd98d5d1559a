from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.texture.segmentation.bottom_up import (
    CELL,
    cell_moments,
    stationary_pieces,
    straight_pieces,
)


def naive_bottom_up(starts, cost, limit, longest):
    """Keogh's loop as written: every cost anew at every step, the leftmost cheapest merge."""
    pieces = [(n, n + 1) for n in range(len(starts))]
    while True:
        candidates = [
            (cost(a, d), number)
            for number, ((a, _), (c, d)) in enumerate(pairwise(pieces))
            if not starts[c] and d - a <= longest
        ]
        cheapest = min(candidates, default=(np.inf, -1))
        if not cheapest[0] <= limit:
            begins = np.zeros(len(starts), dtype=bool)
            begins[[a for a, _ in pieces]] = True
            return begins
        number = cheapest[1]
        pieces[number : number + 2] = [(pieces[number][0], pieces[number + 1][1])]


def deviation(position_mm):
    start, chord = position_mm[0], position_mm[-1] - position_mm[0]
    length2 = chord @ chord
    share = np.clip((position_mm - start) @ chord / length2, 0, 1) if length2 > 0 else 0 * chord[:1]
    return np.linalg.norm(position_mm - start - np.outer(share, chord), axis=1).max()


def variation(inputs):
    return (inputs.std(axis=0) / inputs.mean(axis=0)).max()


@given(seed=st.integers(0, 10_000), cells=st.integers(0, 25), limit_mm=st.floats(0.01, 4.0))
@settings(max_examples=60)
def test_straight_pieces_equal_the_naive_loop(seed, cells, limit_mm):
    generator = np.random.default_rng(seed)
    steps = np.cumsum(generator.normal(size=(cells * CELL, 3)), axis=0)
    position_mm = 0.02 * np.cumsum(steps, axis=0)
    starts = generator.random(cells) < 0.1
    expected = naive_bottom_up(
        starts, lambda a, d: deviation(position_mm[a * CELL : d * CELL]), limit_mm, cells
    )
    np.testing.assert_array_equal(straight_pieces(starts, position_mm, limit_mm), expected)


@given(seed=st.integers(0, 10_000), cells=st.integers(0, 30), limit=st.floats(0.01, 0.9))
@settings(max_examples=60)
def test_pieces_of_a_steady_vector_equal_the_naive_loop(seed, cells, limit):
    generator = np.random.default_rng(seed)
    walk = np.cumsum(generator.normal(0.0, 0.05, (cells * CELL, 3)), axis=0)
    inputs = np.abs(walk[:, :1]) + 1.0, walk[:, 1:] + generator.normal(size=2)
    starts = generator.random(cells) < 0.1

    def cost(a, d):
        scalar, vector = (channels[a * CELL : d * CELL] for channels in inputs)
        deviation = np.sqrt(vector.var(axis=0).sum())
        return max(variation(scalar), deviation / np.linalg.norm(vector.mean(axis=0)))

    expected = naive_bottom_up(starts, cost, limit, cells)
    moments = cell_moments(np.hstack(inputs))
    found = stationary_pieces(starts, moments, limit, cells, vector=2)
    np.testing.assert_array_equal(found, expected)


@given(
    seed=st.integers(0, 10_000),
    cells=st.integers(0, 30),
    limit=st.floats(0.01, 0.6),
    longest_cells=st.integers(1, 12),
)
@settings(max_examples=60)
def test_stationary_pieces_equal_the_naive_loop(seed, cells, limit, longest_cells):
    generator = np.random.default_rng(seed)
    walk = np.cumsum(generator.normal(size=(cells * CELL, 2)), axis=0)
    inputs = np.exp(0.05 * walk) * [100.0, 1.0]
    starts = generator.random(cells) < 0.1
    expected = naive_bottom_up(
        starts, lambda a, d: variation(inputs[a * CELL : d * CELL]), limit, longest_cells
    )
    found = stationary_pieces(starts, cell_moments(inputs), limit, longest_cells)
    np.testing.assert_array_equal(found, expected)


def test_the_callers_moments_are_left_alone():
    moments = cell_moments(np.random.default_rng(1).normal(5.0, 0.1, size=(7 * CELL, 2)))
    before = moments.copy()
    stationary_pieces(np.zeros(7, bool), moments, 1.0, 7)
    np.testing.assert_array_equal(moments, before)


def test_a_glitch_does_not_spoil_its_neighbours():
    inputs = np.random.default_rng(2).normal(100.0, 5.0, size=(30 * CELL, 1))
    clean = stationary_pieces(np.zeros(30, bool), cell_moments(inputs), 0.2, 30)
    assert np.flatnonzero(clean).tolist() == [0]
    inputs[10 * CELL] = 1e12
    glitched = stationary_pieces(np.zeros(30, bool), cell_moments(inputs), 0.2, 30)
    assert np.flatnonzero(glitched).tolist() == [0, 10, 11]


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_what_is_no_number_is_never_joined(broken):
    inputs = np.full((9 * CELL, 2), 3.0)
    inputs[4 * CELL, 1] = broken
    with np.errstate(invalid="ignore"):
        moments = cell_moments(inputs)
    begins = stationary_pieces(np.zeros(9, bool), moments, 0.2, 9)
    assert np.flatnonzero(begins).tolist() == [0, 4, 5]
    path = np.zeros((9 * CELL, 3))
    path[4 * CELL, 1] = broken
    assert np.all(straight_pieces(np.zeros(9, bool), path, 0.2)[4:6])
