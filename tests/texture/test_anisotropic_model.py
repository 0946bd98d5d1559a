from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.interpolation.registry import INTERPOLATORS, WITHOUT_TREND
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC, InputSpace, normalise_into
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.synthesis.synthesizer import Synthesizer


def make_samples(inputs: np.ndarray, order: int = 8) -> TextureSamples:
    generator = np.random.default_rng(order)
    reflection = generator.uniform(-0.8, 0.8, (len(inputs), order))
    variance = generator.uniform(0.5, 2.0, len(inputs))
    return TextureSamples(
        np.asarray(inputs, dtype=float),
        reflection_to_lsf(reflection),
        variance,
        output_power(variance, reflection),
        ANISOTROPIC,
    )


def scattered(count: int, seed: int = 0) -> np.ndarray:
    """Return inputs (count, 3) of strokes in all directions."""
    generator = np.random.default_rng(seed)
    speed, heading = generator.uniform(20, 290, count), generator.uniform(-np.pi, np.pi, count)
    force = generator.uniform(0.2, 2.9, count)
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading), force])


def everywhere(count: int) -> np.ndarray:
    """Return inputs (count, 3) within and beyond the space."""
    return np.random.default_rng(2).uniform([-400, -400, -0.5], [400, 400, 3.5], (count, 3))


@pytest.mark.parametrize("interpolator", ["delaunay", "nearest"])
def test_a_sample_is_reproduced_at_its_own_velocity_and_force(interpolator: str) -> None:
    samples = make_samples(scattered(40))
    model = TextureModel(samples, interpolator=interpolator)
    lsf, variance = model.at(*samples.inputs.T)
    np.testing.assert_allclose(lsf, samples.lsf, atol=1e-9)
    np.testing.assert_allclose(variance, samples.variance, rtol=1e-7)


def test_the_interpolation_is_scipys() -> None:
    """Of the LSF, and of the level over the power law of speed and force."""
    model = TextureModel(make_samples(scattered(60)), interpolate="variance")
    inputs = everywhere(2000)
    points = ANISOTROPIC.normalise(inputs)
    scipys = LinearNDInterpolator(Delaunay(model.vertices[:, :3]), model.vertices[:, 3:])(points)
    lsf, variance = model.at(*inputs.T)
    speed, force = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    felt = (speed > 0.01) & (force > 0.01)
    law = speed**model.trend.speed_exponent * force**model.trend.force_exponent
    np.testing.assert_allclose(variance[felt], (scipys[:, 0] * law)[felt], rtol=1e-6)
    np.testing.assert_allclose(lsf, scipys[:, 1:], atol=1e-8)


@pytest.mark.parametrize("interpolator", list(INTERPOLATORS))
@pytest.mark.parametrize(
    "inputs",
    [
        [[100.0, 0.0, 1.0]],
        [[100.0, 0.0, 1.0]] * 5,
        [[100.0, 0.0, 1.0], [100.0 + 1e-10, 0.0, 1.0]],
        [[50.0 * k, 0.0, 0.4 * k] for k in range(1, 6)],
        [[20.0 * k, 30.0, 1.0] for k in range(-6, 7)],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1e-9, 0.0, 2.0]],
        [[1e9, -1e9, 50.0], [-300.0, 0.0, 3.0], [0.0, 300.0, 0.0]],
        [[150 * np.cos(a), 150 * np.sin(a), 1.5] for a in np.arange(12) * np.pi / 6],
    ],
    ids="one repeated coincident one-heading coplanar at-rest outside circle".split(),  # noqa: SIM905
)
def test_degenerate_sample_sets_give_a_finite_stable_model(
    inputs: list[list[float]], interpolator: str
) -> None:
    model = TextureModel(make_samples(np.array(inputs)), interpolator=interpolator)
    lsf, variance = model.at(*everywhere(1000).T)
    assert np.isfinite(variance).all()
    assert (variance >= 0).all()
    assert (np.diff(lsf, axis=1, prepend=0.0, append=np.pi) > 0).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 30), st.integers(0, 2**32), st.sampled_from(list(INTERPOLATORS)))
def test_any_samples_give_ordered_frequencies(count: int, seed: int, interpolator: str) -> None:
    samples = make_samples(np.round(scattered(count, seed), 1))
    model = TextureModel(samples, interpolator=interpolator)
    lsf, variance = model.at(*everywhere(200).T)
    assert (np.diff(lsf, axis=1, prepend=0.0, append=np.pi) > 0).all()
    assert (variance >= 0).all()


