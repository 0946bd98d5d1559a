"""What is written into a session file comes back, for this package and for any other."""

import json
import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from session_samples import START_NS, made_frames

import mmt.session
from mmt.core.errors import InputError
from mmt.core.extras import __version__
from mmt.core.frames import ALL_CHANNELS, CHANNELS
from mmt.session.data import OutputBlock
from mmt.session.files import export_session, read_session, write_session
from mmt.session.info import info
from mmt.session.mcap.messages import FrameCodec
from mmt.session.mcap.writer import SessionWriter
from mmt.session.stream import open_windows
from mmt.session.windows import MemoryWindows

SCENE = {"session": {"name": "wood", "rate_hz": 1000}, "link": {"port": 8765}}


@given(
    count=st.integers(0, 130),
    channels=st.sets(st.sampled_from(ALL_CHANNELS), min_size=1),
    seed=st.integers(0, 2**32 - 1),
    data=st.data(),
)
@settings(max_examples=30)
def test_frames_come_back_as_they_were_written(tmp_path_factory, count, channels, seed, data):
    ordered = tuple(channel for channel in ALL_CHANNELS if channel in channels)
    steps = data.draw(st.lists(st.integers(1, 5000), min_size=count, max_size=count))
    frames = made_frames(count, ordered, seed=seed, steps=steps[: max(0, count - 1)])
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    write_session(path, frames)
    session = read_session(path)
    assert session.frames.dtype == frames.dtype
    np.testing.assert_array_equal(session.frames, frames)
    assert session.channels == ordered
    assert session.complete


@given(sizes=st.lists(st.integers(1, 90), min_size=1, max_size=12))
@settings(max_examples=20)
def test_blocks_of_any_size_come_back(tmp_path_factory, sizes):
    frames = made_frames(sum(sizes))
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    with path.open("wb") as stream:
        writer = SessionWriter(stream, CHANNELS)
        first = 0
        for size in sizes:
            writer.write_frames(frames[first : first + size], first)
            first += size
        writer.finish()
    np.testing.assert_array_equal(read_session(path).frames, frames)


def test_extreme_numbers_come_back(tmp_path):
    frames = made_frames(8)
    tiny, huge = np.finfo(np.float32).smallest_subnormal, np.finfo(np.float32).max
    frames["position_mm"] = np.array([np.nan, np.inf, -np.inf, 0, -0.0, tiny, huge, -huge])[:, None]
    frames["sequence"][-1] = 2**32 - 1
    frames["time_ns"][:2] = [-5, 2**62]
    write_session(tmp_path / "run.mcap", frames)
    assert read_session(tmp_path / "run.mcap").frames.tobytes() == frames.tobytes()


def test_everything_beside_the_frames_comes_back(tmp_path):
    beside = {
        "scene": SCENE,
        "annotations": b"\x00truth\xff",
        "models": [(0.25, b"first model"), (0.75, b"\x00\xff" * 40_000)],
        "events": [{"time_s": 0.6, "event": "mark", "list": [1, 2], "nothing": None}],
    }
    outputs = [OutputBlock(0.1, "streamed", np.arange(20.0)), OutputBlock(0.2, "model", np.ones(1))]
    write_session(tmp_path / "run.mcap", made_frames(1000), outputs=outputs, **beside)
    session = read_session(tmp_path / "run.mcap")
    assert {name: getattr(session, name) for name in beside} == beside
    assert [(o.time_s, o.mode) for o in session.outputs] == [(0.1, "streamed"), (0.2, "model")]
    np.testing.assert_array_equal(session.outputs[0].vibration_m_s2, np.arange(20.0))
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_numbers_that_json_lacks_do_not_break_an_event(tmp_path):
    odd = [float("nan"), np.float32(2.5), np.arange(2), Path("a/b"), (1, np.inf)]
    write_session(tmp_path / "run.mcap", made_frames(1), events=[{"time_s": 0.0, "odd": odd}])
    (event,) = read_session(tmp_path / "run.mcap").events
    assert event == {"time_s": 0.0, "odd": [None, 2.5, [0, 1], "a/b", [1, None]]}


@pytest.mark.parametrize(
    "time_s", [float("nan"), None, "soon", 1e300, 10**400], ids=lambda time_s: str(time_s)[:5]
)
def test_an_event_without_a_time_is_at_the_beginning(tmp_path, time_s):
    event = {"time_s": time_s, "event": "mark"}
    write_session(tmp_path / "run.mcap", made_frames(30), events=[event])
    session = read_session(tmp_path / "run.mcap")
    assert [each["event"] for each in session.events] == ["mark"]
    export_session(session, tmp_path / "again.mcap")
    assert read_session(tmp_path / "again.mcap").events == session.events
    assert MemoryWindows(session).events[0]["at_s"] == 0.0


