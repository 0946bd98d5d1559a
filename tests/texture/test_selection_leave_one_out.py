import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from mmt.texture.selection.leave_one_out import (
    DelaunayNeighbours,
    NearestNeighbour,
    hull_of,
    leave_each_out,
    retrained,
)


def rebuilt_simplex(points, present, index):
    """The simplex around a point's place in a triangulation made from scratch."""
    others = np.flatnonzero(present & (np.arange(len(points)) != index))
    triangulation = Delaunay(points[others])
    found = int(triangulation.find_simplex(points[index]))
    return None if found < 0 else set(others[triangulation.simplices[found]].tolist())


@settings(max_examples=15, deadline=None)
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
    members, weights, _ = leave_each_out(points)
    everybody = np.ones(n, dtype=bool)
    for index in range(n):
        expected = rebuilt_simplex(points, everybody, index)
        assert (members[index, 0] < 0) == (expected is None)
        if expected is not None:
            assert set(members[index].tolist()) == expected
            np.testing.assert_allclose(weights[index] @ points[members[index]], points[index])
            assert weights[index].sum() == pytest.approx(1.0)
            assert (weights[index] >= 0).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_points_that_leave_one_by_one_leave_a_delaunay_triangulation(dimensions):
    generator = np.random.default_rng(5)
    points = generator.random((70, dimensions))
    present = np.ones(70, dtype=bool)
    model = DelaunayNeighbours(points, points, present)
    for leaving in generator.permutation(70)[:40].tolist():
        model.remove(leaving)
        present[leaving] = False
        for index in generator.choice(np.flatnonzero(present), 4, replace=False).tolist():
            expected = rebuilt_simplex(points, present, index)
            found = model.simplex(index)
            assert (found is None) == (expected is None)
            assert found is None or set(found[0].tolist()) == expected


def test_points_that_join_one_by_one_make_a_delaunay_triangulation():
    generator = np.random.default_rng(6)
    points = generator.random((40, 3))
    present = np.zeros(40, dtype=bool)
    present[hull_of(points)] = True
    model = DelaunayNeighbours(points, points, present)
    for joining in np.flatnonzero(~present).tolist():
        expected = rebuilt_simplex(points, present, joining)
        found = model.simplex(joining)
        assert found is not None
        assert set(found[0].tolist()) == expected
        np.testing.assert_allclose(model.predict(joining), points[joining])
        model.add(joining)
        present[joining] = True


def test_the_corners_of_the_hull_are_those_that_the_others_do_not_enclose():
    points = np.random.default_rng(7).random((120, 3))
    members, _, _ = leave_each_out(points)
    np.testing.assert_array_equal(np.flatnonzero(members[:, 0] < 0), hull_of(points))


def test_a_repeated_point_is_predicted_by_its_twin():
    points = np.random.default_rng(8).random((30, 2))
    points = np.vstack([points, points[4], points[4]])
    values = np.arange(32.0)[:, None]
    values[[4, 30, 31]] = 99.0
    model = DelaunayNeighbours(points, values, np.ones(32, dtype=bool))
    for index in (4, 30, 31):
        assert model.predict(index) == pytest.approx(99.0)


@pytest.mark.parametrize(
    "points",
    [
        np.column_stack([np.linspace(0, 1, 9), np.linspace(0, 2, 9)]),
        np.zeros((5, 2)),
        np.zeros((1, 3)),
        np.random.default_rng(0).random((3, 3)),
    ],
    ids=["line", "one place", "one point", "too few"],
)
def test_points_that_span_nothing_are_all_corners_and_do_no_harm(points):
    assert len(hull_of(points)) == len(points)
    members, weights, _ = leave_each_out(points)
    enclosed = members[:, 0] >= 0
    np.testing.assert_allclose(
        np.einsum("nk,nkd->nd", weights[enclosed], points[members[enclosed]]),
        points[enclosed],
        atol=1e-9,
    )


def test_a_grid_whose_circles_hold_four_points_is_still_interpolated_exactly():
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    members, weights, _ = leave_each_out(grid)
    inner = members[:, 0] >= 0
    assert inner.sum() == 36 - 4
    np.testing.assert_allclose(
        np.einsum("nk,nkd->nd", weights[inner], grid[members[inner]]), grid[inner], atol=1e-9
    )


def test_scale_and_offset_of_the_points_change_nothing():
    points = np.random.default_rng(9).random((50, 2))
    expected, _, _ = leave_each_out(points)
    for scale, offset in ((1e-8, 0.0), (1e8, 0.0), (1.0, 1e3)):
        members, _, _ = leave_each_out(points * scale + offset)
        np.testing.assert_array_equal(np.sort(members), np.sort(expected))


def test_any_interpolator_can_be_trained_anew_for_every_question():
    from scipy.interpolate import LinearNDInterpolator

    points = np.random.default_rng(10).random((40, 2))
    values = np.random.default_rng(11).random((40, 3))
    present = np.ones(40, dtype=bool)
    anew = retrained(LinearNDInterpolator)(points, values, present)
    star = DelaunayNeighbours(points, values, present)
    corners = set(hull_of(points).tolist())
    for index in range(40):
        if index in corners:
            assert anew.predict(index) is None
            assert star.predict(index) is None
        else:
            np.testing.assert_allclose(anew.predict(index), star.predict(index))


def test_the_nearest_neighbour_is_the_nearest_that_is_there():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    model = NearestNeighbour(points, np.arange(3.0)[:, None], np.ones(3, dtype=bool))
    assert model.predict(0) == 1.0
    model.remove(1)
    assert model.predict(0) == 2.0
    model.add(1)
    assert model.predict(0) == 1.0
    model.remove(1)
    model.remove(2)
    assert model.predict(0) is None


def test_leaving_461_points_out_is_over_twenty_times_faster_than_rebuilding():
    points = np.random.default_rng(12).random((461, 3))
    leave_each_out(points)
    started = time.perf_counter()
    members, _, _ = leave_each_out(points)
    ours_s = time.perf_counter() - started
    everybody = np.ones(461, dtype=bool)
    started = time.perf_counter()
    for index in range(0, 461, 46):
        expected = rebuilt_simplex(points, everybody, index)
        assert expected is None or set(members[index].tolist()) == expected
    rebuilt_s = (time.perf_counter() - started) * 46
    assert rebuilt_s > 20 * ours_s
