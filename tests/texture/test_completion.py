import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial import cKDTree

from mmt.texture.completion import (
    CELL_CENTRES,
    FARTHEST,
    STOP_DISTANCE,
    CompletionMonitor,
    cell_distances,
    distance_sum,
)

POINTS = hnp.arrays(np.float64, (6, 2), elements=st.floats(0.0, 1.0))


def test_the_threshold_is_the_papers() -> None:
    assert pytest.approx(4.2426, abs=1e-4) == STOP_DISTANCE
    assert len(CELL_CENTRES) == 9


def test_boundary_points_alone_would_switch_without_data() -> None:
    """Why they must not count: paper A's 20 boundary points sum to 6.76, below 7.5."""
    steps = np.arange(6) / 5
    boundary = {(a, b) for a in steps for b in (0.0, 1.0)} | {
        (b, a) for a in steps for b in (0.0, 1.0)
    }
    assert distance_sum(np.array(sorted(boundary))) == pytest.approx(6.76, abs=0.01)


def test_agrees_with_a_search_tree() -> None:
    points = np.random.default_rng(2).random((50, 2))
    distances, _ = cKDTree(points).query(CELL_CENTRES, k=3)
    np.testing.assert_allclose(cell_distances(points), distances.sum(axis=1))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_missing_neighbours_count_as_the_diagonal(count: int) -> None:
    points = np.full((count, 2), 0.5)
    middle = cell_distances(points)[4]
    assert middle == pytest.approx((3 - count) * FARTHEST)


@settings(max_examples=80, deadline=None)
@given(POINTS, st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_an_added_sample_never_raises_the_sum(
    points: np.ndarray, more: tuple[float, float]
) -> None:
    for count in range(len(points) + 1):
        before = distance_sum(points[:count])
        assert distance_sum(np.vstack([points[:count], [more]])) <= before + 1e-12


def test_the_monitor_remembers_when_each_criterion_was_met() -> None:
    monitor = CompletionMonitor()
    monitor.update(np.empty((0, 2)), 1.0)
    assert not monitor.started
    assert math.isfinite(monitor.distance)
    monitor.update(CELL_CENTRES[:5], 2.0)
    first = monitor.distance
    monitor.update(np.repeat(CELL_CENTRES, 3, axis=0), 3.0)
    assert monitor.distance == 0.0 < first
    assert monitor.stop_s == 3.0
    monitor.update(np.repeat(CELL_CENTRES, 3, axis=0), 4.0)
    assert monitor.stop_s == 3.0
