"""From one state of a model that grows to the next: shares, filters between two, rendering."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_samples import directed, model, stiff

from mmt.rendering import open_textures, render, touch
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import Method
from mmt.texture.synthesis.generation import Generator, estimate
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt.texture.synthesis.update_fade import MixedModel, UpdateFade, can_be_mixed

FREQUENCIES_HZ = np.linspace(1.0, 499.0, 200)


def test_a_state_is_faded_in_over_the_time_that_the_last_was_in_use() -> None:
    fade = UpdateFade("a", 100)
    assert (fade.before, fade.now, fade.share) == (None, "a", 1.0)
    fade.advance(40)
    fade.use("b")
    assert (fade.before, fade.now, fade.share) == ("a", "b", 0.0)
    fade.advance(10)
    assert fade.share == 0.25
    fade.advance(30)
    assert (fade.before, fade.share) == (None, 1.0)
    fade.advance(1000)
    fade.use("c")
    fade.advance(99)
    assert (fade.before, fade.share) == ("b", 0.99)
    fade.use("d")  # in mid-fade
    assert (fade.before, fade.now, fade.share, fade.length) == ("c", "d", 0.0, 99)
    fade.finish()
    assert (fade.before, fade.share) == (None, 1.0)
    fade.use("e", at_once=True)
    assert (fade.before, fade.now, fade.share) == (None, "e", 1.0)


@pytest.mark.parametrize("longest", [0, 100])
def test_what_was_never_in_use_is_left_at_once(longest: int) -> None:
    fade = UpdateFade("a", longest)
    fade.use("b")
    assert (fade.before, fade.share) == (None, 1.0)


@given(st.integers(0, 50), st.lists(st.tuples(st.booleans(), st.integers(0, 40)), max_size=40))
def test_shares_rise_from_0_to_1_whatever_comes(
    longest: int, steps: list[tuple[bool, int]]
) -> None:
    fade = UpdateFade(0, longest)
    for number, (comes, count) in enumerate(steps, 1):
        if comes:
            fade.use(number)
        shares = [fade.share]
        for _ in range(count):
            fade.advance(1)
            shares.append(fade.share)
        assert shares[0] >= 0.0
        assert shares[-1] <= 1.0
        assert all(first <= second for first, second in itertools.pairwise(shares))
        assert (fade.before is None) == (fade.share == 1.0)


@pytest.mark.parametrize("made", [model, directed])
def test_the_ends_of_a_mix_are_the_models(made) -> None:
    before, now = made(seed=1), made(seed=2)
    inputs = before.samples.inputs.T
    for share, own in ((0.0, before), (1.0, now)):
        found = MixedModel(before, now, share).spectrum(*inputs, frequencies_hz=FREQUENCIES_HZ)
        np.testing.assert_allclose(
            found, own.spectrum(*inputs, frequencies_hz=FREQUENCIES_HZ), rtol=1e-9
        )


METHODS: tuple[Method, ...] = ("field", "published")


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 1.0), st.sampled_from(METHODS), st.sampled_from([1e-290, 1.0, 1e250]))
def test_filters_between_stiff_ones_are_stable_and_of_the_mean_power(
    share: float, method: Method, scale: float
) -> None:
    before, now = stiff(1, method, scale), stiff(2, method, scale)
    speed, force = np.linspace(-10.0, 400.0, 30), np.linspace(0.0, 4.0, 30)
    lsf, variance = MixedModel(before, now, share).at(speed, force)
    assert np.isfinite(variance).all()
    assert (np.diff(lsf, axis=1, prepend=0.0, append=np.pi) > 0.0).all()
    for k in range(0, 30, 6):
        found, old, new = (
            estimate(each, speed[k], force[k]).amplitude_m_s2
            for each in (MixedModel(before, now, share), before, now)
        )
        expected = np.hypot(np.sqrt(1.0 - share) * old, np.sqrt(share) * new)
        # poles so near to the circle: a lattice's own gain is right to some percent
        assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("renewal", [1, 7])
def test_rendering_goes_through_the_mixes(method: Method, renewal: int) -> None:
    before, now = (TextureModel(model(seed=seed).samples, method=method) for seed in (1, 2))
    speed, force = np.linspace(40.0, 260.0, 1000), np.linspace(2.5, 0.5, 1000)
    synthesizer = Synthesizer(before, seed=3, renewal_samples=renewal, fade_samples=300)
    found = [synthesizer.render(speed[:400], force[:400])]
    synthesizer.model = now
    found += [
        synthesizer.render(speed[k : k + 50], force[k : k + 50]) for k in range(400, 1000, 50)
    ]

    oracle, expected = Generator(seed=3), []
    for k in range(1000):
        if k % renewal == 0:
            share = min(max(0.0, (k - 400) / 300), 1.0)
            oracle.use(estimate(MixedModel(before, now, share), speed[k], force[k]))
        expected.append(oracle.generate(1)[0])
    np.testing.assert_allclose(np.concatenate(found), expected, rtol=1e-7, atol=1e-9)


def test_the_output_does_not_depend_on_the_block_size() -> None:
    models = [model(seed=seed) for seed in range(4)]
    speed, force = np.linspace(40.0, 260.0, 800), np.linspace(2.5, 0.5, 800)

    def rendered(block: int) -> np.ndarray:
        synthesizer, found = Synthesizer(seed=1, fade_samples=150), []
        for k in range(0, 800, block):
            if k % 200 == 0:
                synthesizer.model = models[k // 200]
            found.append(synthesizer.render(speed[k : k + block], force[k : k + block]))
        return np.concatenate(found)

    np.testing.assert_array_equal(rendered(200), rendered(1))
    np.testing.assert_array_equal(rendered(200), rendered(8))


@pytest.mark.parametrize(
    "other", [model(seed=2, order=5), model(seed=2, rate_hz=2000.0), directed(2), None]
)
def test_models_that_have_no_filters_between_them_follow_at_once(
    other: TextureModel | None,
) -> None:
    assert not can_be_mixed(model(), other)
    inputs = np.full(300, 150.0), np.full(300, 1.5)
    found = []
    for fade_samples in (0, 200):
        synthesizer = Synthesizer(model(), seed=1, fade_samples=fade_samples)
        synthesizer.render(*inputs)
        synthesizer.model = other
        found.append(synthesizer.render(*inputs))
    np.testing.assert_array_equal(*found)


def test_a_reset_ends_a_fade() -> None:
    inputs = np.full(200, 150.0), np.full(200, 1.5)
    found = []
    for fade_samples in (0, 200):
        synthesizer = Synthesizer(model(seed=1), seed=1, fade_samples=fade_samples)
        synthesizer.render(*inputs)
        synthesizer.model = model(seed=2)
        synthesizer.reset()
        found.append(synthesizer.render(*inputs))
    np.testing.assert_array_equal(*found)


def test_bounded_in_the_fades_of_stiff_models() -> None:
    models = [stiff(1), stiff(2, scale=1e-290), stiff(3, scale=1e250)]
    generator = np.random.default_rng(9)
    synthesizer = Synthesizer(models[0], seed=2, limit_m_s2=40.0, fade_samples=40)
    for block in range(200):
        synthesizer.model = models[block % 3]
        output = synthesizer.render(generator.uniform(0, 300, 50), generator.uniform(0, 3, 50))
        assert np.isfinite(output).all()
        assert np.abs(output).max() <= 40.0


@pytest.mark.parametrize("update_fade_s", [0.0, 0.5])
def test_other_states_of_textures_are_faded_in(update_fade_s: float) -> None:
    before, now = model(seed=1), model(seed=2)
    textures = open_textures([before], output_hz=1000, update_fade_s=update_fade_s)
    touch(textures, 0, 150.0, force_n=1.5)
    render(textures, 2000)
    textures.use([now])
    amplitudes = []
    for _ in range(70):
        render(textures, 10)
        assert textures.estimator.newest is not None
        amplitudes.append(textures.estimator.newest.filter.amplitude_m_s2)
    old, new = (estimate(each, 150.0, 1.5).amplitude_m_s2 for each in (before, now))
    shares = np.clip(np.arange(70) / 50.0, 0.0, 1.0) if update_fade_s else np.ones(70)
    np.testing.assert_allclose(amplitudes, np.sqrt((1 - shares) * old**2 + shares * new**2))
