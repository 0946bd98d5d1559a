"""The field of a texture's level: against formulas written out, its own prior, and extremes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_samples import scattered, speed_of
from scipy import stats

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power, reflection_to_lsf
from mmt.texture.field import cells as field_cells
from mmt.texture.field import covariance, observations
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.observations import BLOCK_VARIANCE, MOMENT_VARIANCE, choose, observe
from mmt.texture.field.posterior import (
    DB,
    TAIL_SCALE,
    LevelField,
    Prediction,
    right_probability,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import JND_DB
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, TextureSamples

DIRECTED = pytest.mark.parametrize("directed", [False, True])


def law(points):
    """A power law, in nepers."""
    return 1.4 * np.log(speed_of(points)) + 0.5 * np.log(points[:, -1]) + 0.7


def measured(points, seed=0, level=law):
    """Powers of blocks with the usual scatter."""
    degrees = 2.0 / BLOCK_VARIANCE
    random = np.random.default_rng(seed)
    return np.exp(level(points)) * random.chisquare(degrees, len(points)) / degrees


def in_turn(count):
    """Numbers in time of blocks, each of a moment of its own."""
    return 10 * np.arange(count)


def observed(cells):
    every = covariance.settings(16, directed=cells.directed)
    return observe(cells, every, choose(cells, every))


def samples_of(points, power, effective=80.0):
    space = ANISOTROPIC if points.shape[1] == 3 else ISOTROPIC
    lsf = np.tile(reflection_to_lsf(np.array([-0.5, 0.3])), (len(points), 1))
    each = np.full(len(points), effective)
    return TextureSamples(points * space.scale, lsf, 0.5 * power, power, space, each)


def covariance_written_out(a, b, h):
    """The prior between two strokes, one number at a time."""

    def matern(distance, length):
        r = math.sqrt(3) * abs(distance) / length
        return (1 + r) * math.exp(-r)

    (ua, va, ta), (ub, vb, tb) = a, b
    total = 16.0 + 0.5**2 * ua * ub + 0.3**2 * va * vb
    total += h[0] ** 2 * matern(ua - ub, h[1]) * matern(va - vb, h[2])
    cell = 0.15 if len(h) == 4 else 0.5
    total += h[3] ** 2 * matern(ua - ub, cell) * matern(va - vb, cell)
    if len(h) == 8:
        chord = math.dist((math.cos(ta), math.sin(ta)), (math.cos(tb), math.sin(tb)))
        around = h[4] ** 2 * matern(math.sin(ta - tb), h[5]) + h[6] ** 2 * matern(chord, h[7])
        total += around * matern(ua - ub, 8 * h[1]) * matern(va - vb, 8 * h[2])
    return total


@DIRECTED
def test_mean_and_deviation_are_those_of_the_formulas_written_out(directed):
    points = scattered(40, directed)
    cells = FieldCells.from_blocks(points, measured(points), in_turn(40))
    asked = scattered(5, directed, seed=9)
    field = LevelField(cells)
    found = observed(cells)
    known = list(zip(*cells.centres, strict=True))
    wanted = list(zip(*covariance.coordinates(asked), strict=True))
    errors = np.diag(found.variance)
    y = found.level
    middle = np.average(y, weights=1.0 / found.variance)
    evidence, each_mean, each_variance = [], [], []
    for h in covariance.settings(16, directed=directed):

        def matrix(a, b, h=h):
            return np.array([[covariance_written_out(p, q, h) for q in b] for p in a])

        total = matrix(known, known) + errors
        inverse = np.linalg.inv(total)
        evidence.append(
            -0.5 * (y - middle) @ inverse @ (y - middle) - 0.5 * np.linalg.slogdet(total)[1]
        )
        between = matrix(wanted, known)
        each_mean.append(between @ inverse @ (y - middle))
        each_variance.append(np.diag(matrix(wanted, wanted) - between @ inverse @ between.T))
    weights = np.exp(np.array(evidence) - max(evidence))
    weights /= weights.sum()
    mean = weights @ each_mean
    of_each = stats.t(3).var() * TAIL_SCALE**2 * np.array(each_variance)
    variance = weights @ (of_each + np.square(each_mean - mean))
    mean = mean + middle + [1.5 * u + 0.5 * v for u, v, _ in wanted]
    found = field.level_db(asked)
    np.testing.assert_allclose(found[0], DB * mean, atol=0.02)  # negligible settings are left out
    np.testing.assert_allclose(found[1], DB * np.sqrt(variance), rtol=0.02)


@DIRECTED
def test_a_field_drawn_from_the_prior_is_recovered_and_its_error_is_as_large_as_stated(directed):
    squares, expected, right = [], [], []
    every = covariance.settings(16, directed=directed)
    for seed in range(24):
        random = np.random.default_rng(seed)
        points, asked = scattered(300, directed, seed), scattered(60, directed, seed + 1000)
        at = covariance.coordinates(np.vstack([points, asked]))
        prior = covariance.prior_covariance(at, at, every[seed % len(every)])
        root = np.linalg.cholesky(prior + 1e-9 * np.eye(len(prior)))
        drawn = root @ random.standard_normal(len(prior)) + at.law
        power = measured(points, seed, level=lambda _, drawn=drawn: drawn[:300])
        field = LevelField(FieldCells.from_blocks(points, power, in_turn(300)))
        found = field.predict(covariance.coordinates(asked))
        error = found.mean - np.logaddexp(drawn[300:], math.log(field_cells.FELT_POWER))
        squares.append(np.mean(np.square(error / found.deviation)))
        expected.append(found.within(JND_DB / DB).mean())
        right.append(np.mean(np.abs(error) <= JND_DB / DB))
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.3
    assert np.mean(expected) == pytest.approx(np.mean(right), abs=0.06)
    assert np.mean(right) > (0.4 if directed else 0.65)


def unsteady(count, variance, seed):
    """Blocks of strokes that are ten blocks long, the moments of which differ in their level."""
    random = np.random.default_rng(seed)
    points = np.repeat(scattered(count // 10, seed=seed), 10, axis=0)
    off = np.repeat(random.normal(0.0, math.sqrt(variance), count // 10), 10)
    return points, measured(points, seed) * np.exp(off), np.arange(count)


def test_moments_that_scatter_are_found_to_and_those_that_do_not_are_not():
    usual = observed(FieldCells.from_blocks(scattered(1), np.ones(1), in_turn(1)))
    assert (usual.block, usual.moment) == pytest.approx((BLOCK_VARIANCE, MOMENT_VARIANCE))
    for variance, low, high in ((0.0, 0.009, 0.04), (0.5, 0.25, 0.75)):
        found = [
            observed(FieldCells.from_blocks(*unsteady(3000, variance, seed))) for seed in range(8)
        ]
        assert low < np.mean([one.moment for one in found]) < high
        assert np.mean([one.block for one in found]) == pytest.approx(BLOCK_VARIANCE, rel=0.2)


@DIRECTED
def test_a_row_is_predicted_as_if_it_had_not_been_there(directed):
    points = np.repeat(scattered(12, directed), 2, axis=0)
    cells = FieldCells.from_blocks(points, measured(points), in_turn(24))
    cell, level = cells.cell_of_row, cells.sums[:, 1] - cells.centres.law[cells.cell_of_row]
    scatter, trust = np.linspace(0.1, 0.3, len(level)), np.linspace(0.2, 1.0, len(level))
    setting = covariance.settings(16, directed=directed)[3]
    prior = covariance.prior_covariance(cells.centres, cells.centres, setting)
    found = observations.left_out(prior[np.newaxis], cell, level, scatter, trust)
    off, usual = found[1][0], found[2][0]
    own = trust / scatter
    mean = np.bincount(cell, own * level) / np.bincount(cell, own)
    middle = np.average(mean, weights=np.bincount(cell, own))
    whole = prior[np.ix_(cell, cell)]
    for row in range(len(level)):
        others = np.delete(np.arange(len(level)), row)
        total = whole[np.ix_(others, others)] + np.diag(1.0 / own[others])
        gains = np.linalg.solve(
            total, np.column_stack([level[others] - middle, whole[others, row]])
        )
        predicted = middle + whole[row, others] @ gains[:, 0]
        variance = whole[row, row] - whole[row, others] @ gains[:, 1]
        assert off[row] == pytest.approx(level[row] - predicted, abs=1e-6)
        assert usual[row] == pytest.approx(variance + scatter[row], rel=1e-6)


def moved_by_a_moment(directed, stroke, off_db, seed):
    """How far (dB) 100 levels are moved, ascending, if 0.3 s of 12 s are off."""
    points = np.repeat(scattered(24, directed, seed), 10, axis=0)
    power, number = measured(points, seed), np.arange(240)
    spoilt = power.copy()
    spoilt[10 * stroke : 10 * stroke + 6] *= 10.0 ** (off_db / 10.0)
    asked = scattered(100, directed, seed + 1)
    usual, _ = LevelField(FieldCells.from_blocks(points, power, number)).level_db(asked)
    found, _ = LevelField(FieldCells.from_blocks(points, spoilt, number)).level_db(asked)
    return np.sort(np.abs(found - usual))


@settings(max_examples=25)
@given(stroke=st.integers(0, 23), off_db=st.floats(-200.0, 60.0), seed=st.integers(0, 2**16))
def test_no_third_of_a_second_moves_what_twelve_seconds_have_said(stroke, off_db, seed):
    assert moved_by_a_moment(False, stroke, off_db, seed)[50] < 0.8


@pytest.mark.parametrize(("directed", "most_db"), [(False, 2.0), (True, 3.0)])
def test_few_moments_move_even_the_levels_of_strokes_like_theirs(directed, most_db):
    random = np.random.default_rng(7)
    moved = [
        moved_by_a_moment(directed, seed % 24, random.uniform(-60.0, 60.0), seed)[[50, 90]]
        for seed in range(120)
    ]
    middle, large = np.array(moved).T
    assert np.percentile(large, 95) < most_db
    assert np.percentile(middle, 99) < 1.0


def test_a_loud_moment_makes_no_texture_unsteady():
    """The trust that is left in a moment was once enough to move every level by 2 dB."""
    points = np.repeat(scattered(24), 10, axis=0)
    points[10:20] = points[:10]  # a second moment of the same stroke, which is spoilt
    power = measured(points)
    power[10:20] *= 1e6
    found = observed(FieldCells.from_blocks(points, power, np.arange(240)))
    assert found.moment < 0.1


@DIRECTED
def test_a_region_that_was_stroked_and_is_silent_is_known_to_be(directed):
    points = np.repeat(scattered(120, directed, seed=4), 10, axis=0)
    power = np.where(speed_of(points) < 0.3, 0.0, measured(points))
    field = LevelField(FieldCells.from_blocks(points, power, np.arange(len(points))))
    asked = scattered(400, directed, seed=5)
    speed = speed_of(asked)
    found = field.predict(covariance.coordinates(asked))
    silent = speed < 0.25
    mean, _ = field.level_db(asked)
    assert np.median(mean[silent]) < 10.0 * np.log10(field_cells.FELT_POWER)
    assert found.within(JND_DB / DB)[silent].mean() > (0.4 if directed else 0.6)
    assert np.abs(mean - DB * law(asked))[speed > 0.35].mean() < 2.0


def test_how_blocks_come_changes_no_sum():
    points, power, number = unsteady(500, 0.5, 3)
    whole = FieldCells.from_blocks(points, power, number)
    parts = FieldCells.from_blocks(points[:0], power[:0], number[:0])
    for start in range(0, 500, 70):
        part = slice(start, start + 70)
        parts = parts.joined(FieldCells.from_blocks(points[part], power[part], number[part]))
    np.testing.assert_array_equal(parts.keys, whole.keys)
    np.testing.assert_allclose(parts.sums, whole.sums, rtol=1e-9, atol=1e-12)


def test_if_there_are_too_many_moments_they_are_made_longer(monkeypatch):
    monkeypatch.setattr(field_cells, "LARGEST", 1000)
    points = scattered(2000)
    cells = FieldCells.from_blocks(points, measured(points), in_turn(2000))
    assert cells.moment_blocks > field_cells.MOMENT_BLOCKS
    assert cells.sums[:, 0].sum() == 2000
    fine = FieldCells.from_blocks(points[:10], measured(points[:10]), in_turn(10))
    assert fine.joined(cells).sums[:, 0].sum() == 2010
    assert fine.joined(cells).moment_blocks == cells.moment_blocks


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("sums", np.nan), ("sums", 0.0), ("moment_blocks", 0), ("keys", -5)),
        *(("keys", [0, 21, 0, 0]), ("keys", [0, 0, 1, 0])),  # as many cells as a file likes
    ],
)
def test_sums_that_no_blocks_have_are_refused(name, value):
    cells = FieldCells.from_blocks(scattered(3), np.ones(3), in_turn(3))
    spoilt = value if name == "moment_blocks" else np.full_like(getattr(cells, name), value)
    with pytest.raises(InputError, match="field's blocks"):
        replace(cells, **{name: spoilt}).check()


@DIRECTED
def test_the_corner_of_the_space_is_its_last_cell(directed):
    corner = np.array([[-1.0, -1e-12, 1.0]] if directed else [[1.0, 1.0]])
    cells = FieldCells.from_blocks(corner, np.ones(1), in_turn(1))
    cells.check()
    for axis in (0, 1):
        beyond = cells.keys.copy()
        beyond[:, axis] += 1
        with pytest.raises(InputError, match="outside its space"):
            replace(cells, keys=beyond).check()


def test_errors_have_students_t_distribution():
    variances = np.square([0.5 * JND_DB, JND_DB, 3.0 * JND_DB])
    for off in (0.0, 0.7, -2.0):
        found = right_probability(JND_DB, variances, off)
        law = stats.t(3, loc=off, scale=TAIL_SCALE * np.sqrt(variances))
        np.testing.assert_allclose(found, law.cdf(JND_DB) - law.cdf(-JND_DB), rtol=1e-12)
    one = Prediction(np.ones(1), np.zeros((1, 3)), variances[np.newaxis])
    np.testing.assert_allclose(one.deviation, law.std())
    assert right_probability(JND_DB, np.array([1e-12]))[0] == 1.0
    assert 0.0 <= right_probability(JND_DB, np.array([1e12]))[0] < 1e-5
    assert 0.0 <= right_probability(1.0, np.array([1e-12]), 2.0)[0] < 1e-12


@DIRECTED
def test_settings_spread_evenly_over_the_prior(directed):
    found = np.log(covariance.settings(256, directed=directed))
    priors = list(covariance.HYPERPRIOR.values())[: found.shape[1]]
    for column, prior in zip(found.T, priors, strict=True):
        assert np.median(column) == pytest.approx(math.log(prior.median), abs=0.06)
        assert np.std(column) == pytest.approx(prior.spread, rel=0.05)
    assert np.abs(np.corrcoef(found.T) - np.eye(found.shape[1])).max() < 0.25


@DIRECTED
def test_without_a_rough_departure_its_size_is_zero_and_the_others_are_spread_alike(directed):
    found = covariance.settings(256, directed=directed, rough=False)
    column = list(covariance.HYPERPRIOR).index("rough")
    assert not found[:, column].any()
    others = np.log(np.delete(found, column, axis=1))
    assert np.abs(np.corrcoef(others.T) - np.eye(others.shape[1])).max() < 0.15
    at = covariance.coordinates(scattered(6, directed))
    known = list(zip(*at, strict=True))
    wanted = [[covariance_written_out(p, q, found[3]) for q in known] for p in known]
    prior = covariance.prior_covariance(at, at, found[3])
    np.testing.assert_allclose(prior, wanted, rtol=1e-12)


@DIRECTED
def test_the_table_is_the_mean_and_the_model_renders_it(directed):
    points = scattered(40, directed)
    model = TextureModel(samples_of(points, measured(points)))
    asked = scattered(300, directed, seed=2)
    inputs = (asked * model.space.scale).T
    lsf, variance = model.at(*inputs)
    rendered = output_power(variance, lsf_to_reflection(lsf))
    mean, _ = model.level_db(*inputs)
    inside = speed_of(asked) > 0.15
    inside &= asked[:, -1] > 0.15  # below the slowest cell the table falls
    error_db = 10 * np.log10(rendered) - mean
    assert np.abs(error_db[inside]).max() < 0.8  # the table is interpolated linearly
    assert np.sqrt(np.mean(np.square(error_db[inside]))) < 0.2


def test_headings_meet_where_the_turn_is_full():
    points = scattered(40, directed=True)
    model = TextureModel(samples_of(points, measured(points)))
    _, variance = model.at([-100.0, -100.0], [1e-9, -1e-9], [1.0, 1.0])
    assert variance[0] == pytest.approx(variance[1], rel=1e-6)


@settings(max_examples=40)
@given(
    directed=st.booleans(),
    repeated=st.booleans(),
    collinear=st.booleans(),
    count=st.integers(1, 12),
    exponent=st.floats(-250.0, 250.0),
    spread=st.floats(0.0, 40.0),
    effective=st.floats(2.0, 5000.0),
    blocks=st.booleans(),
    seed=st.integers(0, 2**16),
)
def test_whatever_is_felt_the_level_is_finite_and_not_negative(
    directed, repeated, collinear, count, exponent, spread, effective, blocks, seed
):
    points = scattered(count, directed, seed)
    if collinear:
        points[:, 0] = points[:, -1]
    if repeated:
        points[:] = points[0]
    random = np.random.default_rng(seed)
    power = 10.0 ** (exponent + spread * random.uniform(-1.0, 1.0, count))
    power[random.random(count) < 0.2] = 0.0
    felt = (
        FieldCells.from_blocks(points, power, random.integers(0, 10**6, count)) if blocks else None
    )
    model = TextureModel(samples_of(points, power, effective), field=felt)
    asked = np.vstack([scattered(50, directed, seed + 1), np.zeros((1, points.shape[1]))])
    _, variance = model.at(*(asked * model.space.scale).T)
    assert (variance >= 0.0).all()
    assert np.isfinite(variance).all()
    if power.any() or blocks:
        mean, deviation = model.level_db(*(asked[:-1] * model.space.scale).T)
        assert np.isfinite(mean).all()
        assert (deviation >= 0.0).all()
    else:
        assert not variance.any()
        with pytest.raises(InputError, match="no sample of the model has any power"):
            model.level_db(*(asked[0] * model.space.scale))
