import autoregressive_oracles as oracles
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import lfilter

from mmt.texture.autoregression.forms import (
    lsf_to_reflection,
    output_power,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.autoregression.lsf import lattice_step, lsf_to_lattice_into
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.synthesis.synthesizer import Synthesizer

ONE = 1 - 2.0**-53

reflections = st.integers(1, 64).flatmap(
    lambda order: hnp.arrays(np.float64, order, elements=st.floats(-ONE, ONE))
)


def lattice_of(lsf):
    order = len(lsf)
    reflection, complement = np.empty(order), np.empty(order)
    lsf_to_lattice_into(lsf, reflection, complement, np.empty(5 * (order // 2 + 2)))
    return reflection, complement


def complement_of(reflection):
    return np.sqrt((1 - reflection) * (1 + reflection))


def one_filter(lsf, power):
    """Return a model that has the same filter and power everywhere but on the zero edges."""
    reflection = lsf_to_reflection(lsf)
    variance = power / output_power(1.0, reflection)
    at = np.array([[150.0, 1.5]])
    return TextureModel(TextureSamples(at, lsf[None], np.atleast_1d(variance), np.array([power])))


@given(reflection=reflections, seed=st.integers(0, 999))
@settings(max_examples=80)
def test_a_step_is_a_rotation_of_memory_and_excitation(reflection, seed):
    order = len(reflection)
    generator = np.random.default_rng(seed)
    past, excitation = generator.standard_normal(order), generator.standard_normal()
    energy = np.sum(past**2) + excitation**2
    complement = complement_of(reflection)
    leaving = reflection[-1] * excitation + complement[-1] * past[-1]
    output = lattice_step(reflection, complement, past, order, excitation)
    assert np.sum(past**2) + leaving**2 == pytest.approx(energy, rel=1e-13)
    assert output == past[0]


@pytest.mark.parametrize("order", [1, 2, 7, 16])
def test_it_is_the_filter_in_direct_form(order):
    generator = np.random.default_rng(order)
    reflection = generator.uniform(-0.8, 0.8, order)
    noise = generator.standard_normal(300)
    past = np.zeros(order)
    complement = complement_of(reflection)
    output = [lattice_step(reflection, complement, past, order, e) for e in noise]
    direct = lfilter([np.prod(complement)], [1.0, *reflection_to_ar(reflection)], noise)
    np.testing.assert_allclose(output, direct, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2, 3, 8, 15, 30, 64])
@pytest.mark.parametrize("shape", [oracles.spread_lsf, oracles.low_pass_lsf])
def test_stages_of_frequencies_against_many_digits(order, shape):
    lsf = shape(order)
    reflection, complement = lattice_of(lsf)
    expected = oracles.step_down(oracles.lsf_to_ar(lsf))
    for found, beside, exact in zip(reflection, complement, expected, strict=True):
        distance = float((1 - exact) * (1 + exact))
        assert abs(found - float(exact)) <= 1e-5 * distance + 2e-14
        assert beside**2 == pytest.approx(distance, rel=1e-4, abs=2e-14)


def test_frequencies_that_meet_in_an_average_are_moved_apart():
    first = np.array([0.5, np.nextafter(0.5, 1), np.nextafter(0.5 + 2e-16, 1), 2.0])
    lsf = np.array([first, first + 1.1e-16 * np.arange(4)])
    inputs = np.array([[100.0, 1.5], [200.0, 1.5]])
    model = TextureModel(TextureSamples(inputs, lsf, np.ones(2), np.ones(2)))
    speed = np.linspace(100, 200, 301)
    lsf, variance = model.at(speed, np.full(301, 1.5))
    assert (np.diff(lsf, axis=1) > 0).all()
    assert (variance >= 0).all()
    assert np.isfinite(Synthesizer(model).render(speed, np.full(301, 1.5))).all()


def test_full_level_from_the_first_sample():
    model = one_filter(reflection_to_lsf(np.array([-0.9999, 0.999])), 1.0)
    point = np.array([150.0]), np.array([1.5])
    first = [Synthesizer(model, seed=seed).render(*point) for seed in range(900)]
    assert np.mean(np.square(first)) == pytest.approx(1.0, rel=0.15)


@given(levels=st.lists(st.sampled_from([0.0, 0.3, 1.0]), min_size=2, max_size=12))
@settings(max_examples=25)
def test_the_amplitude_never_falls_faster_than_the_release(levels):
    model = one_filter(reflection_to_lsf(np.array([-0.5, 0.5])), 1.0)
    force = np.repeat(np.array(levels) * 1.5, 20)
    speed = np.full(len(force), 150.0)
    loud = Synthesizer(model, seed=5).render(speed, np.full(len(force), 1.5))
    output = Synthesizer(model, seed=5).render(speed, force)
    amplitude = np.abs(output / loud)  # of the same noise
    lowest = np.where(amplitude < 2e-9, 0.0, amplitude * np.exp(-0.2501))
    assert (amplitude[1:] >= lowest[:-1]).all()
