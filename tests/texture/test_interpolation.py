"""Linear interpolation over triangles and tetrahedra, against scipy's."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from mmt.texture.interpolation.delaunay import locate, triangulate

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


def test_vertices_and_edges_are_found_exactly():
    mesh = triangulate(cloud(7, 30, 2))
    edge = np.column_stack([np.linspace(0, 1, 101), np.zeros(101)])
    for queries in (mesh.points, edge):
        found = interpolated(mesh, mesh.points, queries)
        np.testing.assert_allclose(found, queries, atol=1e-12)


def test_values_are_continuous_across_faces():
    mesh = triangulate(cloud(6, 60, 3))
    values = np.random.default_rng(7).standard_normal((len(mesh.points), 1))
    generator = np.random.default_rng(8)
    inner = mesh.triangles[(mesh.triangles[:, 4:] >= 0).all(axis=1)]
    faces = mesh.points[inner[:, 1:4]]  # opposite the first corner
    shares = generator.dirichlet([1.0, 1.0, 1.0], len(faces))
    on_face = np.einsum("fc,fck->fk", shares, faces)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normal *= 1e-10 / np.linalg.norm(normal, axis=1, keepdims=True)
    sides = [
        interpolated(mesh, values, queries)
        for queries in (on_face - normal, on_face, on_face + normal)
    ]
    assert np.ptp(sides, axis=0).max() < 1e-6


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
