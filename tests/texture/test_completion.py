import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from random_samples import scattered
from scipy.spatial import cKDTree

from mmt.texture.completion.distance import (
    CELL_CENTRES,
    CompletionMonitor,
    cell_distances,
    cells_of,
    distance_sum,
    reachable_centres,
)
from mmt.texture.settings import DISTANCES, ModellingSettings

PUBLISHED = ModellingSettings(method="published")
SPACES = pytest.mark.parametrize(
    ("cells", "largest"), [(cells_of(2), [1.0, 1.0]), (cells_of(3), [0.7, -0.7, 1.0])]
)


@SPACES
def test_agrees_with_a_search_tree(cells, largest):
    points = np.random.default_rng(2).random((50, len(largest))) * largest
    distances, _ = cKDTree(points).query(cells.centres, k=len(largest) + 1)
    np.testing.assert_allclose(cell_distances(points), distances.sum(axis=1))
    farthest = len(cells.centres) * (len(largest) + 1) * cells.farthest
    assert distance_sum(points[:0]) == pytest.approx(farthest)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_missing_neighbours_count_as_the_diagonal(count):
    points = np.full((count, 2), 0.5)
    middle = cell_distances(points)[4]
    assert middle == pytest.approx((3 - count) * cells_of(2).farthest)


@SPACES
@settings(max_examples=80)
@given(shares=hnp.arrays(np.float64, (7, 3), elements=st.floats(0.0, 1.0)))
def test_an_added_sample_never_raises_the_sum(cells, largest, shares):
    points = shares[:, : len(largest)] * largest
    for count in range(len(points)):
        before = distance_sum(points[:count])
        assert distance_sum(np.vstack([points[:count], points[-1:]])) <= before + 1e-12


def test_the_monitor_remembers_when_each_criterion_was_met():
    monitor = CompletionMonitor(PUBLISHED)
    monitor.update(np.empty((0, 2)), 1.0)
    assert not monitor.started
    assert math.isfinite(monitor.progress.value)
    assert monitor.progress.advice is None
    assert monitor.progress.scale == PUBLISHED.scale
    monitor.update(CELL_CENTRES[:5], 2.0)
    first = monitor.progress.value
    distances = cell_distances(CELL_CENTRES[:5])
    assert monitor.progress.cells == tuple(distances)
    assert first == pytest.approx(sum(distances))
    farthest = CELL_CENTRES[np.argmax(distances)]
    assert monitor.progress.advice == pytest.approx((300.0 * farthest[0], 3.0 * farthest[1]))
    monitor.update(np.repeat(CELL_CENTRES, 3, axis=0), 3.0)
    assert monitor.progress.value == 0.0 < first
    assert monitor.stop_s == 3.0
    monitor.update(np.repeat(CELL_CENTRES, 3, axis=0), 4.0)
    assert monitor.stop_s == 3.0


def test_the_settings_hold_the_derived_thresholds():
    """Eq. (1), and the share of the samples with which it starts, in either space."""
    plane_stop = 9 * 3 * math.hypot(1 / 3, 1 / 3) / 3
    share = (plane_stop / 7.5) ** 2
    space_stop = 27 * 4 * math.hypot(2 / 3, 2 / 3, 1 / 3) / 3
    space_start = space_stop * share ** (-1 / 3)
    assert DISTANCES["isotropic"] == pytest.approx((7.5, plane_stop), abs=0.005)
    assert DISTANCES["anisotropic"] == pytest.approx((space_start, space_stop), abs=0.005)
    for inputs, usual in DISTANCES.items():
        assert ModellingSettings(inputs=inputs).distances == usual
    assert ModellingSettings(method="published", start_distance=9.0).distances == (9.0, 4.243)


def test_every_cell_of_velocity_and_force_can_be_reached():
    centres = reachable_centres()
    np.testing.assert_array_equal(centres, cells_of(3).centres)
    assert len(centres) == 27
    assert np.hypot(centres[:, 0], centres[:, 1]).max() < 1.0
    np.testing.assert_allclose(np.unique(centres[:, 2]), [1 / 6, 1 / 2, 5 / 6])
    for turn in (np.pi / 2, np.pi):  # the same for every quarter turn
        c, s = np.cos(turn), np.sin(turn)
        turned = centres @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        distances, _ = cKDTree(centres).query(turned)
        assert distances.max() < 1e-9


def test_strokes_of_one_heading_never_complete_a_model_of_velocity():
    generator = np.random.default_rng(3)
    many = np.column_stack(
        [generator.uniform(0, 1, 2000), np.zeros(2000), generator.uniform(0, 1, 2000)]
    )
    assert distance_sum(many) > DISTANCES["anisotropic"][0]
    assert distance_sum(many[:, [0, 2]]) < DISTANCES["isotropic"][1]
    assert distance_sum(scattered(2000, directed=True)) < DISTANCES["anisotropic"][1]
