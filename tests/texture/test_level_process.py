"""The level as a Gaussian process: against formulas written out, known answers and extremes."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.texture.autoregression.effective_sample_size import (
    LEAST,
    effective_samples,
    log_power_scatter,
)
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power, reflection_to_lsf
from mmt.texture.field.level_covariance import (
    PRIOR,
    Features,
    departures,
    features,
    half_turn,
    matern,
    turn,
)
from mmt.texture.field.level_hyperparameters import LevelSamples, log_posterior, pooled
from mmt.texture.field.level_process import DB, LevelProcess
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer


def scattered(count, directed=False, seed=0):
    random = np.random.default_rng(seed)
    speed, force = random.uniform(0.07, 0.95, count), random.uniform(0.07, 0.95, count)
    if not directed:
        return np.column_stack([speed, force])
    heading = random.uniform(-np.pi, np.pi, count)
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading), force])


def law(points):
    """A power law with exponents off the prior's middle, in nepers."""
    speed = np.hypot(*points[:, :-1].T) if points.shape[1] == 3 else points[:, 0]
    return 1.4 * np.log(speed) + 0.5 * np.log(points[:, -1]) + 0.7


def measured(points, effective, seed=0):
    random = np.random.default_rng(seed)
    return np.exp(law(points)) * random.chisquare(effective) / effective


def samples_of(points, power, effective):
    space = ANISOTROPIC if points.shape[1] == 3 else ISOTROPIC
    count = len(points)
    lsf = np.tile(reflection_to_lsf(np.array([-0.5, 0.3])), (count, 1))
    return TextureSamples(points * space.scale, lsf, 0.5 * power, power, space, effective)


def covariance_written_out(a, b, h):
    """The prior between two points, one number at a time."""

    def strokes(point):
        if len(point) == 2:
            return math.log(point[0]), math.log(point[1]), 0.0
        speed = math.hypot(point[0], point[1])
        return math.log(speed), math.log(point[2]), math.atan2(point[1], point[0])

    def matern(distance, length):
        r = math.sqrt(5) * abs(distance) / length
        return (1 + r + r**2 / 3) * math.exp(-r)

    (va, fa, ta), (vb, fb, tb) = strokes(a), strokes(b)
    total = 25.0 + 0.4**2 * va * vb + 0.25**2 * fa * fb
    total += h[0] ** 2 * matern(va - vb, h[1]) * matern(fa - fb, h[2])
    if len(a) == 3:
        chord = math.dist((math.cos(ta), math.sin(ta)), (math.cos(tb), math.sin(tb)))
        around = h[4] ** 2 * matern(math.sin(ta - tb), h[5])
        around += h[6] ** 2 * matern(chord, h[7])
        total += around * matern(va - vb, h[8]) * matern(fa - fb, h[9])
    return total


def test_white_noise_is_worth_all_its_samples_and_a_first_order_filter_what_bartlett_says():
    filters = np.array([[1e-12], [-0.6], [0.9]])
    found = effective_samples(reflection_to_lsf(filters), np.array([200, 400, 1000]))
    share = (1 - filters[:, 0] ** 2) / (1 + filters[:, 0] ** 2)
    np.testing.assert_allclose(found, share * [200, 400, 1000], rtol=1e-6)


def test_a_line_that_nothing_resolves_is_worth_the_least_and_no_samples_give_none():
    assert effective_samples(np.array([[1.0, 1.0 + 1e-9]]), np.array([150])) == LEAST
    assert effective_samples(np.empty((0, 4)), np.empty(0)).shape == (0,)


def test_the_power_of_segments_scatters_as_their_effective_length_says():
    random, reflection = np.random.default_rng(3), np.array([-0.8])
    noise = random.standard_normal((4000, 600))
    x = np.zeros(4000)
    kept = []
    for tick in range(600):
        x = 0.8 * x + noise[:, tick]
        if tick >= 300:
            kept.append(x)
    logarithm = np.log(np.mean(np.square(kept), axis=0) * (1 - 0.64))
    effective = effective_samples(reflection_to_lsf(reflection[None]), np.array([300]))
    mean, variance = log_power_scatter(effective)
    assert np.mean(logarithm) == pytest.approx(mean[0], abs=4 * np.sqrt(variance[0] / 4000))
    assert np.var(logarithm) == pytest.approx(variance[0], rel=0.1)


