"""Gaps in streamed vibration, from the buffer's input to its output."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from mmt.leader.output.concealment import (
    LONGEST_FRAMES,
    Continuation,
    FadeOut,
    backwards,
    build_concealment,
    course,
)
from mmt.leader.output.stream import PlayoutBuffer

MS = 1_000_000
DELAY = 4
WAYS = ("model", "repetition", "silence")
INVENTING = ("model", "repetition")


def textured(frames, seed=0, k=1):
    """Noise (frames k,) of unit power with two resonances, at 80 and 225 Hz."""
    generator = np.random.default_rng(seed)
    poles = [0.95 ** (1 / k) * np.exp(0.5j / k), 0.9 ** (1 / k) * np.exp(1.4j / k)]
    ar = np.poly([*poles, *np.conj(poles)]).real
    values = lfilter([1.0], ar, generator.standard_normal(frames * k))
    return values / values.std()


def play(way, values, missing=(), seed=1, k=1):
    """Return the output for a stream of values of which some frames are missing."""
    lost = set(missing)
    buffer = PlayoutBuffer(DELAY, concealment=build_concealment(way, seed, k))
    output = []
    for number, samples in enumerate(values.reshape(-1, k).tolist()):
        if number not in lost:
            buffer.push(number, number * MS, number * MS, samples)
        output.extend(buffer.pull(number * MS))
    return np.array(output), buffer.statistics()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("length", [0, 1, 2, 5, 20, 60, 100, 300])
def test_outside_the_gap_and_its_fade_the_stream_is_played_to_the_bit(way, length):
    values = textured(1500)
    output, statistics = play(way, values, range(500, 500 + length))
    played = np.delete(output[DELAY + 4 :], range(496, 496 + length + 4))
    np.testing.assert_array_equal(played, np.delete(values[4:-DELAY], range(496, 500 + length)))
    assert statistics.bridged == min(length, 100 + DELAY)  # the buffer's longest delay


@pytest.mark.parametrize("way", INVENTING)
@given(
    k=st.sampled_from([1, 1, 2, 5, 10]),
    gaps=st.lists(st.integers(1, 130), min_size=1, max_size=8),
    seed=st.integers(0, 30),
)
@settings(max_examples=40)
def test_no_joint_clicks_whatever_is_missing(way, k, gaps, seed):
    values = textured(400 + 30 * len(gaps) + sum(gaps), seed, k)
    missing, at = [], 300
    for gap in gaps:
        missing += range(at, at + gap)
        at += gap + 7
    output, _ = play(way, values, missing, seed, k)
    peak, step = np.abs(values).max(), np.abs(np.diff(values)).max()
    assert np.abs(output).max() <= peak
    # within a fade, a fifth of the difference between two signals, and what each moves by
    assert np.abs(np.diff(output)).max() <= step + 0.4 * peak / k + 1e-9


@pytest.mark.parametrize("count", [1, 5])
def test_a_fade_takes_five_frames_whatever_the_samples_in_a_frame(count):
    def of(act, frames):
        return np.concatenate([act() for _ in range(frames)])

    share = np.arange(1, 5 * count + 1) / (5 * count)
    pasts = []

    def go_on(past, gains):
        pasts.append(past)
        return gains * past[-1]

    for made in (FadeOut(count), Continuation(go_on, count)):
        assert made.silent
        assert list(made.bridge()) == [0.0] * count
        assert of(lambda made=made: made.play([1.0] * count), 5) == pytest.approx(share)
        assert (of(lambda made=made: made.play([1.0] * count), 60) == 1.0).all()
        assert not made.silent
        gap = of(made.bridge, 5)
        assert made.silent == isinstance(made, FadeOut)
        gap = np.append(gap, of(made.bridge, 40))
        held = 1.0 if isinstance(made, Continuation) else 0.0
        assert gap[: 5 * count] == pytest.approx(np.maximum(1.0 - share, held))
        assert gap[5 * count :] == pytest.approx(held)
        back = of(lambda made=made: made.play([3.0] * count), 5)
        assert back == pytest.approx(held + (3.0 - held) * share)
    assert [len(past) for past in pasts] == [128 * count]
    assert not pasts[0][: 60 * count].any()
    assert backwards(np.arange(9.0), np.array([1.0, 0.5, 0.0])).tolist() == [7.0, 3.0, 0.0]


def test_the_joint_of_a_model_is_as_smooth_as_the_signal():
    steps = {way: [] for way in WAYS}
    for seed in range(60):
        values = textured(700, seed)
        for way in WAYS:
            output, _ = play(way, values, range(500, 520), seed)
            joint = np.abs(np.diff(output[500 + DELAY - 1 : 500 + DELAY + 1]))
            steps[way].append(joint.max() / np.std(np.diff(values)))
    assert np.max(steps["model"]) < 4.5
    assert np.mean(steps["model"]) < 1.2


@pytest.mark.parametrize("way", INVENTING)
def test_a_trickle_of_samples_keeps_nothing_alive(way):
    values = np.sin(0.3 * np.arange(3000))
    missing = [k for k in range(500, 3000) if k % 20]
    output, _ = play(way, values, missing)
    assert np.std(output[1500:]) < 0.25 * np.std(values)


@pytest.mark.parametrize(("way", "within"), [("model", 0.25), ("repetition", 0.4)])
def test_every_third_sample_missing_keeps_the_level(way, within):
    values = textured(4000)
    generator = np.random.default_rng(2)
    missing = [k for k in range(500, 4000) if generator.random() < 0.33]
    output, statistics = play(way, values, missing)
    assert statistics.bridged > 900
    assert np.std(output[1000:]) == pytest.approx(np.std(values[1000:]), rel=within)


def test_the_seed_decides_what_is_invented():
    values, gap = textured(800), range(500, 560)
    first, again, other = (play("model", values, gap, seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    repeated = [play("repetition", values, gap, seed)[0] for seed in (1, 2)]
    np.testing.assert_array_equal(*repeated)


@pytest.mark.parametrize("invented", [0, 30, 50, 77, 99, LONGEST_FRAMES])
def test_the_level_never_falls_faster_than_a_fade(invented):
    gains = np.concatenate([[1.0], course(invented, 1)])
    assert (np.diff(gains) <= 0.0).all()
    assert np.diff(gains).min() >= -0.2 - 1e-12
    assert (gains[-20 + 5 :] == 0.0).all()


def test_an_invented_frame_takes_one_from_the_allowance_and_a_received_one_gives_back_two():
    gap = Continuation(lambda _past, gains: gains, 1)
    for _ in range(LONGEST_FRAMES // 2):
        gap.play([1.0])
    for _ in range(70):
        gap.bridge()
    for _ in range(15):
        gap.play([1.0])
    level = np.ravel([gap.bridge() for _ in range(20)])
    assert level.tolist() == course(70 - 2 * 15, 1)[:20].tolist()
