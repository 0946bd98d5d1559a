import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gamma, kv

from mmt.texture.selection.neighbour_prediction import SMOOTHNESS, NeighbourPredictor


def matern(distance):
    """Smoothness 5/2 by its Bessel function."""
    scaled = np.maximum(np.sqrt(5.0) * distance, 1e-9)
    return 2.0**-1.5 / gamma(2.5) * scaled**2.5 * kv(2.5, scaled)


def compressed(points):
    speed = np.hypot.reduce(points[:, :-1], axis=1) if points.shape[1] > 2 else points[:, 0]
    growth = np.log(1.0 + 20.0 * speed)
    return points[:, :-1] * (growth / speed)[:, None], growth, np.log(1.0 + 20.0 * points[:, -1])


def prior(points, smoothness):
    """The covariance as it is written down, all pairs at once."""
    velocity, growth, force = compressed(points)
    departure, length = smoothness
    away = matern(np.linalg.norm(velocity[:, None] - velocity, axis=2) / length)
    if points.shape[1] > 2:
        away += 0.9 * matern(np.linalg.norm(velocity[:, None] + velocity, axis=2) / length)
        own = np.sqrt(np.diag(away))
        away /= np.outer(own, own)
    along = matern(np.abs(force[:, None] - force) / 5.0)
    law = np.column_stack([growth, force])
    return departure**2 * away * along, law


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_weights_are_those_of_ordinary_kriging(dimensions):
    generator = np.random.default_rng(1)
    points = generator.uniform(0.1, 1.0, (20, dimensions))
    if dimensions == 3:
        points[:, 0] *= generator.choice([-1.0, 1.0], 20)
    variances = generator.uniform(0.05, 0.2, 20)
    asked = NeighbourPredictor(points, variances, generator.normal(size=(20, 5)))
    found = asked.predict_from(np.ones(20, dtype=np.bool_))
    departure, law = prior(points, SMOOTHNESS[asked.smoothness])
    for index, members in enumerate(found.members):
        k = len(members)
        assert k == 19
        slopes = law[members] - law[index]
        system = np.zeros((k + 1, k + 1))
        system[:k, :k] = departure[np.ix_(members, members)] + 1.44 * slopes @ slopes.T
        system[:k, :k] += np.diag(variances[members])
        system[k, :k] = system[:k, k] = 1.0
        expected = np.linalg.solve(system, np.append(departure[members, index], 1.0))[:k]
        np.testing.assert_allclose(found.weights[index], expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4])
def test_a_consensus_takes_nobodys_own_word_and_follows_a_power_law(dimensions):
    generator = np.random.default_rng(8)
    points = generator.uniform(0.05, 1.0, (150, dimensions))
    values = np.log(1.0 + 20.0 * points[:, -1:]) * np.array([0.7, -1.0]) + 3.0
    present = generator.random(150) < 0.8
    asked = NeighbourPredictor(points, np.full(150, 1e-3), values)
    found = asked.predict_from(present)
    np.testing.assert_allclose(found.weights.sum(axis=1), 1.0)
    assert present[found.members].all()
    assert not (found.members == np.arange(150)[:, None]).any()
    assert all(len(set(row)) == len(row) for row in found.members.tolist())
    assert np.abs(found.of(values) - values).max() < 0.05


def test_who_left_leaves_the_others_as_they_would_be_had_he_never_spoken():
    generator = np.random.default_rng(2)
    points, values = generator.random((80, 3)), generator.normal(size=(80, 4))
    asked = NeighbourPredictor(points, np.full(80, 0.1), values)
    present = np.ones(80, dtype=np.bool_)
    asked.predict_from(present)
    present[::9] = False
    again = asked.predict_from(present)
    afresh = NeighbourPredictor(points, np.full(80, 0.1), values).predict_from(present)
    np.testing.assert_array_equal(again.members, afresh.members)
    np.testing.assert_array_equal(again.weights, afresh.weights)


def test_lines_that_follow_the_speed_are_less_smooth_than_a_resonance():
    generator = np.random.default_rng(3)
    points = generator.uniform(0.1, 1.0, (200, 2))
    grid = np.linspace(0.0, 1.0, 60)
    noise = 0.2 * generator.normal(size=(200, 60))
    line = 3.0 / (1.0 + (20.0 * (grid - points[:, :1])) ** 2)
    still = 3.0 / (1.0 + (20.0 * (grid - 0.5)) ** 2) + np.log(points[:, :1])
    lines, resonance = (
        NeighbourPredictor(points, np.full(200, 0.04), shape + noise).smoothness
        for shape in (line, still)
    )
    assert SMOOTHNESS[lines][1] < SMOOTHNESS[resonance][1]


@settings(max_examples=30, deadline=None)
@given(
    st.integers(2, 40),
    st.integers(1, 4),
    st.sampled_from([0.0, 1e-12, 1.0, 1e6]),
    st.integers(0, 2**32 - 1),
)
def test_whatever_the_points_there_are_weights_and_they_have_sum_one(n, dimensions, reach, seed):
    generator = np.random.default_rng(seed)
    points = reach * generator.normal(size=(n, dimensions)).round(1)
    asked = NeighbourPredictor(points, np.full(n, 1e-6), generator.normal(size=(n, 3)))
    found = asked.predict_from(np.ones(n, dtype=np.bool_))
    np.testing.assert_allclose(found.weights.sum(axis=1), 1.0, rtol=1e-6)