def test_two_independent_samples_scatter_as_an_exponential_number():
    mean, variance = log_power_scatter(np.array([2.0]))
    assert mean[0] == pytest.approx(-np.euler_gamma)
    assert variance[0] == pytest.approx(np.pi**2 / 6)


@pytest.mark.parametrize("directed", [False, True])
def test_mean_and_deviation_are_those_of_the_formulas_written_out(directed):
    points, effective = scattered(12, directed), np.linspace(20.0, 200.0, 12)
    power, asked = measured(points, effective), scattered(5, directed, seed=9)
    process = LevelProcess(points, power, effective)
    h = np.exp(process.hyperparameters)

    def matrix(a, b):
        return np.array([[covariance_written_out(p, q, h) for q in b] for p in a])

    bias, variance = log_power_scatter(effective)
    speed = np.hypot(*points[:, :-1].T) if directed else points[:, 0]
    usual = np.log(speed) + 0.7 * np.log(points[:, -1])
    y = np.log(power) - bias - usual
    inverse = np.linalg.inv(matrix(points, points) + np.diag(variance * h[3] ** 2))
    between = matrix(asked, points)
    asked_speed = np.hypot(*asked[:, :-1].T) if directed else asked[:, 0]
    mean = between @ inverse @ (y - y.mean()) + y.mean()
    mean += np.log(asked_speed) + 0.7 * np.log(asked[:, -1])
    spread = np.diag(matrix(asked, asked) - between @ inverse @ between.T)
    found = process.level_db(asked)
    np.testing.assert_allclose(found[0], DB * mean, atol=1e-5)
    np.testing.assert_allclose(found[1], DB * np.sqrt(spread), rtol=1e-4)


@pytest.mark.parametrize("directed", [False, True])
def test_slopes_of_the_posterior_are_those_of_its_differences(directed):
    points, effective = scattered(15, directed), np.full(15, 60.0)
    at = features(points)
    between = departures(at, at, directed=directed)
    bias, variance = log_power_scatter(effective)
    y = np.log(measured(points, effective)) - bias - at.law
    middle = PRIOR[: 10 if directed else 4, 0]
    logarithms = middle + np.random.default_rng(1).normal(0.0, 0.3, len(middle))
    _, slopes = log_posterior(between, y, variance, logarithms)
    for number in range(len(middle)):
        step = np.zeros(len(middle))
        step[number] = 1e-5
        ahead = log_posterior(between, y, variance, logarithms + step)[0]
        behind = log_posterior(between, y, variance, logarithms - step)[0]
        assert slopes[number] == pytest.approx((ahead - behind) / 2e-5, rel=1e-4, abs=1e-5)


@settings(deadline=None, max_examples=30)
@given(
    headings=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=12),
    width=st.floats(0.05, 10.0),
)
def test_whatever_the_headings_they_have_a_covariance(headings, width):
    angle = np.subtract.outer(headings, headings)
    for chord in (half_turn(angle), turn(angle)):
        values = matern(chord, width)[0]
        assert np.linalg.eigvalsh(values).min() > -1e-9
        np.testing.assert_allclose(np.diag(values), 1.0)
    np.testing.assert_allclose(half_turn(angle + np.pi), half_turn(angle), atol=1e-12)
    np.testing.assert_allclose(turn(angle + 2.0 * np.pi), turn(angle), atol=1e-12)


@pytest.mark.parametrize("directed", [False, True])
def test_a_power_law_is_found_within_the_plane_and_below_the_slowest_sample(directed):
    points, effective = scattered(60, directed), np.full(60, 150.0)
    process = LevelProcess(points, measured(points, effective), effective)
    asked = scattered(200, directed, seed=5)
    mean, spread = process.level_db(asked)
    error = mean - DB * law(asked)
    assert np.sqrt(np.mean(error**2)) < 0.4
    assert np.mean(np.abs(error) < 2 * spread) > 0.85
    slow = asked * ([0.2, 0.2, 1.0] if directed else [0.2, 1.0])
    np.testing.assert_allclose(process.level_db(slow)[0], DB * law(slow), atol=1.5)
    assert (process.level_db(slow)[1] > spread.min()).all()


