import numpy as np
import pytest

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


def test_without_a_model_it_stays_with_the_stream():
    switch = VibrationSwitch(lambda now_ns: (1.0,), None, crossfade_samples=10)
    switch.use_model(True)
    assert (run(switch, 20) == 1.0).all()
    assert switch.mode == "streamed"


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


def test_no_crossfade_switches_at_once():
    switch = make(fade=0)
    switch.use_model(True)
    assert run(switch, 1)[0] == pytest.approx(2.0)


def test_each_missed_tick_gets_its_own_time_and_sample():
    seen = []

    def streamed(now_ns):
        seen.append(now_ns)
        return (float(len(seen)),)

    switch = VibrationSwitch(streamed, None, crossfade_samples=0)
    output = switch.render(10_000_000, ONES(3), ONES(3))
    assert output.tolist() == [1.0, 2.0, 3.0]
    assert seen == [8_000_000, 9_000_000, 10_000_000]
