"""Texture models by radial basis function networks: valid everywhere, grown as built."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator

from mmt.texture.autoregression.forms import lsf_to_reflection, output_power, reflection_to_lsf
from mmt.texture.field.trend import without_trend
from mmt.texture.interpolation.radial_basis.interpolator import LEVEL_ROOM
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC, InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.bench.textures import Truth, exact_samples, scattered

SPACES = pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda s: s.name)


def make_samples(inputs, space: InputSpace, seed: int = 0, order: int = 6) -> TextureSamples:
    generator = np.random.default_rng(seed)
    reflection = generator.uniform(-0.9, 0.9, (len(inputs), order))
    variance = 10.0 ** generator.uniform(-3.0, 1.0, len(inputs))
    power = output_power(variance, reflection)
    return TextureSamples(np.array(inputs), reflection_to_lsf(reflection), variance, power, space)


def anywhere(count: int, space: InputSpace, seed: int = 1) -> np.ndarray:
    """Return inputs (count, d) within the space."""
    generator = np.random.default_rng(seed)
    speed, heading = generator.uniform(0, 300, count), generator.uniform(-np.pi, np.pi, count)
    force = generator.uniform(0, 3, count)
    if not space.directed:
        return np.column_stack([speed, force])
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading), force])


def chosen(samples: TextureSamples, rows: slice) -> TextureSamples:
    return TextureSamples(
        samples.inputs[rows],
        samples.lsf[rows],
        samples.variance[rows],
        samples.power[rows],
        samples.space,
    )


def assert_valid(model: TextureModel) -> None:
    lsf, variance = model.at(*anywhere(300, model.space).T)
    gaps = np.diff(lsf, axis=1, prepend=0.0, append=np.pi)
    own = np.diff(model.samples.lsf, axis=1, prepend=0.0, append=np.pi)
    assert (gaps > 0).all()
    assert gaps.min() >= min(0.03, own.min()) * (1 - 1e-9) - 1e-14
    assert (np.abs(lsf_to_reflection(lsf)) < 1).all()
    assert np.isfinite(variance).all()
    assert (variance >= 0).all()


@given(
    space=st.sampled_from([ISOTROPIC, ANISOTROPIC]),
    count=st.integers(1, 25),
    place=st.sampled_from(["anywhere", "one corner", "one place", "one line", "grid", "at rest"]),
    level=st.sampled_from([0.0, 1e-300, 1.0, 1e200]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_every_query_gives_a_stable_filter(space, count, place, level, seed):
    inputs = anywhere(count, space, seed)
    if place == "one corner":
        inputs *= 0.02
    elif place == "one place":
        inputs[:] = inputs[0]
    elif place == "one line":
        inputs[:] = inputs[0] * np.linspace(0.1, 1.0, count)[:, None]
    elif place == "grid":
        inputs = np.round(inputs / [100, 100, 1][-inputs.shape[1] :]) * 100.0
    elif place == "at rest":
        inputs[:, :-1] = 0.0
    samples = make_samples(inputs, space, seed)
    samples.power[:] *= level
    model = TextureModel(samples, interpolator="rbf")
    assert_valid(model)
    moving = np.ascontiguousarray(anywhere(50, space).T)
    assert np.isfinite(Synthesizer(model).render(*moving)).all()


@SPACES
@pytest.mark.parametrize("interpolate", ["power", "amplitude", "variance"])
def test_a_hand_at_rest_or_without_force_feels_nothing(space, interpolate):
    samples = make_samples(anywhere(40, space) * 0.9 + 5.0, space)
    model = TextureModel(samples, interpolator="rbf", interpolate=interpolate)
    at_rest, without_force = anywhere(50, space), anywhere(50, space)
    at_rest[:, :-1] = 0.0
    without_force[:, -1] = 0.0
    for inputs in (at_rest, without_force):
        assert (model.at(*inputs.T)[1] == 0.0).all()


@SPACES
@pytest.mark.parametrize("interpolate", ["power", "variance"])
def test_the_published_network_is_that_of_scipy_where_it_is_a_filter(space, interpolate):
    texture = make_samples(anywhere(60, space), space, order=2)
    model = TextureModel(texture, interpolator="network", interpolate=interpolate)
    level = getattr(texture, interpolate)
    whole = RBFInterpolator(texture.points, np.column_stack([level, texture.lsf]), degree=1)
    inputs = anywhere(400, space, 2)
    expected = whole(space.normalise(inputs))
    lsf, variance = model.at(*inputs.T)
    levels = (
        variance if interpolate == "variance" else output_power(variance, lsf_to_reflection(lsf))
    )
    inside = ((expected >= whole.d.min(axis=0)) & (expected <= whole.d.max(axis=0))).all(axis=1)
    inside &= (np.diff(expected[:, 1:], axis=1) > 0.03).ravel()
    speed, force = np.hypot(*inputs[:, :-1].T) if space.directed else inputs[:, 0], inputs[:, -1]
    inside &= (speed > texture.speed_mm_s.min()) & (force > texture.force_n.min())
    assert inside.sum() > 50
    np.testing.assert_allclose(lsf[inside], expected[inside, 1:], rtol=1e-9)
    np.testing.assert_allclose(levels[inside], expected[inside, 0], rtol=1e-6)


@SPACES
def test_the_published_network_grows_as_it_is_solved_at_once(space):
    samples = make_samples(anywhere(60, space), space)
    grown = TextureModel(chosen(samples, slice(0, 50)), interpolator="network")
    grown = TextureModel(samples, interpolator="network", previous=grown)
    inputs = anywhere(200, space, 3).T
    for one, other in zip(
        grown.at(*inputs), TextureModel(samples, interpolator="network").at(*inputs), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@SPACES
def test_the_level_is_bounded_far_from_all_samples(space):
    samples = make_samples(anywhere(12, space) * 0.05 + 10.0, space)
    model = TextureModel(samples, interpolator="rbf")
    inputs = anywhere(500, space)
    lsf, variance = model.at(*inputs.T)
    power, known = output_power(variance, lsf_to_reflection(lsf)), samples.power
    if model.space.directed:  # there the level over its power law is what is bounded
        power = without_trend(model.space.normalise(inputs), power, model.trend)
        known = without_trend(model.points, known, model.trend)
    assert power.max() <= LEVEL_ROOM * known.max() * (1 + 1e-9)
    assert (lsf >= samples.lsf.min(axis=0) - 1e-12).all()
    assert (lsf <= samples.lsf.max(axis=0) + 1e-12).all()


def test_a_grown_model_is_the_one_that_is_solved_at_once():
    samples = make_samples(anywhere(120, ISOTROPIC), ISOTROPIC)
    model = TextureModel(chosen(samples, slice(0, 70)), interpolator="rbf")
    first = model
    for stop in range(78, 119, 8):  # samples come, and the oldest go
        rows = slice(stop - 70, stop)
        model = TextureModel(chosen(samples, rows), interpolator="rbf", previous=model)
    assert model.interpolant.growth is first.interpolant.growth
    points = samples.points[48:118]
    queries = ISOTROPIC.normalise(anywhere(60, ISOTROPIC))
    filters = model.interpolant.filters
    anew = RadialBasisSystem(points, samples.lsf[48:118], filters.settings).network()
    np.testing.assert_allclose(filters.at(queries), anew.at(queries), atol=1e-9)
    silent = model.interpolant.growth.silent
    assert (silent.min(axis=1) == 0.0).all()
    assert len(silent) == 11
    level = model.interpolant.level
    anew = RadialBasisSystem(
        np.vstack([points, silent]),
        np.concatenate([samples.power[48:118], np.zeros(len(silent))])[:, None],
        level.settings,
    ).network()
    expected = anew.at(queries)
    scale = expected[0, 0] / level.at(queries)[0, 0]
    assert scale == pytest.approx(2.0 ** np.round(np.log2(scale)))  # the unit of the first
    np.testing.assert_allclose(level.at(queries) * scale, expected, atol=1e-7 * expected.max())


def test_two_models_may_grow_from_one():
    samples = make_samples(anywhere(42, ISOTROPIC), ISOTROPIC)
    common = TextureModel(chosen(samples, slice(0, 40)), interpolator="rbf")
    before = common.at(120.0, 1.0)
    one = TextureModel(chosen(samples, slice(0, 41)), interpolator="rbf", previous=common)
    other = TextureModel(chosen(samples, slice(1, 40)), interpolator="rbf", previous=common)
    assert one.interpolant.growth is common.interpolant.growth
    assert other.interpolant.growth is not common.interpolant.growth
    np.testing.assert_array_equal(common.at(120.0, 1.0)[0], before[0])
    assert_valid(other)


def test_a_grown_model_follows_levels_that_have_all_changed():
    samples = make_samples(anywhere(40, ISOTROPIC), ISOTROPIC)
    model = TextureModel(samples, interpolator="rbf")
    louder = TextureSamples(samples.inputs, samples.lsf, samples.variance, 3.0 * samples.power)
    grown = TextureModel(louder, interpolator="rbf", previous=model)
    assert grown.interpolant.growth is model.interpolant.growth
    at = anywhere(50, ISOTROPIC).T
    np.testing.assert_allclose(grown.at(*at)[1], 3.0 * model.at(*at)[1], rtol=1e-9)
    np.testing.assert_array_equal(grown.at(*at)[0], model.at(*at)[0])


def test_settings_are_chosen_anew_when_the_samples_have_doubled():
    samples = make_samples(anywhere(64, ISOTROPIC), ISOTROPIC)
    model = TextureModel(chosen(samples, slice(0, 30)), interpolator="rbf")
    growths = [model.interpolant.growth]
    for stop in range(32, 65, 4):
        model = TextureModel(chosen(samples, slice(0, stop)), interpolator="rbf", previous=model)
        if model.interpolant.growth is not growths[-1]:
            growths.append(model.interpolant.growth)
    assert len(growths) == 2


def test_a_sample_may_lie_at_rest_and_levels_may_rise_beyond_their_unit():
    samples = make_samples([[0.0, 1.0], [100.0, 0.0], [60.0, 0.6], [200.0, 2.0]], ISOTROPIC)
    model = TextureModel(samples, interpolator="rbf")
    assert_valid(model)
    louder = make_samples([*samples.inputs, [150.0, 1.5]], ISOTROPIC)
    louder.power[-1] *= 1e7
    grown = TextureModel(louder, interpolator="rbf", previous=model)
    assert grown.interpolant.growth is not model.interpolant.growth
    assert_valid(grown)


@pytest.mark.parametrize("name", ["wood", "ribbed"])
def test_smooth_textures_are_met_better_than_by_triangles(name):
    truth = Truth(name)
    samples = exact_samples(truth.surface, *scattered(40, 1), 10)
    errors = {}
    for interpolator in ("delaunay", "rbf"):
        model = TextureModel(samples, interpolator=interpolator)
        errors[interpolator] = truth.errors(*model.at(truth.speed_mm_s, truth.force_n))
    assert errors["rbf"][1] < 0.7 * errors["delaunay"][1]  # dB
    assert errors["rbf"][0] < 1.1 * errors["delaunay"][0]


def test_a_saved_model_is_read_as_what_it_was(tmp_path):
    samples = make_samples(anywhere(30, ANISOTROPIC), ANISOTROPIC)
    model = TextureModel(samples, interpolator="rbf")
    model.save(tmp_path / "model.npz")
    again = TextureModel.load(tmp_path / "model.npz")
    assert again.interpolator == "rbf"
    queries = anywhere(20, ANISOTROPIC).T
    np.testing.assert_array_equal(again.at(*queries)[0], model.at(*queries)[0])