def test_more_samples_make_it_surer_and_one_sample_is_enough():
    points = scattered(40)
    spreads = []
    for count in (1, 5, 40):
        effective = np.full(count, 100.0)
        process = LevelProcess(
            points[:count],
            measured(points[:count], effective),
            effective,
            hyperparameters=PRIOR[:4, 0],
        )
        spreads.append(process.level_db(np.array([[0.4, 0.4]]))[1][0])
    assert spreads[0] > spreads[1] > spreads[2] > 0.0


@pytest.mark.parametrize("directed", [False, True])
def test_the_table_is_the_mean_and_the_model_renders_it(directed):
    points, effective = scattered(40, directed), np.full(40, 80.0)
    samples = samples_of(points, measured(points, effective), effective)
    model = TextureModel(samples, level="gaussian_process")
    asked = scattered(300, directed, seed=2)
    lsf, variance = model.at(*(asked * model.space.scale).T)
    rendered = output_power(variance, lsf_to_reflection(lsf))
    mean, _ = model.level_db(*(asked * model.space.scale).T)
    np.testing.assert_allclose(10 * np.log10(rendered), mean, atol=0.1)


@pytest.mark.parametrize("directed", [False, True])
def test_nothing_is_felt_at_rest_or_without_force_and_little_beside_it(directed):
    points, effective = scattered(20, directed), np.full(20, 80.0)
    model = TextureModel(
        samples_of(points, measured(points, effective), effective), level="gaussian_process"
    )
    rest, light = ([0.0, 0.0, 1.0], [100.0, 50.0, 0.0]) if directed else ([0.0, 1.0], [100.0, 0.0])
    assert model.at(*rest)[1][0] == 0.0
    assert model.at(*light)[1][0] == 0.0
    way = np.array([[v, 0.0, 1.0] if directed else [v, 1.0] for v in np.geomspace(0.1, 20.0, 60)])
    assert (np.diff(model.at(*way.T)[1]) > 0.0).all()


def test_the_synthesizer_renders_the_process_level():
    points, effective = scattered(30), np.full(30, 80.0)
    model = TextureModel(
        samples_of(points, measured(points, effective), effective), level="gaussian_process"
    )
    count = 40_000
    rendered = Synthesizer(model, seed=2).render(np.full(count, 120.0), np.full(count, 1.4))
    mean, _ = model.level_db(120.0, 1.4)
    assert 10 * np.log10(np.mean(rendered[500:] ** 2)) == pytest.approx(mean[0], abs=0.3)


def test_headings_meet_where_the_turn_is_full():
    points, effective = scattered(40, directed=True), np.full(40, 80.0)
    model = TextureModel(
        samples_of(points, measured(points, effective), effective), level="gaussian_process"
    )
    _, variance = model.at([-100.0, -100.0], [1e-9, -1e-9], [1.0, 1.0])
    assert variance[0] == pytest.approx(variance[1], rel=1e-6)


@settings(deadline=None, max_examples=40)
@given(
    directed=st.booleans(),
    repeated=st.booleans(),
    collinear=st.booleans(),
    count=st.integers(1, 12),
    exponent=st.floats(-250.0, 250.0),
    spread=st.floats(0.0, 40.0),
    effective=st.floats(2.0, 5000.0),
    seed=st.integers(0, 2**16),
)
def test_whatever_the_samples_the_level_is_finite_and_not_negative(
    directed, repeated, collinear, count, exponent, spread, effective, seed
):
    points = scattered(count, directed, seed)
    if collinear:
        points[:, 0] = points[:, -1]
    if repeated:
        points[:] = points[0]
    random = np.random.default_rng(seed)
    power = 10.0 ** (exponent + spread * random.uniform(-1.0, 1.0, count))
    power[random.random(count) < 0.2] = 0.0
    model = TextureModel(
        samples_of(points, power, np.full(count, effective)), level="gaussian_process"
    )
    asked = np.vstack([scattered(50, directed, seed + 1), np.zeros((1, points.shape[1]))])
    _, variance = model.at(*(asked * model.space.scale).T)
    assert (variance >= 0.0).all()
    assert np.isfinite(variance).all()
    if power.any():
        mean, deviation = model.level_db(*(asked[:-1] * model.space.scale).T)
        assert np.isfinite(mean).all()
        assert (deviation >= 0.0).all()
    else:
        assert not variance.any()
        with pytest.raises(InputError, match="no sample of the model has any power"):
            model.level_db(*(asked[0] * model.space.scale))


