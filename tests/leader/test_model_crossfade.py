"""From one model's vibration to that of another, without a step."""

from types import SimpleNamespace

import numpy as np

from mmt.leader.output.model_crossfade import ModelCrossfade


class Steady:
    """Renders its model's level, or noise of that level."""

    directed = False

    def __init__(self, seed=None):
        self.model = None
        self.resets = 0
        self._random = None if seed is None else np.random.default_rng(seed)

    def render(self, *inputs):
        count = len(inputs[0])
        shape = np.ones(count) if self._random is None else self._random.standard_normal(count)
        return shape * (0.0 if self.model is None else self.model.level)

    def reset(self):
        self.resets += 1


def model(level):
    return SimpleNamespace(level=level)


def run(fade, count, block=1):
    inputs = np.ones(block), np.ones(block)
    return np.concatenate([fade.render(*inputs) for _ in range(count // block)])


def made(samples=100, seed=None):
    second = None if seed is None else seed + 1
    one = Steady(seed)
    other = Steady(second)
    fade = ModelCrossfade(one, other, crossfade_samples=samples)
    fade.model = model(1.0)
    return fade


def test_it_goes_over_without_a_step_and_stays():
    fade = made()
    assert run(fade, 10).tolist() == [1.0] * 10
    fade.cross_to(model(3.0))
    faded = run(fade, 200)
    assert np.abs(np.diff(faded, prepend=1.0)).max() < 0.06
    np.testing.assert_array_equal(faded[99:], 3.0)
    assert fade.model.level == 3.0


def test_the_power_of_uncorrelated_vibrations_is_kept():
    fade = made(20_000, seed=1)
    fade.cross_to(model(1.0))
    power = np.square(run(fade, 20_000, block=100)).reshape(4, -1).mean(axis=1)
    np.testing.assert_allclose(power, 1.0, atol=0.1)


def test_a_newer_model_of_the_same_surface_is_no_fade():
    fade = made()
    fade.model = model(2.0)
    assert run(fade, 3).tolist() == [2.0] * 3


def test_a_fade_that_has_begun_ends_before_the_next_one():
    fade = made()
    fade.cross_to(model(2.0))
    run(fade, 50)
    fade.cross_to(model(5.0))
    assert fade.model.level == 5.0
    fade.model = model(4.0)  # a newer one of the surface that is to come
    first = run(fade, 50)
    assert first[-1] == 2.0
    second = run(fade, 100)
    assert np.abs(np.diff(second, prepend=2.0)).max() < 0.1
    assert second[-1] == fade.model.level == 4.0


def test_the_length_of_blocks_does_not_matter():
    each, blocks = made(), made()
    for fade in (each, blocks):
        fade.cross_to(model(2.0))
    np.testing.assert_allclose(run(each, 120), run(blocks, 120, block=8))


def test_a_fade_of_no_length_goes_over_at_once():
    fade = made(0)
    fade.cross_to(model(2.0))
    assert run(fade, 2).tolist() == [2.0, 2.0]
