import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from mmt_methods.selection.points import enclose, enclose_without, hull_of


def rebuilt_simplex(points, index):
    """The simplex around a point's place in a triangulation of the others made from scratch."""
    others = np.delete(np.arange(len(points)), index)
    triangulation = Delaunay(points[others])
    found = int(triangulation.find_simplex(points[index]))
    return None if found < 0 else set(others[triangulation.simplices[found]].tolist())


@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimensions=st.sampled_from([2, 3]),
    n=st.integers(8, 40),
    clustered=st.booleans(),
)
def test_the_star_gives_the_simplex_of_a_triangulation_made_anew(seed, dimensions, n, clustered):
    generator = np.random.default_rng(seed)
    points = generator.random((n, dimensions))
    if clustered:
        points[: n // 2] *= 1e-3
    members, weights = enclose_without(points)
    for index in range(n):
        expected = rebuilt_simplex(points, index)
        assert (members[index, 0] < 0) == (expected is None)
        if expected is not None:
            assert set(members[index].tolist()) == expected
            np.testing.assert_allclose(weights[index] @ points[members[index]], points[index])
            assert weights[index].sum() == pytest.approx(1.0)
            assert (weights[index] >= 0).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_interpolation_is_that_of_scipy_and_says_where_it_has_none(dimensions):
    generator = np.random.default_rng(3)
    points, values = generator.random((50, dimensions)), generator.random((50, 4))
    places = generator.uniform(-0.2, 1.2, (80, dimensions))
    around = enclose(points, places)
    expected = LinearNDInterpolator(points, values)(places)
    np.testing.assert_allclose(around.interpolate(values), expected)
    np.testing.assert_array_equal(around.found, np.flatnonzero(np.isfinite(expected[:, 0])))


def test_a_repeated_point_is_predicted_by_its_twin():
    points = np.random.default_rng(8).random((30, 2))
    points = np.vstack([points, points[4], points[4]])
    values = np.arange(32.0)[:, None]
    values[[4, 30, 31]] = 99.0
    predicted = enclose_without(points).interpolate(values)
    np.testing.assert_allclose(predicted[[4, 30, 31]], 99.0)


@pytest.mark.parametrize(
    "points",
    [
        np.column_stack([np.linspace(0, 1, 9), np.linspace(0, 2, 9)]),
        np.zeros((5, 2)),
        np.zeros((1, 3)),
        np.random.default_rng(0).random((3, 3)),
        np.zeros((0, 2)),
    ],
    ids=["line", "one place", "one point", "too few", "none"],
)
def test_points_that_span_nothing_are_all_corners_and_enclose_nothing(points):
    assert len(hull_of(points)) == len(points)
    assert not enclose_without(points).found.size
    assert np.isnan(enclose(points, np.full((2, points.shape[1]), 0.5)).interpolate(points)).all()


def test_a_grid_whose_circles_hold_four_points_is_still_interpolated_exactly():
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    around = enclose_without(grid)
    assert len(around.found) == 36 - 4
    np.testing.assert_allclose(
        around.interpolate(grid)[around.found], grid[around.found], atol=1e-9
    )


def test_scale_and_offset_of_the_points_change_nothing():
    points = np.random.default_rng(9).random((50, 2))
    expected = enclose_without(points).members
    for scale, offset in ((1e-8, 0.0), (1e8, 0.0), (1.0, 1e3)):
        members = enclose_without(points * scale + offset).members
        np.testing.assert_array_equal(np.sort(members), np.sort(expected))