def test_repeated_visits_pool_to_the_same_posterior():
    points = np.repeat(scattered(6), 5, axis=0)
    at = features(points)
    random = np.random.default_rng(4)
    samples = LevelSamples(at, random.normal(size=30), random.uniform(0.01, 0.1, 30))
    fewer = pooled(samples, 6)
    assert len(fewer.logarithm) == 6
    precision = 1.0 / samples.variance.reshape(6, 5)
    mean = (precision * samples.logarithm.reshape(6, 5)).sum(axis=1) / precision.sum(axis=1)
    np.testing.assert_allclose(np.sort(fewer.logarithm), np.sort(mean), rtol=1e-12)
    np.testing.assert_allclose(np.sort(fewer.variance), np.sort(1.0 / precision.sum(axis=1)))


def test_too_many_samples_are_pooled_and_the_law_is_kept():
    points = scattered(900)
    at = features(points)
    fewer = pooled(LevelSamples(at, at.law, np.full(900, 0.02)), 400)
    assert len(fewer.logarithm) <= 400
    np.testing.assert_allclose(fewer.logarithm, Features(*fewer.at).law, atol=1e-12)
    assert np.sum(1.0 / fewer.variance) == pytest.approx(900 / 0.02)


def test_hyperparameters_stay_until_the_samples_have_grown_by_a_quarter():
    points, effective = scattered(60), np.full(60, 80.0)
    power = measured(points, effective)
    first = LevelProcess(points[:40], power[:40], effective[:40])
    few = LevelProcess(points[:45], power[:45], effective[:45], previous=first)
    many = LevelProcess(points, power, effective, previous=few)
    assert (few.hyperparameters == first.hyperparameters).all()
    assert (many.hyperparameters != first.hyperparameters).any()


def test_a_saved_model_has_the_same_level_when_it_is_loaded(tmp_path: Path):
    points, effective = scattered(30), np.full(30, 80.0)
    model = TextureModel(
        samples_of(points, measured(points, effective), effective), level="gaussian_process"
    )
    model.save(tmp_path / "model.npz")
    loaded = TextureModel.load(tmp_path / "model.npz")
    assert loaded.level == "gaussian_process"
    np.testing.assert_array_equal(loaded.kernel_parameters, model.kernel_parameters)
    np.testing.assert_array_equal(loaded.samples.effective, effective)


def test_a_model_that_has_grown_keeps_its_hyperparameters_in_its_file():
    points, effective = scattered(45), np.full(45, 80.0)
    power = measured(points, effective)
    model = None
    for count in (40, 45):
        samples = samples_of(points[:count], power[:count], effective[:count])
        model = TextureModel(samples, level="gaussian_process", previous=model)
    loaded = TextureModel.from_bytes(model.to_bytes())
    np.testing.assert_array_equal(loaded.kernel_parameters, model.kernel_parameters)


def test_hyperparameters_of_another_space_are_refused_in_words(tmp_path: Path):
    points, effective = scattered(5), np.full(5, 80.0)
    with pytest.raises(InputError, match="hyperparameters have shape"):
        LevelProcess(points, effective, effective, hyperparameters=np.zeros(10))


def test_a_level_of_its_own_and_an_interpolated_amplitude_exclude_each_other():
    points, effective = scattered(5), np.full(5, 80.0)
    samples = samples_of(points, np.ones(5), effective)
    with pytest.raises(InputError, match="needs interpolate"):
        TextureModel(samples, level="gaussian_process", interpolate="amplitude")
    with pytest.raises(InputError, match="level is 'guessed'"):
        TextureModel(samples, level="guessed")  # type: ignore[arg-type]
