"""Networks and linear interpolation against scipy's, and the nearest valid frequencies."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator
from scipy.optimize import isotonic_regression, minimize
from scipy.spatial import Delaunay

from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.delaunay import locate, triangulate
from mmt.texture.interpolation.network_solving import RadialBasisNetwork
from mmt.texture.interpolation.networks import LEAST_GAP, least_gap, nearest_valid_lsf
from mmt_methods.selection.published import NetworkNeighbours


def scattered(count, dimensions, outputs=4, seed=0):
    generator = np.random.default_rng(seed)
    points = generator.random((count, dimensions))
    return points, np.sin(3.0 * points @ generator.standard_normal((dimensions, outputs)))


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("count", [4, 60, 300])
def test_a_network_is_scipys(count, dimensions):
    points, values = scattered(count, dimensions)
    queries = np.random.default_rng(1).random((20, dimensions))
    network = RadialBasisNetwork(points, values)
    expected = RBFInterpolator(points, values, kernel="thin_plate_spline", degree=1)(queries)
    np.testing.assert_allclose(network.at(queries), expected, rtol=0, atol=1e-9)


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


ANY = st.floats(allow_nan=True, allow_infinity=True)
NEAR = st.floats(-1.0, 5.0)


def bounds(count, gap):
    """Return the widest bounds, each a gap apart."""
    steps = gap * np.arange(count)
    return gap + steps, np.pi - gap * count + steps


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
    if gap >= 1e-6:  # many that are closer may not tell a filter, and the conversion refuses them
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


def test_the_gap_is_the_samples_own_where_that_is_smaller():
    apart = np.array([[0.2, 0.9, 1.7], [0.3, 1.0, 3.0]])
    assert least_gap(apart) == LEAST_GAP
    assert least_gap(np.vstack([apart, [[0.2, 0.21, 1.0]]])) == pytest.approx(0.01)
    assert least_gap(np.vstack([apart, [[0.005, 0.5, 1.0]]])) == pytest.approx(0.005)
    assert least_gap(np.full((1, 64), np.pi) * np.arange(1, 65) / 65) == LEAST_GAP


DIMENSIONS = pytest.mark.parametrize("dimensions", [2, 3])
START = np.array([0.37, 0.81, 0.2])


def corners_of(dimensions):
    return np.array(list(product((0.0, 1.0), repeat=dimensions)))


def cloud(seed, count, dimensions):
    inside = np.random.default_rng(seed).random((count, dimensions))
    return np.vstack([corners_of(dimensions), inside])


def interpolated(mesh, values, queries):
    corners, weights = mesh.weights(queries)
    return np.einsum("kc,kcv->kv", weights, values[corners])


@DIMENSIONS
@pytest.mark.parametrize("count", [0, 1, 5, 400])
def test_agrees_with_scipy(count, dimensions):
    points = cloud(3, count, dimensions)
    values = np.random.default_rng(4).standard_normal((len(points), 3))
    queries = np.random.default_rng(5).random((500, dimensions))
    mesh, delaunay = triangulate(points), Delaunay(points)
    expected = LinearNDInterpolator(delaunay, values)(queries)
    np.testing.assert_allclose(interpolated(mesh, values, queries), expected, atol=1e-11)
    found = delaunay.simplices[delaunay.find_simplex(queries)]
    corners, _ = mesh.weights(queries)
    np.testing.assert_array_equal(np.sort(corners, axis=1), np.sort(found, axis=1))


@pytest.mark.parametrize(("dimensions", "digits"), [(2, 5), (3, 3)])
@settings(max_examples=60)
@given(
    hnp.arrays(np.float64, (7, 3), elements=st.floats(0.0, 1.0, width=32)),
    hnp.arrays(np.float64, (20, 3), elements=st.floats(-1.0, 2.0, width=32)),
)
def test_weights_are_convex_and_reproduce_the_point(dimensions, digits, points, queries):
    points, queries = points[:, :dimensions], queries[:, :dimensions]
    vertices = np.vstack([corners_of(dimensions), np.round(points, digits)])
    mesh = triangulate(np.unique(vertices, axis=0))
    _, weights = mesh.weights(queries)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    found = interpolated(mesh, mesh.points, queries)
    np.testing.assert_allclose(found, np.clip(queries, 0, 1), atol=1e-6)


@DIMENSIONS
@pytest.mark.parametrize("start", [-5, 0, 10**6])
def test_any_start_leads_to_the_simplex(start, dimensions):
    mesh, point = triangulate(cloud(8, 200, dimensions)), START[:dimensions].copy()
    weights = np.empty(dimensions + 1)
    simplex = locate(mesh.points, mesh.triangles, start, point, weights)
    found = weights @ mesh.points[mesh.triangles[simplex, : dimensions + 1]]
    np.testing.assert_allclose(found, point, atol=1e-12)


@pytest.mark.parametrize("side", [3, 5])
def test_a_lattice_whose_tetrahedra_may_be_flat_is_covered(side):
    ticks = np.linspace(0.0, 1.0, side)
    lattice = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    mesh = triangulate(lattice)
    edges = mesh.points[mesh.triangles[:, 1:4]] - mesh.points[mesh.triangles[:, :1]]
    volumes = np.abs(np.linalg.det(edges)) / 6.0
    assert volumes.sum() == pytest.approx(1.0, abs=1e-12)
    queries = np.vstack([lattice, np.random.default_rng(1).random((300, 3))])
    found = interpolated(mesh, mesh.points, queries)
    np.testing.assert_allclose(found, queries, atol=1e-9)
