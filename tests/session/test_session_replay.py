"""A replay sends the recorded frames with their timing, and invents nothing."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, frame_dtype
from mmt.session.data import RecordedSession
from mmt.session.replay import ReplaySource

START_NS = 5_000_000_000
TICK_NS = 1_000_000
LATE_NS = 50_000
"""A tick comes a little after its deadline, as on a real machine."""


def session_of(frames, annotations=b""):
    return RecordedSession(frames, annotations=annotations, path=Path("run.mcap"))


def even_frames(count, channels=CHANNELS, steps=None):
    frames = made_frames(count, channels, steps=steps)
    frames["time_ns"] = 77 + frames["sequence"].astype(np.int64) * TICK_NS
    return frames


def play(source, ticks):
    """The blocks of each step, a tick apart."""
    source.start(START_NS)
    return [source.step(1, START_NS + tick * TICK_NS + LATE_NS, None) for tick in range(ticks)]


def test_each_tick_sends_its_frame_at_its_time():
    frames = even_frames(500)
    source = ReplaySource(session_of(frames, b"truth"), CHANNELS)
    blocks = play(source, 500)
    assert [len(block) for block in blocks] == [1] * 500
    sent = np.concatenate(blocks)
    np.testing.assert_array_equal(sent["sequence"], np.arange(500))
    np.testing.assert_array_equal(sent["time_ns"], START_NS + np.arange(500) * TICK_NS)
    for name in ("position_mm", "force_n", "acceleration_m_s2"):
        np.testing.assert_array_equal(sent[name], frames[name])
    assert source.finished
    assert source.annotations == b"truth"
    assert len(source.step(1, START_NS + 10**12, None)) == 0


@given(
    speed=st.floats(0.05, 100),
    elapsed=st.lists(st.integers(1, 60), min_size=1, max_size=60),
    loop=st.booleans(),
    gaps=st.sampled_from(["keep", "skip"]),
    data=st.data(),
)
@settings(max_examples=60)
def test_every_frame_is_sent_once_at_its_deadline(speed, elapsed, loop, gaps, data):
    count = data.draw(st.integers(1, 120))
    steps = data.draw(
        st.lists(st.sampled_from([1, 1, 1, 2, 30]), min_size=count - 1, max_size=count - 1)
    )
    frames = even_frames(count, steps=steps)
    source = ReplaySource(session_of(frames), CHANNELS, speed=speed, loop=loop, gaps=gaps)
    now_ns, sent = START_NS, []
    source.start(START_NS)
    for step in elapsed:
        now_ns += step * TICK_NS
        block = source.step(step, now_ns, None)
        sent.append(block)
        due_ns = START_NS + int((now_ns - START_NS) * speed)
        assert np.all(block["time_ns"] <= due_ns)
        if not source.finished:
            # The next frame, wherever it is, is not due yet.
            longest = 30 if gaps == "keep" else 2
            newest = int(np.concatenate(sent)["time_ns"][-1])
            assert due_ns < newest + longest * TICK_NS
    sent = np.concatenate(sent)
    index = np.arange(len(sent))
    np.testing.assert_array_equal(sent["force_n"], frames["force_n"][index % count])
    jumps = np.diff(sent["sequence"].astype(int))
    np.testing.assert_array_equal(np.diff(sent["time_ns"]), jumps * TICK_NS)
    kept = np.array([*steps, 2])  # the last one is the joint between loops
    expected = kept if gaps == "keep" else np.minimum(kept, 2)
    np.testing.assert_array_equal(jumps, expected[index[:-1] % count])
    assert source.finished is (not loop and len(sent) == count)
    source.close()
    assert source.finished
    assert len(source.step(1, now_ns + 10**12, None)) == 0


def test_recorded_jitter_is_sent_again_whenever_it_is_started():
    frames = made_frames(200)
    source = ReplaySource(session_of(frames), CHANNELS)
    for _ in range(2):
        sent = np.concatenate(play(source, 201))
        since_ns = frames["time_ns"] - frames["time_ns"][0]
        np.testing.assert_array_equal(sent["time_ns"] - START_NS, since_ns)


def test_a_follower_that_started_anew_is_joined():
    frames = np.concatenate([even_frames(20), even_frames(20)])
    frames["sequence"][20:] = np.arange(20)
    source = ReplaySource(session_of(frames), CHANNELS)
    sent = np.concatenate(play(source, 60))
    np.testing.assert_array_equal(sent["sequence"], np.r_[:20, 21:41])
    np.testing.assert_array_equal(
        sent["time_ns"], START_NS + sent["sequence"].astype(np.int64) * TICK_NS
    )


def test_only_the_channels_that_are_asked_for_are_sent():
    frames = even_frames(5)
    source = ReplaySource(session_of(frames), ("force",))
    sent = np.concatenate(play(source, 5))
    assert sent.dtype == frame_dtype(("force",))
    np.testing.assert_array_equal(sent["force_n"], frames["force_n"])
    np.testing.assert_array_equal(frames, even_frames(5))  # the session is not changed


def test_it_says_what_it_replays():
    session = session_of(even_frames(1000, steps=np.where(np.arange(999) == 3, 5, 1)))
    told = "replay of run.mcap, 1.0 s, 1000 frames, 4 missing"
    assert ReplaySource(session, CHANNELS).describe() == f"{told} (kept)"
    fast = ReplaySource(session, CHANNELS, speed=2.5, loop=True, gaps="skip")
    assert fast.describe() == f"{told} (closed up), 2.5 times as fast, looped"


def test_what_cannot_be_replayed_is_refused():
    alone = session_of(even_frames(5, ("force",)))
    for session, channels, said in (
        (session_of(even_frames(0)), CHANNELS, "the session holds no frames"),
        (alone, CHANNELS, r"no position and no acceleration.*it has force"),
        (alone, ("force", "orientation"), r"has no orientation, which the scene needs"),
    ):
        with pytest.raises(InputError, match=said):
            ReplaySource(session, channels)
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="it must be above zero"):
            ReplaySource(alone, ("force",), speed=speed)


def test_a_recording_of_another_rate_is_refused_with_what_to_write():
    session = session_of(made_frames(5, samples_per_frame=4))
    with pytest.raises(InputError, match=r"at 4000 Hz.*at 1000: write acceleration_rate_hz = 4000"):
        ReplaySource(session, CHANNELS)
    assert ReplaySource(session, ("force",)).step(1, 10**9)["force_n"].shape == (5, 3)
    source = ReplaySource(session, CHANNELS, samples_per_frame=4)
    sent = source.step(1, 10**9)["acceleration_m_s2"]
    np.testing.assert_array_equal(sent, session.frames["acceleration_m_s2"])