def test_a_session_without_frames_is_a_session(tmp_path):
    path = tmp_path / "run.mcap"
    events = [{"time_s": time_s, "event": "waiting"} for time_s in (1.0, 3.5)]
    write_session(path, made_frames(0, ("force",)), scene=SCENE, events=events)
    session = read_session(path)
    assert len(session.frames) == 0
    assert [event["time_s"] for event in session.events] == [0.0, 2.5]
    assert session.channels == ("force",)
    described = info(path)
    assert (described.frames, described.duration_s, described.rate_hz) == (0, 0.0, None)
    assert described.scene == "wood"


def test_chunks_are_small_and_compressed(tmp_path):
    path = tmp_path / "run.mcap"
    write_session(path, made_frames(6000))
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {"zstd"}
    assert max(chunk.uncompressed_size for chunk in chunks) < 64 * 1024 + 2000
    assert len(chunks) > 3


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "the file is empty"),
        (b"time_s,position_x_mm\n0,1\n", "not an MCAP file"),
        (b"\x89MCAP", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "nothing in it can be read"),
    ],
)
@pytest.mark.parametrize("ask", [info, read_session])
def test_a_file_of_another_kind_is_refused(tmp_path, content, reason, ask):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    if content == b"\x89MCAP0\r\n" and ask is read_session:
        reason = "mmt session recover"
    with pytest.raises(InputError, match=reason):
        ask(path)


def test_missing_files_folders_and_suffixes_are_named(tmp_path):
    (tmp_path / "folder.mcap").mkdir()
    for name, said in (
        ("absent.mcap", r"absent\.mcap: No such file"),
        ("folder.mcap", "Is a directory"),
        ("sound.mp3", r"\.mp3 cannot be read.*\.csv.*\.mcap.*\.npz"),
    ):
        with pytest.raises(InputError, match=said):
            read_session(tmp_path / name)
    with pytest.raises(InputError, match=r"cannot write.*No such file"):
        write_session(tmp_path / "nowhere" / "run.mcap", made_frames(1))