@pytest.mark.parametrize("interpolator", list(INTERPOLATORS))
@pytest.mark.parametrize("slowest_mm_s", [3.0, 10.0, 100.0])
def test_a_hand_at_rest_or_without_force_feels_nothing(
    slowest_mm_s: float, interpolator: str
) -> None:
    inputs = scattered(80)
    inputs[:10, :2] *= slowest_mm_s / np.hypot(inputs[:10, :1], inputs[:10, 1:2])
    model = TextureModel(make_samples(inputs), interpolator=interpolator)
    assert model.at(0.0, 0.0, np.linspace(0.0, 3.0, 301))[1].max() == 0.0
    turn = np.linspace(0.0, 2 * np.pi, 50)
    for speed in (50.0, 150.0, 300.0):
        assert model.at(speed * np.cos(turn), speed * np.sin(turn), 0.0)[1].max() == 0.0


@pytest.mark.parametrize("interpolator", sorted(INTERPOLATORS.keys() - WITHOUT_TREND))
def test_every_stroke_is_felt_however_slow_and_light(interpolator: str) -> None:
    model = TextureModel(make_samples(scattered(30)), interpolator=interpolator)
    inputs = scattered(500, 3) * (0.1, 0.1, 0.1)
    assert model.at(*inputs.T)[1].min() > 0.0


@pytest.mark.parametrize("exponents", [(1.0, 0.7), (0.4, 1.3), (1.8, 0.3)])
def test_a_power_law_is_found_and_rendered_beyond_the_samples(
    exponents: tuple[float, float],
) -> None:
    inputs = scattered(200)
    samples = make_samples(inputs)
    speed, force = np.hypot(inputs[:, 0], inputs[:, 1]) / 300.0, inputs[:, 2] / 3.0
    power = 5.0 * speed ** exponents[0] * force ** exponents[1]
    lsf = np.tile(samples.lsf[0], (200, 1))
    gain = samples.variance[0] / samples.power[0]
    for interpolate, share in (("power", 1.0), ("amplitude", 0.5)):
        model = TextureModel(
            TextureSamples(inputs, lsf, gain * power, power, ANISOTROPIC),
            interpolate=interpolate,
        )
        expected = pytest.approx((share * exponents[0], share * exponents[1]), abs=0.15)
        assert tuple(model.trend) == expected
        _, variance = model.at(12.0, 9.0, 0.15)
        law = 5.0 * (15 / 300) ** exponents[0] * 0.05 ** exponents[1]
        assert variance[0] == pytest.approx(gain * law, rel=0.3)


def test_samples_without_any_level_are_silence() -> None:
    samples = make_samples(scattered(5))
    silent = replace(samples, power=np.zeros(5), variance=np.zeros(5))
    assert (TextureModel(silent).at(*everywhere(100).T)[1] == 0.0).all()


def test_all_that_a_hand_can_reach_lies_inside() -> None:
    model = TextureModel(make_samples(scattered(3)), interpolate="power")
    turn = np.linspace(0.0, 2 * np.pi, 1000)
    rim = ANISOTROPIC.from_motion(
        300 * np.cos(turn), 300 * np.sin(turn), 3.0 * np.abs(np.sin(turn))
    )
    points = ANISOTROPIC.normalise(rim)
    corners, weights = model.triangulation.weights(points)
    found = np.einsum("kc,kcv->kv", weights, model.triangulation.points[corners])
    np.testing.assert_allclose(found, points, atol=1e-9)


def test_a_velocity_beyond_the_largest_keeps_its_heading() -> None:
    model = TextureModel(make_samples(scattered(50)))
    for slow, fast in zip(model.at(180.0, 240.0, 1.0), model.at(1800.0, 2400.0, 1.0), strict=True):
        np.testing.assert_allclose(slow, fast, rtol=1e-9)
    beyond = ANISOTROPIC.normalise(np.array([[np.inf, np.inf, np.inf], [np.nan, 5.0, np.nan]]))
    np.testing.assert_allclose(beyond, [[0.5**0.5, 0.5**0.5, 1.0], [0.0, 5 / 300, 0.0]])


