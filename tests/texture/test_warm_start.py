"""A short look chooses a known texture or none, and gives a first model of the surface."""

from collections.abc import Callable

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
from mmt.texture.field.blocks import Blocks
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.covariance import coordinates
from mmt.texture.field.posterior import LevelField
from mmt.texture.library.conversion import field, grid, into_space
from mmt.texture.library.identification import Stretch, choose
from mmt.texture.library.warm_start import LOOK_SAMPLES, WarmStart, at_level
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
    found = choose(LIBRARY, [look(reflection, 4.0 * gain)], ISOTROPIC)
    assert found is not None
    assert found.name == name
    assert found.gain_db == pytest.approx(10.0 * np.log10(gain), abs=1.5)
    assert found.lead > 5.0  # what a filter of its own pays for being fitted


def test_the_likelihood_is_that_of_the_whole_covariance() -> None:
    stretch = look(LOW, 4.0)
    found = choose({"low": LIBRARY["low"]}, [stretch], ISOTROPIC)
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
    assert found.as_dict()["texture"] == "low"


def test_a_knock_changes_neither_choice_nor_gain() -> None:
    clean = look(LOW, 4.0)
    knocked = Stretch(clean.inputs, clean.vibration_m_s2.copy())
    knocked.vibration_m_s2[200:230] += 60.0 * np.exp(-np.arange(30) / 8.0)
    before, after = (choose(LIBRARY, [one], ISOTROPIC) for one in (clean, knocked))
    assert before is not None
    assert after is not None
    assert after.name == before.name == "low"
    assert abs(after.gain_db - before.gain_db) < 0.7


@pytest.mark.parametrize("values", [np.zeros(500), np.full(500, 1e-200), np.full(500, 1e100)])
def test_looks_without_sense_are_survived(values: FloatArray) -> None:
    found = choose(LIBRARY, [Stretch(np.tile([100.0, 1.0], (500, 1)), values)], ISOTROPIC)
    assert found is not None
    assert np.isfinite([found.gain, found.log_likelihood, found.lead]).all()
    assert choose(LIBRARY, [Stretch(np.ones((50, 2)), values[:50])], ISOTROPIC) is None


def test_what_no_known_texture_is_like_gets_a_filter_of_its_own_and_pays_for_it() -> None:
    other = np.array([0.3, -0.8])
    strange = look(other, 4.0)
    found = choose(LIBRARY, [strange], ISOTROPIC)
    assert found is not None
    assert found.name is None
    assert "no known texture" in found.describe()
    itself = choose(LIBRARY | {"other": model(other)}, [strange], ISOTROPIC)
    assert itself is not None
    assert itself.name == "other"
    fitted_better = 0.5 * np.log(itself.samples) * (4 + 1)  # the least order is 4
    assert fitted_better - 15.0 < itself.lead < fitted_better


