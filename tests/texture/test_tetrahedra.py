import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from mmt.texture.interpolation.delaunay import locate, triangulate

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def cloud(seed: int, count: int) -> np.ndarray:
    return np.vstack([CORNERS, np.random.default_rng(seed).random((count, 3))])


@pytest.mark.parametrize("count", [1, 5, 400])
def test_agrees_with_scipy(count: int) -> None:
    points = cloud(3, count)
    values = np.random.default_rng(4).standard_normal((len(points), 3))
    queries = np.random.default_rng(5).random((500, 3))
    mesh = triangulate(points)
    corners, weights = mesh.weights(queries)
    ours = np.einsum("kc,kcv->kv", weights, values[corners])
    delaunay = Delaunay(points)
    np.testing.assert_allclose(ours, LinearNDInterpolator(delaunay, values)(queries), atol=1e-11)
    found = delaunay.simplices[delaunay.find_simplex(queries)]
    np.testing.assert_array_equal(np.sort(corners, axis=1), np.sort(found, axis=1))


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(np.float64, (7, 3), elements=st.floats(0.0, 1.0, width=32)),
    hnp.arrays(np.float64, (20, 3), elements=st.floats(-1.0, 2.0, width=32)),
)
def test_weights_are_convex_and_reproduce_the_point(
    points: np.ndarray, queries: np.ndarray
) -> None:
    mesh = triangulate(np.unique(np.vstack([CORNERS, np.round(points, 3)]), axis=0))
    corners, weights = mesh.weights(queries)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    found = np.einsum("kc,kcv->kv", weights, mesh.points[corners])
    np.testing.assert_allclose(found, np.clip(queries, 0, 1), atol=1e-6)


def test_values_are_continuous_across_faces() -> None:
    mesh = triangulate(cloud(6, 60))
    values = np.random.default_rng(7).standard_normal(len(mesh.points))
    generator = np.random.default_rng(8)
    inner = mesh.triangles[(mesh.triangles[:, 4:] >= 0).all(axis=1)]
    faces = mesh.points[inner[:, 1:4]]  # opposite the first corner
    shares = generator.dirichlet([1.0, 1.0, 1.0], len(faces))
    on_face = np.einsum("fc,fck->fk", shares, faces)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normal *= 1e-10 / np.linalg.norm(normal, axis=1, keepdims=True)
    sides = []
    for queries in (on_face - normal, on_face, on_face + normal):
        corners, weights = mesh.weights(queries)
        sides.append((weights * values[corners]).sum(axis=1))
    assert np.ptp(sides, axis=0).max() < 1e-6


@pytest.mark.parametrize("start", [-5, 0, 10**6])
def test_any_start_leads_to_the_tetrahedron(start: int) -> None:
    mesh = triangulate(cloud(8, 200))
    weights, point = np.empty(4), np.array([0.37, 0.81, 0.2])
    found = locate(mesh.points, mesh.triangles, start, point, weights)
    np.testing.assert_allclose(weights @ mesh.points[mesh.triangles[found, :4]], point, atol=1e-12)


@pytest.mark.parametrize("side", [3, 5])
def test_a_lattice_whose_tetrahedra_may_be_flat_is_covered(side: int) -> None:
    ticks = np.linspace(0.0, 1.0, side)
    lattice = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    mesh = triangulate(lattice)
    edges = mesh.points[mesh.triangles[:, 1:4]] - mesh.points[mesh.triangles[:, :1]]
    volumes = np.abs(np.linalg.det(edges)) / 6.0
    assert volumes.sum() == pytest.approx(1.0, abs=1e-12)
    queries = np.vstack([lattice, np.random.default_rng(1).random((300, 3))])
    corners, weights = mesh.weights(queries)
    found = np.einsum("kc,kcv->kv", weights, mesh.points[corners])
    np.testing.assert_allclose(found, queries, atol=1e-9)
