"""Radial basis function networks against scipy's, and against retraining."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator

from mmt.texture.interpolation.network_solving import RadialBasisNetwork
from mmt_methods.selection.published import NetworkNeighbours


def scattered(count, dimensions, outputs=4, seed=0):
    generator = np.random.default_rng(seed)
    points = generator.random((count, dimensions))
    return points, np.sin(3.0 * points @ generator.standard_normal((dimensions, outputs)))


def by_scipy(points, values, queries):
    return RBFInterpolator(points, values, kernel="thin_plate_spline", degree=1)(queries)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("count", [4, 60, 300])
def test_a_network_is_scipys(count, dimensions):
    points, values = scattered(count, dimensions)
    queries = np.random.default_rng(1).random((20, dimensions))
    network = RadialBasisNetwork(points, values)
    np.testing.assert_allclose(
        network.at(queries), by_scipy(points, values, queries), rtol=0, atol=1e-9
    )


@given(
    count=st.integers(1, 25),
    place=st.sampled_from(["anywhere", "corner", "line", "grid", "plane"]),
    level=st.sampled_from([0.0, 1e-300, 1.0, 1e100]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60)
def test_wherever_samples_lie_the_network_goes_through_them(count, place, level, seed):
    points, values = scattered(count, 3, seed=seed)
    if place == "corner":
        points *= 0.02
    elif place == "line":
        points[:] = points[0] * np.linspace(0.1, 1.0, count)[:, None]
    elif place == "grid":
        points = np.unique(np.round(points * 4.0) / 4.0, axis=0)
    elif place == "plane":
        points[:, 2] = 0.5
    values = level * values[: len(points)]
    found = RadialBasisNetwork(points, values).at(points)
    np.testing.assert_allclose(found, values, rtol=0, atol=1e-6 * np.abs(values).max(initial=0.0))


def test_samples_that_coincide_have_their_mean():
    points, values = scattered(30, 3)
    network = RadialBasisNetwork(np.vstack([points, points[:3]]), np.vstack([values, -values[:3]]))
    np.testing.assert_allclose(network.at(points[:3]), 0.0, atol=1e-6)
    np.testing.assert_allclose(network.at(points[3:]), values[3:], atol=1e-6)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_prediction_without_a_point_is_that_of_retraining(dimensions):
    points, values = scattered(24, dimensions)
    present = np.ones(24, dtype=bool)
    neighbours = NetworkNeighbours(points, values, present)
    for gone in (None, 3, 20, 0, 7):
        if gone is not None:
            neighbours.remove(gone)
            present[gone] = False
        for left in np.flatnonzero(present).tolist():
            others = present & (np.arange(24) != left)
            guess = by_scipy(points[others], values[others], points[left : left + 1])
            np.testing.assert_allclose(neighbours.predict(left), guess[0], rtol=1e-6, atol=1e-8)
    for left in (3, 7):
        guess = by_scipy(points[present], values[present], points[left : left + 1])
        np.testing.assert_allclose(neighbours.predict(left), guess[0], rtol=1e-7, atol=1e-9)
        neighbours.add(left)
        present[left] = True


def test_without_a_point_that_alone_tells_a_polynomial_nothing_is_known():
    points, values = scattered(12, 3)
    points[:, 2] = 0.5
    points[5, 2] = 0.9
    neighbours = NetworkNeighbours(points, values, np.ones(12, dtype=bool))
    assert neighbours.predict(5) is None
    assert neighbours.predict(4) is not None
    neighbours.remove(5)
    others = np.arange(12) != 5
    others[4] = False
    plane = RBFInterpolator(points[others][:, :2], values[others], degree=1)(points[4:5, :2])
    np.testing.assert_allclose(neighbours.predict(4), plane[0], rtol=1e-6, atol=1e-8)
