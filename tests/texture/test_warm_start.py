"""A known texture is chosen by a short look, and gives way to samples of the one at hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.stats import multivariate_normal

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.autoregression.forms import lsf_spectrum, reflection_to_lsf
from mmt.texture.autoregression.simulation import simulate_ar
from mmt.texture.library.blending import blend
from mmt.texture.library.conversion import field, grid, into_space
from mmt.texture.library.identification import Stretch, choose
from mmt.texture.library.warm_start import LOOK_SAMPLES, WarmStart
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC, InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings

LOW = np.array([-0.9, 0.5, -0.2])
HIGH = np.array([0.6, 0.4, 0.1, 0.2])


def model(reflection: FloatArray, power: float = 4.0, rate_hz: float = 1000.0) -> TextureModel:
    """A texture of one filter whose power rises as speed times force."""
    inputs = grid(ISOTROPIC)
    powers = power * inputs[:, 0] / 100.0 * inputs[:, 1]
    return TextureModel(sampled(inputs, reflection, powers), rate_hz=rate_hz)


def sampled(
    inputs: FloatArray,
    reflection: FloatArray,
    power: FloatArray,
    effective: float = 100.0,
    space: InputSpace = ISOTROPIC,
) -> TextureSamples:
    count = len(inputs)
    return TextureSamples(
        inputs=inputs,
        lsf=np.tile(reflection_to_lsf(reflection), (count, 1)),
        variance=power * np.prod(1.0 - reflection**2),
        power=power,
        space=space,
        effective=np.full(count, effective),
    )


def look(reflection: FloatArray, power: float, count: int = 500, seed: int = 1) -> Stretch:
    """Vibration of one filter at 100 mm/s and 1 N."""
    vibration = simulate_ar(reflection, 1.0, count, np.random.default_rng(seed))
    vibration *= np.sqrt(power * np.prod(1.0 - reflection**2))
    return Stretch(np.tile([100.0, 1.0], (count, 1)), vibration)


LIBRARY = {"low": model(LOW), "high": model(HIGH)}


@pytest.mark.parametrize(("name", "reflection"), [("low", LOW), ("high", HIGH)])
@pytest.mark.parametrize("gain", [1e-3, 1.0, 20.0])
def test_the_texture_itself_is_chosen_with_its_gain(
    name: str, reflection: FloatArray, gain: float
) -> None:
    found = choose(LIBRARY, [look(reflection, 4.0 * gain)])
    assert found is not None
    assert found.name == name
    assert found.gain_db == pytest.approx(10.0 * np.log10(gain), abs=1.5)
    assert found.lead > 20.0


def test_the_likelihood_is_that_of_the_whole_covariance() -> None:
    stretch = look(LOW, 4.0)
    found = choose({"low": LIBRARY["low"]}, [stretch])
    assert found is not None
    frequencies = np.linspace(0.0, 500.0, 4097)
    density = lsf_spectrum(reflection_to_lsf(LOW), np.prod(1.0 - LOW**2), frequencies, 1000.0)
    power = np.exp(field(LIBRARY["low"], ISOTROPIC, stretch.inputs[:1]).logarithm[0])
    lags = np.fft.irfft(density, 8192)[:500] * 500.0 * power * found.gain
    density_of = multivariate_normal.logpdf
    whole = density_of(stretch.vibration_m_s2, cov=toeplitz(lags))
    first = density_of(stretch.vibration_m_s2[:20], cov=toeplitz(lags[:20]))
    assert found.samples == 480
    assert found.log_likelihood * 480 == pytest.approx(whole - first, rel=1e-6)
    assert found.lead == np.inf
    assert found.as_dict()["lead"] is None


def test_a_knock_changes_neither_choice_nor_gain() -> None:
    clean = look(LOW, 4.0)
    knocked = Stretch(clean.inputs, clean.vibration_m_s2.copy())
    knocked.vibration_m_s2[200:230] += 60.0 * np.exp(-np.arange(30) / 8.0)
    before, after = choose(LIBRARY, [clean]), choose(LIBRARY, [knocked])
    assert before is not None
    assert after is not None
    assert after.name == before.name == "low"
    assert abs(after.gain_db - before.gain_db) < 0.7


@pytest.mark.parametrize("values", [np.zeros(500), np.full(500, 1e-200), np.full(500, 1e100)])
def test_looks_without_sense_are_survived(values: FloatArray) -> None:
    found = choose(LIBRARY, [Stretch(np.tile([100.0, 1.0], (500, 1)), values)])
    assert found is not None
    assert np.isfinite([found.gain, found.log_likelihood, found.lead]).all()
    assert choose(LIBRARY, [Stretch(np.ones((50, 2)), values[:50])]) is None


def test_without_samples_the_blend_is_the_known_texture_at_its_gain() -> None:
    blended = blend(LIBRARY["low"], 3.0, None, ISOTROPIC)
    inputs = grid(ISOTROPIC)
    known, own = (field(m, ISOTROPIC, inputs) for m in (LIBRARY["low"], blended))
    np.testing.assert_allclose(own.logarithm, known.logarithm + np.log(3.0), atol=1e-6)
    np.testing.assert_allclose(own.reflection, known.reflection, atol=1e-6)


def test_a_blend_is_the_sample_beside_it_and_less_so_further_away() -> None:
    """Grid points are where a blend is exact; one sample says the most at its own."""
    place = np.array([[105.0, 1.2]])
    there = sampled(place, HIGH, np.array([40.0]), effective=1e6)
    blended = blend(LIBRARY["low"], 1.0, there, ISOTROPIC)
    inputs = np.array([[105.0, 1.2], [105.0, 0.24], [9.0, 0.09]])
    known, own = (field(m, ISOTROPIC, inputs) for m in (LIBRARY["low"], blended))
    moved = own.logarithm - known.logarithm
    wanted = np.log(40.0) - known.logarithm[0]
    assert moved[0] == pytest.approx(wanted, abs=0.05)
    assert 0.2 * wanted < moved[2] < moved[1] < moved[0]
    wanted_shape = np.arctanh(np.clip(HIGH, -0.99, 0.99))
    np.testing.assert_allclose(np.arctanh(own.reflection[0]), wanted_shape, atol=0.06)


def test_the_mean_over_headings_of_an_isotropic_texture_is_the_texture() -> None:
    around = into_space(LIBRARY["high"], ANISOTROPIC)
    assert around.space == ANISOTROPIC
    inputs = grid(ANISOTROPIC)
    plane = np.stack([np.hypot(inputs[:, 0], inputs[:, 1]), inputs[:, 2]], axis=-1)
    known = field(LIBRARY["high"], ISOTROPIC, plane)
    own = field(around, ANISOTROPIC, inputs)
    np.testing.assert_allclose(own.logarithm, known.logarithm, atol=1e-6)
    back = into_space(around, ISOTROPIC)
    at = field(back, ISOTROPIC, plane)
    np.testing.assert_allclose(at.reflection, np.tile(HIGH, (len(plane), 1)), atol=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    power=st.lists(st.floats(0.0, 1e30), min_size=1, max_size=4),
    speed=st.floats(0.0, 1e4),
    force=st.floats(0.0, 50.0),
    effective=st.floats(2.0, 1e9),
    order=st.integers(1, 12),
    near=st.floats(0.0, 0.999),
    gain=st.floats(1e-4, 1e4),
)
def test_every_blend_is_a_stable_model(
    power: list[float],
    speed: float,
    force: float,
    effective: float,
    order: int,
    near: float,
    gain: float,
) -> None:
    inputs = np.tile([speed, force], (len(power), 1))  # all at one place
    reflection = near * np.cos(np.arange(order))
    samples = sampled(inputs, reflection, np.array(power), effective)
    blended = blend(LIBRARY["low"], gain, samples, ISOTROPIC)
    lsf, variance = blended.at(np.linspace(0.0, 400.0, 9), np.linspace(0.0, 4.0, 9))
    assert (np.diff(lsf, prepend=0.0, append=np.pi, axis=1) > 0.0).all()
    assert np.isfinite(variance).all()
    assert (variance >= 0.0).all()
    assert variance[0] == 0.0  # at rest


def test_a_fifth_of_a_second_of_stroking_chooses_and_rest_does_not() -> None:
    frames, _ = simulate_session(Scene(), "plastic", 4.0, 3)
    warm = WarmStart(LIBRARY, ModellingSettings())
    at = [n for n in range(0, 4000, 100) if warm.process(frames[n : n + 100]) is not None]
    assert LOOK_SAMPLES <= at[0] < 1600  # the hand comes down first
    assert 3 <= len(at) <= 5  # and again after twice as much
    assert warm.choice is not None
    assert warm.model(None) is not None
    resting = WarmStart(LIBRARY, ModellingSettings())
    still = frames.copy()
    still["force_n"] = 0.0
    assert all(resting.process(still[n : n + 100]) is None for n in range(0, 4000, 100))
    assert resting.model(None) is None


@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_the_choice_ends_after_a_long_look(inputs: str) -> None:
    frames, _ = simulate_session(Scene(), "plastic", 8.0, 3)
    directed = inputs == "anisotropic"
    space = ANISOTROPIC if directed else ISOTROPIC
    chosen = ModellingSettings(inputs="anisotropic" if directed else "isotropic", axis="dft321")
    warm = WarmStart(LIBRARY, chosen)
    for n in range(0, 8000, 1000):
        warm.process(frames[n : n + 1000])
    assert not warm.looking
    found = warm.model(None)
    assert found is not None
    assert found.space == space
    assert warm.process(frames) is None


def test_a_library_that_cannot_be_used_says_why() -> None:
    with pytest.raises(InputError, match="no model"):
        WarmStart({}, ModellingSettings())
    with pytest.raises(InputError, match="model fast is sampled at 2000 Hz"):
        WarmStart({"fast": model(LOW, rate_hz=2000.0)}, ModellingSettings())
