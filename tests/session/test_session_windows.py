"""A window of a recording, or a stream of its blocks, holds what the whole recording holds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from session_samples import made_frames

import mmt
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.evaluation.evaluate import evaluate_session
from mmt.session.data import OutputBlock, RecordedSession
from mmt.session.files import export_session, read_session, write_session
from mmt.session.info import info
from mmt.session.mcap.index import IndexedSession
from mmt.session.mcap.messages import FRAME_BLOCK, FrameCodec, frame_schema
from mmt.session.mcap.writer import FRAMES_TOPIC, open_writer
from mmt.session.recorder import McapRecorder
from mmt.session.stream import blocks_of, in_memory, open_recording, open_windows
from mmt.texture.online.history import stream_blocks
from mmt.texture.signals.filtering import StreamNumbering

COUNT = 3000
FRAMES = made_frames(COUNT, steps=np.where(np.arange(COUNT - 1) == 1200, 500, 1))
SECONDS = (int(FRAMES["sequence"][-1]) + 1) / 1e3
SESSION = RecordedSession(
    frames=FRAMES,
    events=[{"time_s": 0.5, "event": "first"}, {"time_s": 2.25, "event": "second", "mark": "m"}],
    outputs=[
        OutputBlock(start / 1e3, "streamed" if start < 800 else "synthesized", np.full(20, 1.0))
        for start in range(0, COUNT, 20)
    ],
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    export_session(SESSION, path)
    return path


@pytest.fixture(scope="module")
def windows(recorded):
    return open_windows(recorded)


def test_a_whole_file_is_read_by_its_index(recorded, windows):
    assert not windows.in_memory
    assert windows.channels == CHANNELS
    assert windows.duration_s == pytest.approx(SECONDS, abs=0.03)
    assert [(e["event"], e["at_s"]) for e in windows.events] == [("first", 0.5), ("second", 2.25)]
    found, whole = windows.window(-1.0, 1e6), read_session(recorded)
    np.testing.assert_array_equal(found.frames, whole.frames)
    assert [o.mode for o in found.outputs] == [o.mode for o in whole.outputs]
    shown, kept = (np.concatenate([o.vibration_m_s2 for o in s.outputs]) for s in (found, whole))
    np.testing.assert_array_equal(shown, kept)


@given(begin=st.floats(-1, 4), length=st.floats(0, 4))
@settings(max_examples=40)
def test_a_window_holds_the_frames_and_outputs_of_its_time(windows, begin, length):
    time_s = SESSION.time_s
    end = begin + length
    found = windows.window(begin, end)
    # a block's times are kept to the nanosecond, which seconds as a float are not
    sure = (time_s >= begin + 1e-6) & (time_s < end - 1e-6)
    perhaps = (time_s >= begin - 1e-6) & (time_s < end + 1e-6)
    assert set(FRAMES["sequence"][sure]) <= set(found.frames["sequence"])
    assert set(found.frames["sequence"]) <= set(FRAMES["sequence"][perhaps])
    assert (np.diff(found.frames["sequence"].astype(np.int64)) > 0).all()
    np.testing.assert_allclose(
        found.time_s, time_s[np.isin(FRAMES["sequence"], found.frames["sequence"])], atol=1e-6
    )
    starts = [output.time_s for output in found.outputs]
    expected = [o.time_s for o in SESSION.outputs if o.time_s + 0.02 > begin and o.time_s < end]
    assert len(set(np.round(starts, 3)) ^ set(np.round(expected, 3))) <= 2


def test_frames_that_came_late_stand_at_their_places(tmp_path):
    path, frames = tmp_path / "run.mcap", made_frames(100)
    clock_ns = iter(range(4_999_000_000, 6_000_000_000, 1_000_000))
    with McapRecorder(path, channels=CHANNELS, clock=lambda: next(clock_ns)) as recorder:
        for index in [*range(40), *range(60, 100)]:
            recorder.record_frames(frames[index : index + 1])
        recorder.record_backfill(frames[40:60], 5_040_000_000)
    windows = open_windows(path)
    found = windows.window(0.0, 10.0)
    np.testing.assert_array_equal(found.frames, frames)
    assert (np.diff(found.time_s) >= 0).all()
    assert int(found.arrivals[0, 0]) == 5_000_000_000
    assert set(found.arrivals[:, 1]) <= set(frames["time_ns"])  # of live blocks alone


def test_blocks_that_another_writer_has_numbered_otherwise_are_read(tmp_path):
    path, frames = tmp_path / "run.mcap", made_frames(100)
    codec = FrameCodec(CHANNELS)
    with path.open("wb") as stream:
        writer = open_writer(stream)
        schema = writer.register_schema(FRAME_BLOCK, "protobuf", frame_schema(CHANNELS))
        channel = writer.register_channel(FRAMES_TOPIC, "protobuf", schema)
        for number, block in enumerate(np.split(frames, 5)):
            came_ns = int(block["time_ns"][0])
            writer.add_message(channel, came_ns, codec.encode(block), came_ns, 1000 + number)
        writer.finish()
    windows = open_windows(path)
    found = windows.window(0.0, 1.0)
    np.testing.assert_array_equal(found.frames, frames)
    np.testing.assert_allclose(found.time_s, (frames["time_ns"] - frames["time_ns"][0]) / 1e9)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_other_kinds_are_held_in_memory(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    export_session(SESSION, path)
    windows = open_windows(path)
    assert windows.in_memory
    assert len(windows.window(0.0, 0.1).frames) == pytest.approx(100, abs=2)


def test_a_file_that_was_cut_off_or_damaged_shows_what_it_holds(tmp_path, recorded):
    whole = recorded.read_bytes()
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0xFF
    path = tmp_path / "run.mcap"
    for content, held in ((whole[: len(whole) * 2 // 3], True), (damaged, False)):
        path.write_bytes(content)
        windows = open_windows(path)
        assert windows.in_memory is held
        frames = windows.window(0.0, 10.0).frames
        assert 100 < len(frames) < COUNT
        assert np.isin(frames["sequence"], FRAMES["sequence"]).all()


@pytest.mark.parametrize("whole", [True, False])
def test_times_of_a_recording_from_mid_session_count_from_its_first_frame(tmp_path, whole):
    path = tmp_path / "late.mcap"
    scene = {"control": {}}  # so that it is streamed with its events
    with McapRecorder(
        path, channels=CHANNELS, scene=scene, session_time_s=lambda: 101.0
    ) as recorder:
        recorder.record_frames(FRAMES[:1000])
        for time_s, control in ((100.25, "giving"), (100.5, "moves"), (100.75, "ended")):
            recorder.record_event({"time_s": time_s, "event": "told", "control": control})
        recorder.record_frames(FRAMES[1000:])
    if not whole:
        path.write_bytes(path.read_bytes()[:-200])
    windows = open_windows(path)
    assert windows.in_memory is not whole
    assert [event["at_s"] for event in windows.events] == [0.25, 0.5, 0.75]
    assert [period.from_s for period in info(path).control] == [0.0, 0.25, 0.5, 0.75]
    assert info(path).hand_overs[0] == "0.250 s: told"
    if whole:
        streamed = open_recording(path)
        assert isinstance(streamed, IndexedSession)
        assert [event["time_s"] for event in streamed.events] == [0.25, 0.5, 0.75]


def test_what_cannot_be_shown_is_said(tmp_path):
    (tmp_path / "text.mcap").write_text("no recording")
    write_session(tmp_path / "empty.mcap", FRAMES[:0])
    for name, said in (
        ("none.mcap", "No such file"),
        ("text.mcap", "not an MCAP file"),
        ("film.mp4", "suffix must be one of"),
        ("empty.mcap", "no frames"),
    ):
        with pytest.raises(InputError, match=said):
            open_windows(tmp_path / name)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A session of 15 s in many chunks, with its scene and its truth."""
    path = tmp_path_factory.mktemp("stream") / "wood.mcap"
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=15.0)
    write_session(path, frames, scene=mmt.Scene().dump(), annotations=truth)
    return path


