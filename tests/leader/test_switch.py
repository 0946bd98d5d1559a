"""From the stream to a model and to another one, without a step, and what a landing adds."""

from types import SimpleNamespace

import numpy as np
import pytest

from mmt.devices.protocols import InterfaceState
from mmt.leader.output.renderer import ModelCrossfade
from mmt.leader.output.synthesis import Landing
from mmt.leader.output.vibration import VibrationSwitch

ONES = np.ones


class Constant:
    def __init__(self, value):
        self.value = value

    def render(self, speed_mm_s, force_n):
        return np.full(len(speed_mm_s), self.value)


class Noise:
    def __init__(self, seed, samples=1):
        self.generator, self.samples = np.random.default_rng(seed), samples

    def render(self, speed_mm_s, force_n):
        return self.generator.standard_normal(len(speed_mm_s))

    def __call__(self, now_ns):
        return self.generator.standard_normal(self.samples).tolist()


def make(streamed=1.0, synthesized=2.0, fade=50):
    return VibrationSwitch(
        lambda now_ns: (streamed,), Constant(synthesized), crossfade_samples=fade
    )


def run(switch, count, samples=1):
    return np.concatenate([switch.render(0, ONES(samples), ONES(samples)) for _ in range(count)])


def test_it_fades_to_the_model_and_back():
    switch = make()
    assert switch.mode == "streamed"
    assert (run(switch, 10) == 1.0).all()
    switch.use_model(True)
    there = run(switch, 60)
    assert switch.mode == "synthesized"
    assert (there[50:] == 2.0).all()
    assert np.abs(np.diff(there)).max() < 0.1
    switch.use_model(False)
    assert switch.mode == "fading"
    back = run(switch, 60)
    assert switch.mode == "streamed"
    assert (back[50:] == 1.0).all()
    assert np.abs(np.diff(np.concatenate([there, back]))).max() < 0.1


def test_turning_round_in_mid_fade_makes_no_step():
    switch = make()
    switch.use_model(True)
    output = [run(switch, 20)]
    switch.use_model(False)
    output.append(run(switch, 5))
    switch.use_model(True)
    output.append(run(switch, 60))
    assert np.abs(np.diff(np.concatenate(output))).max() < 0.1
    assert switch.mode == "synthesized"


@pytest.mark.parametrize("k", [1, 2, 5, 10])
def test_the_fade_keeps_the_power_of_uncorrelated_signals(k):
    powers = []
    for seed in range(300):
        switch = VibrationSwitch(
            Noise(seed, k), Noise(seed + 10_000), crossfade_samples=100 * k, samples_per_tick=k
        )
        switch.use_model(True)
        powers.append(run(switch, 100, k) ** 2)
        assert switch.mode == "synthesized"
    by_tenth = np.mean(powers, axis=0).reshape(10, -1).mean(axis=1)
    np.testing.assert_allclose(by_tenth, 1.0, atol=0.12)


def test_without_a_stream_it_fades_from_silence():
    switch = VibrationSwitch(None, Constant(2.0), crossfade_samples=10)
    assert switch.mode == "silent"
    assert (run(switch, 5) == 0.0).all()
    switch.use_model(True)
    assert run(switch, 20)[-1] == 2.0


def test_what_follows_the_motion_is_told_of_it_while_it_is_not_heard():
    class Following(Constant):
        directed = False
        unheard = 0

        def follow(self, speed_mm_s, force_n):
            self.unheard += len(speed_mm_s)

    following = Following(2.0)
    switch = VibrationSwitch(None, following, crossfade_samples=10)
    run(switch, 7)
    switch.use_model(True)
    run(switch, 30)
    assert following.unheard == 7


def test_each_missed_tick_gets_its_own_time_and_sample():
    seen = []

    def streamed(now_ns):
        seen.append(now_ns)
        return (float(len(seen)),)

    switch = VibrationSwitch(streamed, None, crossfade_samples=0)
    switch.use_model(True)  # of which there is none
    output = switch.render(10_000_000, ONES(3), ONES(3))
    assert output.tolist() == [1.0, 2.0, 3.0]
    assert seen == [8_000_000, 9_000_000, 10_000_000]
    assert switch.mode == "streamed"
    at_once = make(fade=0)
    at_once.use_model(True)
    assert run(at_once, 1) == 2.0
    at_once.touch_down(10.0)  # its renderer knows none


class Steady:
    """Renders its model's level, or noise of that level."""

    directed = False

    def __init__(self, seed=None):
        self.model = None
        self._random = None if seed is None else np.random.default_rng(seed)

    def render(self, *inputs):
        count = len(inputs[0])
        shape = np.ones(count) if self._random is None else self._random.standard_normal(count)
        return shape * (0.0 if self.model is None else self.model.level)

    def reset(self):
        pass


