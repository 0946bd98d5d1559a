import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import LinearNDInterpolator

from mmt.texture.interpolation.delaunay import locate, triangulate

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def cloud(seed: int, count: int) -> np.ndarray:
    return np.vstack([CORNERS, np.random.default_rng(seed).random((count, 2))])


@pytest.mark.parametrize("count", [0, 1, 5, 400])
def test_agrees_with_scipy(count: int) -> None:
    points = cloud(3, count)
    values = np.random.default_rng(4).standard_normal((len(points), 3))
    queries = np.random.default_rng(5).random((500, 2))
    corners, weights = triangulate(points).weights(queries)
    ours = np.einsum("kc,kcv->kv", weights, values[corners])
    expected = LinearNDInterpolator(triangulate_as_scipy(points), values)(queries)
    np.testing.assert_allclose(ours, expected, atol=1e-12)


def triangulate_as_scipy(points: np.ndarray) -> object:
    from scipy.spatial import Delaunay

    return Delaunay(points)


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(np.float64, (7, 2), elements=st.floats(0.0, 1.0, width=32)),
    hnp.arrays(np.float64, (20, 2), elements=st.floats(-1.0, 2.0, width=32)),
)
def test_weights_are_convex_and_reproduce_the_point(
    points: np.ndarray, queries: np.ndarray
) -> None:
    vertices = np.unique(np.vstack([CORNERS, np.round(points, 5)]), axis=0)
    mesh = triangulate(vertices)
    corners, weights = mesh.weights(queries)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    found = np.einsum("kc,kcv->kv", weights, mesh.points[corners])
    np.testing.assert_allclose(found, np.clip(queries, 0, 1), atol=1e-6)


def test_vertices_and_edges_are_found_exactly() -> None:
    mesh = triangulate(cloud(7, 30))
    corners, weights = mesh.weights(mesh.points)
    found = np.einsum("kc,kcv->kv", weights, mesh.points[corners])
    np.testing.assert_allclose(found, mesh.points, atol=1e-12)
    edge = np.column_stack([np.linspace(0, 1, 101), np.zeros(101)])
    corners, weights = mesh.weights(edge)
    np.testing.assert_allclose(
        np.einsum("kc,kcv->kv", weights, mesh.points[corners]), edge, atol=1e-12
    )


@pytest.mark.parametrize("start", [-5, 0, 10**6])
def test_any_start_leads_to_the_triangle(start: int) -> None:
    mesh = triangulate(cloud(8, 200))
    weights = np.empty(3)
    triangle = locate(mesh.points, mesh.triangles, start, np.array([0.37, 0.81]), weights)
    found = weights @ mesh.points[mesh.triangles[triangle, :3]]
    np.testing.assert_allclose(found, [0.37, 0.81], atol=1e-12)