@settings(max_examples=100, deadline=None)
@given(
    st.tuples(*[st.floats(width=64)] * 3),
    st.sampled_from([ISOTROPIC, ANISOTROPIC]),
)
def test_one_moment_is_normalised_as_many_are(
    moment: tuple[float, float, float], space: InputSpace
) -> None:
    inputs = np.array([moment[: space.dimensions]])
    point = np.empty(space.dimensions)
    normalise_into(*moment, 1 / space.maximum_speed_mm_s, 1 / space.maximum_force_n, point)
    np.testing.assert_allclose(point, space.normalise(inputs)[0], atol=1e-12)


def test_a_motion_gives_the_inputs_of_either_space() -> None:
    np.testing.assert_allclose(ISOTROPIC.from_motion(30.0, -40.0, 1.5), [[50.0, 1.5]])
    np.testing.assert_allclose(ANISOTROPIC.from_motion(30.0, -40.0, 1.5), [[30.0, -40.0, 1.5]])
    samples = make_samples(np.array([[30.0, -40.0, 1.5]]))
    np.testing.assert_allclose(samples.speed_mm_s, [50.0])


def test_rendering_follows_the_heading() -> None:
    along, across = make_samples(np.array([[150.0, 0.0, 1.5], [0.0, 150.0, 1.5]])).power
    model = TextureModel(make_samples(np.array([[150.0, 0.0, 1.5], [0.0, 150.0, 1.5]])))
    count = 40_000
    for heading, power in ((0.0, along), (np.pi / 2, across)):
        velocity = 150 * np.cos(heading), 150 * np.sin(heading)
        rendered = Synthesizer(model, seed=1, limit_m_s2=1e6).render(
            np.full(count, velocity[0]), np.full(count, velocity[1]), np.full(count, 1.5)
        )
        assert np.mean(rendered**2) == pytest.approx(power, rel=0.1)


def test_the_wrong_number_of_inputs_is_explained() -> None:
    model = TextureModel(make_samples(scattered(3)))
    with pytest.raises(InputError, match="velocity_x_mm_s"):
        model.at(100.0)
    with pytest.raises(InputError, match="velocity_x_mm_s"):
        Synthesizer(model).render(np.ones(3))
    columns = np.ones((3, 3))
    assert len(Synthesizer(model).render(*columns.T)) == 3
    with pytest.raises(InputError, match=r"\(3,\) float64, \(2,\) float64, \(3,\) float64: each"):
        Synthesizer(model).render(columns[0], columns[1, :2], columns[2])
    with pytest.raises(InputError, match="int64: each must be"):
        Synthesizer(model).render(*np.ones((3, 3), dtype=np.int64))
    with pytest.raises(InputError, match='"isotropic", "anisotropic"'):
        InputSpace("directed")
    with pytest.raises(InputError, match="maximum_force_n"):
        InputSpace("isotropic", 300.0, 0.0)
    with pytest.raises(InputError, match="delaunay"):
        TextureModel(make_samples(scattered(3)), interpolator="spline")


def test_a_model_of_version_1_is_read(tmp_path) -> None:
    samples = TextureSamples.isotropic(
        np.array([100.0, 200.0]), np.array([1.0, 2.0]), np.array([[1.0, 2.0]] * 2), *np.ones((2, 2))
    )
    with (tmp_path / "model.npz").open("wb") as file:
        np.savez(
            file,
            format_version=1,
            speed_mm_s=samples.speed_mm_s,
            force_n=samples.force_n,
            lsf_rad=samples.lsf,
            variance=samples.variance,
            power=samples.power,
            maximum_speed_mm_s=300.0,
            maximum_force_n=3.0,
            rate_hz=1000.0,
            interpolate="variance",
        )
    model = TextureModel.load(tmp_path / "model.npz")
    assert (model.space, model.interpolator) == (ISOTROPIC, "delaunay")
    expected = TextureModel(samples, interpolate="variance")
    np.testing.assert_array_equal(model.vertices, expected.vertices)


def test_a_saved_anisotropic_model_is_the_same(tmp_path) -> None:
    model = TextureModel(make_samples(scattered(12)), interpolator="nearest")
    model.save(tmp_path / "model.npz")
    again = TextureModel.load(tmp_path / "model.npz")
    assert again.space == ANISOTROPIC
    assert again.interpolator == "nearest"
    np.testing.assert_array_equal(again.vertices, model.vertices)
    with np.load(tmp_path / "model.npz") as content:
        np.testing.assert_array_equal(content["velocity_x_mm_s"], model.samples.inputs[:, 0])