def test_a_stream_has_the_frames_of_the_file_in_their_order(file):
    stream, session = open_recording(file), read_session(file)
    assert isinstance(stream, IndexedSession)
    for _ in range(2):  # every reading begins anew
        blocks = list(blocks_of(stream))
        assert len(blocks) > 1
        np.testing.assert_array_equal(np.concatenate(blocks), session.frames)
    assert (stream.scene, stream.annotations) == (session.scene, session.annotations)
    np.testing.assert_array_equal(in_memory(stream).frames, session.frames)


def test_an_evaluation_of_a_stream_is_that_of_the_session_to_the_digit(file):
    streamed = evaluate_session(open_recording(file)).as_dict()
    whole = evaluate_session(read_session(file)).as_dict()
    for figures in (streamed, whole):
        for name in [name for name in figures if "processing" in name or "real_time" in name]:
            del figures[name]
        moments = [figures[name] for name in ("at_start", "at_stop", "at_end")]
        for step in [*figures["steps"], *moments]:
            del step["update_ms"]
    assert streamed == whole


def test_what_is_not_in_order_or_no_whole_mcap_is_read_into_memory(tmp_path):
    write_session(tmp_path / "made.npz", FRAMES)
    assert isinstance(open_recording(tmp_path / "made.npz"), RecordedSession)
    with pytest.raises(InputError, match="nowhere"):
        open_recording(tmp_path / "nowhere.mcap")
    frames = FRAMES[:100]
    late = tmp_path / "late.mcap"
    with McapRecorder(late, channels=CHANNELS) as recorder:
        recorder.record_frames(frames[:30])
        recorder.record_frames(frames[70:])
        recorder.record_backfill(frames[30:70], 0)
    session = open_recording(late)
    assert isinstance(session, RecordedSession)
    np.testing.assert_array_equal(session.frames, frames)


@pytest.mark.parametrize("parts", [[5, 400, 1, 2594], [1] * 50 + [2950], [3000], [1500, 0, 1500]])
@pytest.mark.parametrize("order", ["even", "gap", "again"])
def test_blocks_do_not_depend_on_the_parts_that_a_session_comes_in(parts, order):
    frames = made_frames(3000)
    if order == "gap":
        frames["sequence"][1200:] += 700
    if order == "again":  # the follower began anew
        frames["sequence"][2000:] = np.arange(1000)
    cut = np.split(frames, np.cumsum(parts[:-1]))
    expected = whole_blocks(StreamNumbering().number(frames), 250)
    assert [len(block) for block in stream_blocks(cut, 250)] == expected
    assert [len(block) for block in stream_blocks([frames], 250)] == expected


def whole_blocks(frames, period):
    """Lengths of the blocks by the definition: full where the newest number is a period on."""
    numbers = frames["sequence"].astype(int).tolist()
    lengths, start, newest = [], 0, -1
    for index, number in enumerate(numbers):
        newest = max(newest, number)
        if newest >= numbers[start] + period - 1:
            lengths.append(index + 1 - start)
            start = index + 1
    return [*lengths, len(numbers) - start] if start < len(numbers) else lengths