def test_somebody_elses_mcap_is_refused_with_its_topics(tmp_path):
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("imu", "jsonschema", b"{}")
        channel = writer.register_channel("/imu", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(InputError, match=r"without the topic /frames.*its topics: /imu"):
        read_session(path)


@pytest.mark.parametrize("channels", [CHANNELS, ("position", "force"), ("force", "acceleration")])
def test_frames_of_two_recordings_in_one_file_are_not_mixed(tmp_path, channels):
    """As ``mcap merge`` joins two: the schema of one would give the other's numbers wrong names."""
    with (tmp_path / "merged.mcap").open("wb") as stream:
        merged = Writer(stream)
        merged.start()
        for name, of in (("a", CHANNELS), ("b", channels)):
            write_session(tmp_path / f"{name}.mcap", made_frames(40, of))
            with (tmp_path / f"{name}.mcap").open("rb") as one:
                reader = make_reader(one)
                for record in reader.iter_metadata():
                    merged.add_metadata(record.name, record.metadata)
                for schema, channel, message in reader.iter_messages(topics="/frames"):
                    number = merged.register_schema(schema.name, schema.encoding, schema.data)
                    number = merged.register_channel("/frames", channel.message_encoding, number)
                    merged.add_message(number, message.log_time, message.data, message.publish_time)
        merged.finish()
    for read in (read_session, info, open_windows):
        with pytest.raises(InputError, match="merged of several recordings"):
            read(tmp_path / "merged.mcap")


def test_a_newer_format_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt.session.mcap.writer.FORMAT_VERSION", 4)
    write_session(tmp_path / "new.mcap", made_frames(5, samples_per_frame=2))
    with pytest.raises(InputError, match=r"format version 4.*update mmt-haptics"):
        read_session(tmp_path / "new.mcap")


def test_frames_whose_fields_differ_in_length_are_refused():
    codec = FrameCodec(("force",))
    one_sequence_more = bytes([0x0A, 1, 7])  # field 1, packed, one byte long, the number 7
    with pytest.raises(InputError, match="do not fit their schema: cannot reshape"):
        codec.decode([codec.encode(made_frames(20, ("force",))) + one_sequence_more])
    with pytest.raises(InputError, match="do not fit their schema"):
        codec.decode([b"\xff\xff\xff"])


def test_info_says_what_a_file_holds(tmp_path):
    steps = np.ones(999, dtype=int)
    steps[[100, 500]] = [4, 11]
    frames = made_frames(1000, steps=steps)
    frames["time_ns"] = START_NS + frames["sequence"].astype(np.int64) * 1_001_000
    beside = {"scene": SCENE, "annotations": b"truth", "models": [(0.1, b"m")]}
    outputs = [OutputBlock(0.0, "model", np.zeros(20))] * 2
    path = tmp_path / "run.mcap"
    write_session(path, frames, events=[{"event": "mark"}] * 3, outputs=outputs, **beside)
    said = info(path)
    assert (said.frames, said.missing_frames) == (1000, 13)
    assert said.duration_s == pytest.approx((999 + 13) * 1.001e-3 + 1e-3)
    assert said.rate_hz == pytest.approx(1000 / 1.001)
    assert (said.scene, said.truth, said.complete) == ("wood", True, True)
    assert (said.models, said.events, said.outputs) == (1, 3, 40)
    assert said.size_bytes == path.stat().st_size


def test_info_says_what_was_no_measurement(tmp_path, monkeypatch):
    frames = made_frames(70_000)
    random = np.random.default_rng(1)
    frames["position_mm"], frames["force_n"] = 0.1 * np.arange(len(frames))[:, None], 1.0
    frames["acceleration_m_s2"] = random.standard_normal((len(frames), 3))
    frames["acceleration_m_s2"][59_900:60_200] = frames["acceleration_m_s2"][59_900]
    path = tmp_path / "run.mcap"
    write_session(path, frames, scene={"session": {"rate_hz": 1000}})
    found = info(path).faults
    assert found.held_s == pytest.approx(0.3, abs=0.005)  # across the parts it is filtered in
    assert found.sentence() == f"the accelerometer held one value for {found.held_s:.3g} s"
    write_session(path, frames[:3000], scene={"session": {"rate_hz": -1}})
    assert info(path).faults is None
    write_session(path, made_frames(3000, ("force",)))
    assert info(path).faults is None

    def lacking(package):
        raise InputError(f"{package} is not installed")

    write_session(path, frames[:3000])
    assert info(path).faults.sentence() == ""
    monkeypatch.setattr("mmt.session.info.require", lacking)
    assert info(path).faults is None


def test_neither_scipy_nor_numba_is_imported():
    program = (
        "import sys, mmt.session, mmt.session.recorder, mmt.session.replay,"
        " mmt.session.recover, mmt.session.info, mmt.session.export_files,"
        " mmt.session.importing.recording, mmt.session.importing.readers.array_file,"
        " mmt.session.importing.readers.text_file, mmt.session.importing.modelled_share\n"
        "heavy = {'scipy', 'numba', 'pandas', 'pyarrow', 'h5py', 'matplotlib'}\n"
        "sys.exit(', '.join(heavy & set(sys.modules)) or None)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_the_example_in_the_reference_reads_a_session(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "reference" / "session-file.md"
    example = page.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    frames = made_frames(1234)
    write_session(tmp_path / "run.mcap", frames)
    arguments = [sys.executable, "-c", example, tmp_path / "run.mcap"]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True, timeout=60)
    count, *mean_n = re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", done.stdout)
    assert count == "1234"
    expected_n = frames["force_n"].mean(axis=0)
    np.testing.assert_allclose(np.array(mean_n, dtype=float), expected_n, rtol=1e-4)


def test_a_file_says_what_it_is_and_who_wrote_it(tmp_path):
    path = tmp_path / "run.mcap"
    before = datetime.now(UTC) - timedelta(milliseconds=1)
    with path.open("wb") as stream:
        writer = SessionWriter(stream, CHANNELS, SCENE, "a1b2", utc_offset_ns=5_000)
        writer.write_frames(made_frames(3), 1_000)
        writer.write_model(b"first", 2_000)
        writer.write_model(b"second", 3_000)
        writer.write_annotations(b"truth", 4_000)
        writer.finish()
    with path.open("rb") as stream:
        reader = make_reader(stream)
        header = reader.get_header()
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        attached = [(a.name, a.media_type, a.log_time) for a in reader.iter_attachments()]
        topics = {channel.topic for channel in reader.get_summary().channels.values()}
        encodings = {c.message_encoding for c in reader.get_summary().channels.values()}
    assert (header.profile, header.library) == ("mmt", f"mmt-haptics {__version__}")
    assert json.loads(metadata["mmt.scene"]["json"]) == SCENE
    created = datetime.fromisoformat(metadata["mmt.session"].pop("created_utc"))
    assert before <= created <= datetime.now(UTC)
    told = {"format_version": "2", "rate_hz": "1000", "channels": "position,force,acceleration"}
    assert metadata["mmt.session"] == told | {"utc_offset_ns": "5000", "session_id": "a1b2"}
    models = [(f"model-000{n}.npz", "application/x-npz", 6_000 + n * 1_000) for n in (1, 2)]
    assert attached == [*models, ("annotations", "application/octet-stream", 9_000)]
    assert topics == {"/frames", "/plot"}
    assert encodings == {"protobuf"}


def test_the_package_passes_on_what_reads_and_writes_and_nothing_else():
    for name in mmt.session.__all__:
        assert getattr(mmt.session, name) is getattr(mmt, name, OutputBlock)
    with pytest.raises(AttributeError, match=r"mmt\.session' has no attribute 'nothing'"):
        _ = mmt.session.nothing
