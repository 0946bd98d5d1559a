"""Rendering with given white samples, so that renderers can be compared."""

import numpy as np
import pytest
from library_samples import directed, model

from mmt.core.errors import InputError
from mmt.texture.synthesis.synthesizer import Synthesizer

PARTS = ((0, 1), (1, 400), (400, 700))


@pytest.mark.parametrize("made", [model(), directed()])
def test_the_same_excitation_gives_the_same_vibration_whatever_seed_and_blocks(made):
    count = 700
    white = np.random.default_rng(7).standard_normal(count)
    inputs = [np.linspace(20.0, 250.0, count)] * (made.dimensions - 1)
    inputs.append(np.linspace(0.2, 2.5, count))
    given = Synthesizer(made, seed=7)
    parts = [given.render(*(v[a:b] for v in inputs), excitation=white[a:b]) for a, b in PARTS]
    whole = Synthesizer(made, seed=8).render(*inputs, excitation=white)
    np.testing.assert_array_equal(np.concatenate(parts), whole, strict=True)
    assert np.abs(whole).max() > 0.0


def test_without_excitation_only_what_the_filter_remembers_is_heard():
    speed, force = np.full(3000, 100.0), np.ones(3000)
    rendered = Synthesizer(model(), seed=1)
    assert not rendered.render(speed, force, excitation=np.zeros(3000)).any()
    before = rendered.render(speed, force)
    after = rendered.render(speed, force, excitation=np.zeros(3000))
    assert np.abs(after[:5]).max() > 0.01 * np.abs(before).max()
    assert np.abs(after[-100:]).max() < 1e-6 * np.abs(after[:100]).max()


@pytest.mark.parametrize(
    "excitation", [np.zeros(99), np.zeros((100, 1)), np.array([np.nan] * 100), np.float64(0.0)]
)
def test_an_excitation_that_does_not_fit_is_refused(excitation):
    with pytest.raises(InputError, match="excitation has shape"):
        Synthesizer(model()).render(np.full(100, 100.0), np.ones(100), excitation=excitation)


@pytest.mark.parametrize("excitation", [np.zeros(100, complex), "white", [[0.0], [0.0, 0.0]]])
def test_an_excitation_that_is_no_array_of_numbers_is_refused(excitation):
    with pytest.raises(InputError, match="excitation is"):
        Synthesizer(model()).render(np.full(100, 100.0), np.ones(100), excitation=excitation)


@pytest.mark.parametrize("inputs", [(), (100.0, 1.0), (None, None), (np.ones((3, 1)),) * 2])
@pytest.mark.parametrize("rendered", [model(), None])
def test_inputs_that_are_no_rows_are_refused(inputs, rendered):
    with pytest.raises(InputError, match=r"each must be \(n,\) float64"):
        Synthesizer(rendered).render(*inputs)


def test_the_name_of_a_model_is_none():
    with pytest.raises(InputError, match="model is 'oak', allowed is TextureModel or None"):
        Synthesizer("oak")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seed", -1),
        ("renewal_samples", 0),
        ("renewal_samples", 1.5),
        ("limit_m_s2", np.nan),
        ("limit_m_s2", -1.0),
    ],
)
def test_numbers_of_a_synthesizer_are_checked(name, value):
    with pytest.raises(InputError, match=f"{name} is {value}, allowed is a"):
        Synthesizer(model(), **{name: value})