def felt(power_of: Callable[[FloatArray], FloatArray], inputs: FloatArray) -> Blocks:
    count = len(inputs)
    starts = 50 * np.arange(count)
    return Blocks(starts, starts // 50, ISOTROPIC.normalise(inputs), power_of(inputs))


def test_without_blocks_a_known_texture_has_its_gain() -> None:
    inputs = grid(ISOTROPIC)
    none = felt(lambda _: np.zeros(0), np.zeros((0, 2)))
    known, own = (
        field(m, ISOTROPIC, inputs)
        for m in (LIBRARY["low"], at_level(LIBRARY["low"], 3.0, none, ISOTROPIC))
    )
    off = own.logarithm - known.logarithm - np.log(3.0)
    assert np.abs(off).max() < 0.2
    assert np.sqrt(np.mean(off**2)) < 0.07  # a third of a decibel
    np.testing.assert_allclose(own.reflection, known.reflection, atol=1e-6)


def test_blocks_move_the_level_of_a_known_texture_and_leave_its_course() -> None:
    """Blocks that are all louder by one factor say that everything is."""
    known = LIBRARY["low"]
    strokes = np.array([[60.0, 0.5], [100.0, 1.0], [180.0, 0.8], [90.0, 2.0]] * 5)
    blocks = felt(lambda at: 5.0 * np.exp(field(known, ISOTROPIC, at).logarithm), strokes)
    moved = at_level(known, 1.0, blocks, ISOTROPIC)
    inputs = np.array([[105.0, 1.2], [60.0, 0.6], [210.0, 2.1]])  # points of the grid
    off = field(moved, ISOTROPIC, inputs).logarithm - field(known, ISOTROPIC, inputs).logarithm
    np.testing.assert_allclose(off, np.log(5.0), atol=0.25)
    alone = LevelField(FieldCells.of(blocks.points, blocks.power, blocks.number))
    usual = alone.predict(coordinates(ISOTROPIC.normalise(inputs[2:]))).mean
    wanted = field(known, ISOTROPIC, inputs[2:]).logarithm + np.log(5.0)
    assert abs(off[2] - np.log(5.0)) < abs(usual[0] - wanted[0])  # far from the strokes


def test_the_mean_over_headings_of_an_isotropic_texture_is_the_texture() -> None:
    around = into_space(LIBRARY["high"], ANISOTROPIC)
    assert around.space == ANISOTROPIC
    inputs = grid(ANISOTROPIC)
    plane = np.stack([np.hypot(inputs[:, 0], inputs[:, 1]), inputs[:, 2]], axis=-1)
    known = field(LIBRARY["high"], ISOTROPIC, plane)
    own = field(around, ANISOTROPIC, inputs)
    off = own.logarithm - known.logarithm
    assert np.abs(off).max() < 0.3
    assert np.sqrt(np.mean(off**2)) < 0.15
    back = into_space(around, ISOTROPIC)
    at = field(back, ISOTROPIC, plane)
    np.testing.assert_allclose(at.reflection, np.tile(HIGH, (len(plane), 1)), atol=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    power=st.lists(st.floats(0.0, 1e30), min_size=1, max_size=4),
    speed=st.floats(0.0, 1e4),
    force=st.floats(0.0, 50.0),
    gain=st.floats(1e-4, 1e4),
)
def test_every_level_gives_a_stable_model(
    power: list[float], speed: float, force: float, gain: float
) -> None:
    blocks = felt(lambda _: np.array(power), np.tile([speed, force], (len(power), 1)))
    moved = at_level(LIBRARY["low"], gain, blocks, ISOTROPIC)
    lsf, variance = moved.at(np.linspace(0.0, 400.0, 9), np.linspace(0.0, 4.0, 9))
    assert (np.diff(lsf, prepend=0.0, append=np.pi, axis=1) > 0.0).all()
    assert np.isfinite(variance).all()
    assert (variance >= 0.0).all()
    assert variance[0] == 0.0  # at rest


def test_a_fifth_of_a_second_of_stroking_chooses_and_rest_does_not() -> None:
    frames, _ = simulate_session(Scene(), "plastic", 4.0, 3)
    warm = WarmStart(LIBRARY, ModellingSettings())
    at = [n for n in range(0, 4000, 100) if warm.process(frames[n : n + 100]) is not None]
    assert LOOK_SAMPLES <= at[0] < 1600  # the hand comes down first
    assert len(at) > 5  # and again after a quarter more
    assert warm.choice is not None
    assert warm.choice.name is None  # nothing in the library is like it
    assert warm.model is not None
    assert warm.model.field is not None
    resting = WarmStart(LIBRARY, ModellingSettings())
    still = frames.copy()
    still["force_n"] = 0.0
    assert all(resting.process(still[n : n + 100]) is None for n in range(0, 4000, 100))
    assert resting.model is None


@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_the_choice_ends_after_a_long_look(inputs: str) -> None:
    frames, _ = simulate_session(Scene(), "plastic", 13.0, 3)
    directed = inputs == "anisotropic"
    space = ANISOTROPIC if directed else ISOTROPIC
    chosen = ModellingSettings(inputs="anisotropic" if directed else "isotropic", axis="dft321")
    warm = WarmStart(LIBRARY, chosen)
    for n in range(0, 13000, 1000):
        warm.process(frames[n : n + 1000])
    assert not warm.looking
    assert warm.choice is not None
    assert warm.choice.as_dict()["lead"] is None  # none of the library is asked in the end
    assert "nats" not in warm.choice.describe()
    assert warm.model is not None
    assert warm.model.space == space
    assert warm.process(frames) is None


def test_a_library_that_cannot_be_used_says_why() -> None:
    with pytest.raises(InputError, match="no model"):
        WarmStart({}, ModellingSettings())
    with pytest.raises(InputError, match="model fast is sampled at 2000 Hz"):
        WarmStart({"fast": model(LOW, rate_hz=2000.0)}, ModellingSettings())
