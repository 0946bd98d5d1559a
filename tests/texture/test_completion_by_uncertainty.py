"""The share that is expected to be right: known answers, properties, and where to stroke next."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_samples import scattered, speed_of
from stream_samples import aligned

from mmt.texture.completion.criterion import Progress
from mmt.texture.completion.distance import cells_of
from mmt.texture.completion.uncertainty import (
    PRIOR_S,
    CompletionGrid,
    StrokingDensity,
    UncertaintyCriterion,
    predict_gains,
)
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.observations import BLOCK_VARIANCE
from mmt.texture.field.posterior import LevelField
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import START_SHARE, STOP_SHARE, ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, TextureSamples

DIMENSIONS = pytest.mark.parametrize("dimensions", [2, 3])


def strokes(count, dimensions, seed=0, largest=0.95):
    return scattered(count, dimensions == 3, seed) * (largest / 0.95)


def field_of(points, extra=0.0, at=None):
    """Return the field of 20 blocks at each point, and of so many more at another."""
    everything = points if at is None else np.vstack([points, at])
    counts = np.full(len(everything), 20.0)
    counts[len(points) :] = extra
    power = speed_of(everything) * everything[:, -1] ** 0.7
    return LevelField(FieldCells.of_segments(everything, power, counts, BLOCK_VARIANCE))


def model_of(points, power=1.0):
    space = ISOTROPIC if points.shape[1] == 2 else ANISOTROPIC
    level = power * speed_of(points) * points[:, -1] ** 0.7
    lsf = np.tile([0.5, 1.0, 2.0, 2.5], (len(points), 1))
    each = np.full(len(points), 80.0)
    return TextureModel(TextureSamples(points * space.scale, lsf, 0.5 * level, level, space, each))


def motion(seconds, speed_mm_s, force_n, heading=0.0, *, valid=True):
    count = round(1000 * seconds)
    return aligned(
        np.zeros((count, 1, 1)),
        velocity_mm_s=[speed_mm_s * math.cos(heading), speed_mm_s * math.sin(heading)],
        speed_mm_s=speed_mm_s,
        normal_force_n=force_n,
        valid=valid,
    )


def grid_of(dimensions):
    return CompletionGrid(ISOTROPIC if dimensions == 2 else ANISOTROPIC)


def density(dimensions):
    return StrokingDensity(grid_of(dimensions), ModellingSettings())


def seconds_of(seen):
    """Return the seconds of stroking at each node, without those of the prior."""
    weights = seen.weights
    return weights * (PRIOR_S + seen.total_s) - PRIOR_S / len(weights)


def share(field, grid):
    return float(predict_gains(field, grid, np.full(len(grid), 1 / len(grid)))[0].mean())


@DIMENSIONS
def test_strokes_are_wanted_where_the_level_is_least_sure(dimensions):
    grid, field = grid_of(dimensions), field_of(near := strokes(40, dimensions, largest=0.3))
    right, gain = predict_gains(field, grid, np.full(len(grid), 1 / len(grid)))
    _, deviation_db = field.level_db(grid.points)
    best, worst = int(np.argmax(gain)), int(np.argmin(gain))
    assert deviation_db[best] > deviation_db[worst]
    assert right[best] < right[worst]
    assert (gain >= -1e-9).all()
    after = field_of(near, 20.0, grid.points[[best]])
    assert share(after, grid) > share(field, grid)


@DIMENSIONS
def test_an_operator_who_has_not_stroked_may_stroke_anywhere(dimensions):
    still = density(dimensions)
    still.add(AlignedBlock.empty())
    still.add(motion(1.0, 5.0, 1.0))  # too slow
    still.add(motion(1.0, 100.0, 0.05))  # in the air
    still.add(motion(1.0, 100.0, 1.0, valid=False))
    count = len(grid_of(dimensions))
    np.testing.assert_allclose(still.weights, np.full(count, 1 / count))


@given(speed_mm_s=st.floats(25.0, 285.0), force_n=st.floats(0.25, 2.85))
def test_motion_counts_at_the_strokes_next_to_it_and_on_average_where_it_was(speed_mm_s, force_n):
    seen, inputs = density(2), grid_of(2).points * (300.0, 3.0)
    seen.add(motion(0.5, speed_mm_s, force_n))
    seconds = seconds_of(seen)
    assert seconds @ inputs / seen.total_s == pytest.approx([speed_mm_s, force_n])
    away = np.abs(inputs[seconds > 1e-9] - (speed_mm_s, force_n))
    assert (away <= (290.0 / 12, 2.9 / 12)).all()


@given(heading=st.floats(-10.0, 10.0))
def test_motion_counts_at_the_headings_next_to_it(heading):
    grid, seen = grid_of(3), density(3)
    seen.add(motion(0.5, 150.0, 1.5, heading))
    turns = np.arctan2(grid.points[:, 1], grid.points[:, 0])
    along = seconds_of(seen) @ np.exp(1j * (turns - heading))
    step = 2.0 * np.pi / 12
    assert seen.total_s == pytest.approx(0.5)
    assert 0.5 * np.cos(step / 2) <= along.real + 1e-9
    assert abs(along.imag) <= 0.5 * np.tan(step / 2) ** 3


def test_motion_beyond_the_grid_counts_at_its_end():
    fast, slow = density(2), density(2)
    fast.add(motion(1.0, 5000.0, 30.0))
    slow.add(motion(1.0, 10.0, 0.1))
    assert int(np.argmax(fast.weights)) == len(grid_of(2)) - 1
    assert int(np.argmax(slow.weights)) == 0


@DIMENSIONS
def test_every_cell_has_strokes_and_each_stroke_its_cell(dimensions):
    grid = grid_of(dimensions)
    cells = cells_of(dimensions)
    assert set(grid.cells.tolist()) == set(range(len(cells.centres)))
    np.testing.assert_allclose(grid.mean_of_cells(np.ones(len(grid))), np.ones(len(cells.centres)))
    middle = np.abs(grid.points - cells.centres[grid.cells])
    assert (middle[:, -1] <= 1 / 6 + 1e-9).all()
    assert middle[:, :-1].max() < (1 / 6 + 1e-9 if dimensions == 2 else 0.5)


def criterion(inputs="isotropic"):
    return UncertaintyCriterion(ModellingSettings(inputs=inputs))


def test_without_a_model_or_any_power_nothing_is_expected_right():
    judge = criterion()
    assert judge.progress.value == 0.0
    judge.update(None, 1.0)
    judge.update(model_of(strokes(3, 2), power=0.0), 2.0)
    assert (judge.progress.value, judge.progress.advice) == (0.0, None)
    assert not judge.started


@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_thresholds_are_met_as_samples_come_and_stay_met(inputs):
    judge, dimensions = criterion(inputs), 2 if inputs == "isotropic" else 3
    points = strokes(150, dimensions)
    values = []
    for count in (1, 4, 12, 40, 150):
        judge.update(model_of(points[:count]), float(count))
        values.append(judge.progress.value)
    assert values[0] < START_SHARE < STOP_SHARE < values[-1]
    assert judge.stop_s is not None
    assert 1.0 < judge.start_s <= judge.stop_s
    judge.update(None, 1000.0)
    assert judge.stopped


@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_the_next_stroke_is_wanted_where_no_sample_lies_but_the_operator_moves(inputs):
    judge, dimensions = criterion(inputs), 2 if inputs == "isotropic" else 3
    judge.update(model_of(strokes(30, dimensions, largest=0.3)), 1.0)
    advice = judge.progress.advice
    assert len(advice) == dimensions
    assert math.hypot(*advice[:-1]) > 120.0
    assert advice[-1] > 1.0
    assert len(judge.progress.cells) == len(cells_of(dimensions).centres)
    assert 0.0 <= min(judge.progress.cells) < max(judge.progress.cells) <= 1.0


def expected(points):
    judge = criterion()
    judge.update(model_of(points), 1.0)
    return judge.progress.value


def test_what_samples_of_another_surface_have_met_is_taken_back_with_them():
    judge = criterion()
    judge.revoke_since(0.0)
    few = next(n for n in range(4, 12) if expected(strokes(n, 2)) > START_SHARE)
    judge.update(model_of(strokes(few, 2)), 2.0)
    assert judge.started
    assert not judge.stopped
    judge.update(model_of(strokes(150, 2)), 8.0)
    judge.revoke_since(1.0)  # they are still met
    judge.update(model_of(strokes(few, 2)), 9.0)
    judge.revoke_since(8.0)
    assert (judge.start_s, judge.stop_s) == (2.0, 8.0)
    judge.revoke_since(7.0)
    assert (judge.start_s, judge.stop_s) == (2.0, None)
    judge.update(None, 10.0)
    judge.revoke_since(1.0)
    assert not judge.started


def test_it_is_evaluated_again_after_two_hundredths_more_of_stroking():
    judge = criterion()
    judge.density.add(motion(100.0, 120.0, 1.2))
    judge.update(None, 100.0)
    assert judge.due
    judge.update(model_of(strokes(8, 2)), 100.0)
    assert not judge.due
    judge.density.add(motion(1.8, 120.0, 1.2))
    assert not judge.due
    judge.density.add(motion(0.4, 120.0, 1.2))
    assert judge.due


@pytest.mark.parametrize(
    ("value", "cells", "words"),
    [
        (0.5, 0.5, "differ from"),
        (0.5, 0.78, "where less is known"),
        (0.79, 0.5, ""),
        (0.9, 0.8, ""),
    ],
)
def test_a_fall_of_the_expected_share_has_a_reason(value, cells, words):
    scale = ModellingSettings().scale
    before = Progress(scale, 0.8, (0.8,) * 9)
    why = Progress(scale, value, (cells,) * 9).why_less_than(before)
    assert words in why
    assert bool(words) == bool(why)
    published = ModellingSettings(method="published").scale
    assert Progress(published, 3.0, ()).why_less_than(Progress(published, 9.0, ())) == ""


@given(
    st.floats(0.0, 400.0).filter(lambda speed: min(speed % 100.0, -speed % 100.0) > 1e-9),
    st.floats(0.0, 4.0).filter(lambda force: min(force % 1.0, -force % 1.0) > 1e-9),
    st.floats(0.0, 1.0) | st.just(STOP_SHARE),
    st.floats(-4.0, 4.0),
)
def test_a_share_is_told_with_the_strokes_that_help_most(speed, force, value, heading):
    velocity = speed * math.cos(heading), speed * math.sin(heading)
    scale = ModellingSettings().scale
    share = f"{100 * value:.0f} of {100 * STOP_SHARE:.0f} %"
    for advice in ((speed, force), (*velocity, force)):
        told = str(Progress(scale, value, (), advice))
        pace, least = ("slow", "medium", "fast")[min(int(speed / 100.0), 2)], min(int(force), 2)
        helpful = f": {pace} strokes with {least} to {least + 1} N" if value < STOP_SHARE else ""
        assert told == share + helpful
    assert str(Progress(scale, value, ())) == share
    progress = Progress(ModellingSettings(method="published").scale, 5.12344, (), (1.0, 1.0))
    assert str(progress) == f"{progress.scale.title} 5.12"
    assert progress.as_dict() == {"criterion": progress.scale.criterion, "value": 5.1234}
