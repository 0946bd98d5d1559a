"""Blocks of a generator in the tick: their delay, what is late, and our model in their place."""

from typing import Any

import numpy as np
import pytest

from mmt_methods.generators.vibration import GeneratedVibration, RenderedBlock


class Ours:
    """Stands for our synthesizer: a constant, and what it was asked by."""

    directed = False
    model: Any = None

    def __init__(self):
        self.asked = []

    def render(self, *inputs):
        self.asked.append(tuple(each[0] for each in inputs))
        return np.full(len(inputs[0]), 100.0)

    def reset(self):
        pass


class Echo:
    """A process that answers each block by its own velocity x, as soon as it is let."""

    def __init__(self):
        self.epoch, self.build, self.held = 0, 1, False
        self.sent = []
        self.answers = []

    def send(self, block):
        number, motion = block
        self.sent.append(number)
        samples = np.frombuffer(motion).reshape(3, -1)[0].tobytes()
        self.answers.append(RenderedBlock(number, self.epoch, self.build, 1_000_000, 7, samples))

    def poll(self):
        return bool(self.answers) and not self.held

    def recv(self):
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


def made(crossfade_samples=0, samples_per_frame=1):
    channel = Echo()
    vibration = GeneratedVibration("echo", Ours(), crossfade_samples, samples_per_frame)
    vibration.channel = channel
    vibration.wanted = True
    return vibration, channel


def stroke(vibration, x, block=1):
    parts = np.split(x, range(block, len(x), block))
    return np.concatenate(
        [vibration.render(part, np.zeros(len(part)), np.ones(len(part))) for part in parts]
    )


@pytest.mark.parametrize("block", [1, 3, 10, 17])
@pytest.mark.parametrize("samples", [1, 4, 10])
def test_what_is_played_is_of_the_motion_20_ms_ago(block, samples):
    vibration, _ = made(samples_per_frame=samples)
    x = np.arange(1.0, 400.0 * samples + 1.0)
    played = stroke(vibration, x, block)
    np.testing.assert_array_equal(played[60 * samples :], x[40 * samples : -20 * samples])
    assert vibration.late == 0
    assert vibration.clipped == 7
    assert vibration.times.quantile_ms(0.5) == pytest.approx(1.0, rel=0.02)


def test_our_model_is_played_until_the_generator_is_there_and_wanted():
    vibration, channel = made(crossfade_samples=40)
    channel.build = 0
    assert set(stroke(vibration, np.full(100, 3.0))) == {100.0}
    assert vibration.blocks == 0
    channel.build, vibration.wanted = 1, False
    assert set(stroke(vibration, np.full(100, 3.0))) == {100.0}
    vibration.wanted = True
    fading = stroke(vibration, np.full(40, 3.0))
    angle = 0.5 * np.pi * np.arange(1, 41) / 40
    np.testing.assert_allclose(fading, np.cos(angle) * 100.0 + np.sin(angle) * 3.0)
    assert set(stroke(vibration, np.full(100, 3.0))) == {3.0}


def test_our_model_is_asked_in_its_own_inputs():
    vibration, channel = made()
    channel.build = 0
    ours = vibration._model
    vibration.render(np.array([3.0]), np.array([4.0]), np.array([1.5]))
    ours.directed = True
    vibration.render(np.array([3.0]), np.array([4.0]), np.array([1.5]))
    assert ours.asked == [(5.0, 1.5), (3.0, 4.0, 1.5)]


def test_a_late_block_is_counted_and_fades_and_no_more_than_three_are_asked():
    vibration, channel = made()
    stroke(vibration, np.full(60, 5.0))
    channel.held = True
    asked = len(channel.sent)
    played = stroke(vibration, np.full(100, 5.0))
    assert np.all(np.diff(played[10:30]) <= 0.0)
    assert np.abs(np.diff(played)).max() <= 0.5 + 1e-12
    assert set(played[30:]) == {0.0}
    assert vibration.late == 10
    assert len(channel.sent) - asked <= 3
    channel.held = False
    assert set(stroke(vibration, np.full(100, 5.0))[60:]) == {5.0}
    assert vibration.fault is None
    assert (vibration.blocks, vibration.late) == (25, 11)  # one was not asked, as three were


def test_one_that_is_late_half_of_the_time_is_given_up():
    vibration, channel = made()
    stroke(vibration, np.full(60, 5.0))
    channel.held = True
    assert set(stroke(vibration, np.full(2000, 5.0))[-10:]) == {100.0}
    assert vibration.fault.startswith("generator echo: too slow, 100 of 10")
    assert not vibration.ready


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ("generator echo: it raised", "generator echo: it raised"),
        (EOFError(), "generator echo: the process that renders has ended"),
        (ConnectionResetError(), "generator echo: the process that renders has ended"),
    ],
)
def test_a_fault_goes_over_to_our_model(answer, sentence):
    vibration, channel = made(crossfade_samples=20)
    stroke(vibration, np.full(100, 5.0))
    channel.answers = [answer]
    assert stroke(vibration, np.full(100, 5.0))[-1] == 100.0
    assert vibration.fault == sentence


def test_after_a_reset_no_block_of_the_model_before_is_heard():
    vibration, channel = made()
    stroke(vibration, np.full(60, 5.0))
    vibration.epoch += 1
    assert set(stroke(vibration, np.full(60, 5.0))) == {100.0}
    channel.epoch = 1
    assert set(stroke(vibration, np.full(60, 5.0))[-10:]) == {5.0}


def test_motion_is_followed_while_nothing_is_rendered():
    vibration, _ = made()
    vibration.follow(*np.full((3, 55), 5.0))
    assert vibration.ready
    played = stroke(vibration, np.full(40, 6.0))
    np.testing.assert_allclose(played, np.repeat([5.0, 6.0], [20, 20]))