def model(level):
    return SimpleNamespace(level=level)


def faded_over(fade, count, block=1):
    inputs = np.ones(block), np.ones(block)
    return np.concatenate([fade.render(*inputs) for _ in range(count // block)])


def crossfade(samples=100, seed=None):
    second = None if seed is None else seed + 1
    one = Steady(seed)
    other = Steady(second)
    fade = ModelCrossfade(one, other, crossfade_samples=samples)
    fade.model = model(1.0)
    return fade


@pytest.mark.parametrize("block", [1, 8])
def test_it_goes_over_without_a_step_and_stays(block):
    fade = crossfade()
    fade.model = model(1.0)  # a newer one of the same surface is no fade
    assert faded_over(fade, 16, block).tolist() == [1.0] * 16
    fade.cross_to(model(3.0))
    faded = faded_over(fade, 200, block)
    assert np.abs(np.diff(faded, prepend=1.0)).max() < 0.06
    np.testing.assert_array_equal(faded[99:], 3.0)
    assert fade.model.level == 3.0
    at_once = crossfade(0)
    at_once.cross_to(model(2.0))
    assert faded_over(at_once, 2).tolist() == [2.0, 2.0]


def test_the_power_of_uncorrelated_vibrations_is_kept():
    fade = crossfade(20_000, seed=1)
    fade.cross_to(model(1.0))
    power = np.square(faded_over(fade, 20_000, block=100)).reshape(4, -1).mean(axis=1)
    np.testing.assert_allclose(power, 1.0, atol=0.1)


def test_a_fade_that_has_begun_ends_before_the_next_one():
    fade = crossfade()
    fade.cross_to(model(2.0))
    faded_over(fade, 50)
    fade.cross_to(model(5.0))
    assert fade.model.level == 5.0
    fade.model = model(4.0)  # a newer one of the surface that is to come
    first = faded_over(fade, 50)
    assert first[-1] == 2.0
    second = faded_over(fade, 100)
    assert np.abs(np.diff(second, prepend=2.0)).max() < 0.1
    assert second[-1] == fade.model.level == 4.0


def hand(velocity_mm_s, contact):
    return InterfaceState((0.0, 0.0, 0.0), (9.0, 9.0, velocity_mm_s), float(contact), contact)


def test_the_hands_speed_is_that_before_its_contact():
    for elapsed in (1, 3, 100):
        landing = Landing(2, 1000.0)
        for _ in range(0, 30, elapsed):
            assert landing.step(hand(-70.0, contact=False), elapsed) == 0.0
        assert landing.step(hand(-1.0, contact=True), 1) == pytest.approx(70.0)
        assert landing.step(hand(-1.0, contact=True), 1) == 0.0


@pytest.mark.parametrize("before", ["short", "lost", "upwards", "none"])
def test_no_approach_is_no_touch_down(before):
    landing = Landing(2, 1000.0)
    for _ in range({"short": 10, "none": 0}.get(before, 30)):
        landing.step(hand(5.0 if before == "upwards" else -70.0, contact=False), 1)
    if before == "lost":
        landing.step(None, 1)
    assert landing.step(hand(-70.0, contact=True), 1) == 0.0


class Landed:
    """Renders one for each touch-down, once."""

    directed = False

    def __init__(self):
        self.model = None
        self.speeds = []

    def touch_down(self, approach_speed_mm_s):
        self.speeds.append(approach_speed_mm_s)

    def reset(self):
        pass

    def render(self, *inputs):
        return np.zeros(len(inputs[0]))


@pytest.mark.parametrize("crossfade", [False, True])
def test_it_is_heard_with_the_model_alone(crossfade):
    one, other = Landed(), Landed()
    renderer = ModelCrossfade(one, other, crossfade_samples=10) if crossfade else one
    switch = VibrationSwitch(lambda _: (0.0,), renderer, crossfade_samples=5)
    for wanted, speed in ((False, 80.0), (True, 60.0), (False, 40.0)):
        switch.use_model(wanted)
        for _ in range(3):
            switch.render(0, np.zeros(1), np.zeros(1))
        switch.touch_down(speed)
        for _ in range(5):
            switch.render(0, np.zeros(1), np.zeros(1))
    switch.touch_down(20.0)
    assert one.speeds == [60.0, 40.0]  # the last in mid-fade
    assert not other.speeds
    if crossfade:
        renderer.cross_to(None)
        switch.use_model(True)
        switch.render(0, np.zeros(1), np.zeros(1))
        switch.touch_down(10.0)
        assert (one.speeds, other.speeds) == ([60.0, 40.0], [10.0])
