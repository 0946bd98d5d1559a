"""A window of a recording holds what the whole recording holds there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.session.data import OutputBlock, RecordedSession
from mmt.session.files import export_session, read_session, write_session
from mmt.session.info import info
from mmt.session.mcap.index import IndexedSession, open_windows
from mmt.session.mcap.messages import FRAME_BLOCK, FrameCodec, frame_schema
from mmt.session.mcap.writer import FRAMES_TOPIC, open_writer
from mmt.session.recorder import McapRecorder
from mmt.session.stream import open_recording

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


def test_a_whole_file_is_read_by_its_index(windows):
    assert not windows.in_memory
    assert windows.channels == CHANNELS
    assert windows.duration_s == pytest.approx(SECONDS, abs=0.03)
    assert [(e["event"], e["at_s"]) for e in windows.events] == [("first", 0.5), ("second", 2.25)]


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


def test_everything_in_one_window_is_the_session(recorded, windows):
    found, whole = windows.window(-1.0, 1e6), read_session(recorded)
    np.testing.assert_array_equal(found.frames, whole.frames)
    assert [o.mode for o in found.outputs] == [o.mode for o in whole.outputs]
    np.testing.assert_array_equal(
        np.concatenate([o.vibration_m_s2 for o in found.outputs]),
        np.concatenate([o.vibration_m_s2 for o in whole.outputs]),
    )


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
    codec = FrameCodec.of_channels(CHANNELS)
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


def test_a_file_that_was_cut_off_shows_what_it_holds(tmp_path, recorded):
    path = tmp_path / "cut.mcap"
    path.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 2 // 3])
    windows = open_windows(path)
    assert windows.in_memory
    assert 100 < len(windows.window(0.0, 10.0).frames) < COUNT


@pytest.mark.parametrize("whole", [True, False])
def test_times_of_a_recording_from_mid_session_count_from_its_first_frame(tmp_path, whole):
    path = tmp_path / "late.mcap"
    scene = {"control": {}}  # so that it is streamed with its events
    with McapRecorder(path, channels=CHANNELS, scene=scene, begins_s=100.0) as recorder:
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


def test_a_damaged_chunk_is_a_gap(tmp_path, recorded):
    data = bytearray(recorded.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    windows = open_windows(path)
    frames = windows.window(0.0, 10.0).frames
    assert 0 < len(frames) < COUNT
    assert np.isin(frames["sequence"], FRAMES["sequence"]).all()


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        open_windows(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("no recording")
    with pytest.raises(InputError, match="not an MCAP file"):
        open_windows(tmp_path / "text.mcap")
    with pytest.raises(InputError, match="suffix must be one of"):
        open_windows(tmp_path / "film.mp4")
    write_session(tmp_path / "empty.mcap", FRAMES[:0])
    with pytest.raises(InputError, match="no frames"):
        open_windows(tmp_path / "empty.mcap")
