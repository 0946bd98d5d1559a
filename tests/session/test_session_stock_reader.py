"""Recordings as the MCAP library reads them, without anything of this package."""

import json
import time

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from session_samples import made_frames
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.session.data import OutputBlock
from mmt.session.files import export_session, read_session, write_session
from mmt.session.mcap.messages import FRAME_BLOCK, FrameCodec, frame_schema
from mmt.session.recorder import McapRecorder

EVENT = {"time_s": 0.25, "event": "it begins", "kind": "mark", "more": [1, 2]}


def decoded(path):
    """Return every message as (topic, schema's name, message, decoded), all by one decoder."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, schema.name, message, content)
            for schema, channel, message, content in reader.iter_decoded_messages()
        ]


def recorded(path, *, scalars):
    with McapRecorder(path, channels=CHANNELS, session_id="a1b2", scalars=scalars) as recorder:
        recorder.record_frames(made_frames(40))
        recorder.record_backfill(made_frames(40), time.monotonic_ns())
        recorder.record_output(time.monotonic_ns(), "streamed", np.arange(40.0))
        recorder.record_event(EVENT)
    return path


def test_one_decoder_reads_every_topic_by_the_schemas_in_the_file(tmp_path):
    before_ns = time.time_ns()
    messages = decoded(recorded(tmp_path / "run.mcap", scalars=True))
    kinds = {topic: name for topic, name, _, _ in messages}
    assert kinds == {
        "/frames": "mmt.FrameBlock",
        "/backfill": "mmt.FrameBlock",
        "/plot": "mmt.PlotSample",
        "/output": "mmt.OutputBlock",
        "/events": "mmt.Event",
        "/log": "foxglove.Log",
        "/scalars": "mmt.Scalars",
        "/vibration": "mmt.VibrationSample",
    }
    for _, _, message, _ in messages:
        assert before_ns <= message.log_time <= time.time_ns() + 1_000_000_000


def test_blocks_and_plots_hold_the_frames(tmp_path):
    frames = made_frames(1010)
    output = OutputBlock(0.5, "model", np.array([1.5, -2.5]))
    write_session(tmp_path / "a.mcap", frames, events=[EVENT], outputs=[output])
    messages = decoded(tmp_path / "a.mcap")
    blocks = [content for topic, _, _, content in messages if topic == "/frames"]
    assert [len(block.sequence) for block in blocks] == [20] * 50 + [10]
    for field in map(FIELD_OF_CHANNEL.get, CHANNELS):
        flat = [value for block in blocks for value in getattr(block, field)]
        np.testing.assert_array_equal(np.reshape(flat, (-1, 3)), frames[field])
    assert [t for block in blocks for t in block.time_ns] == frames["time_ns"].tolist()
    numbers = [message.sequence for topic, _, message, _ in messages if topic == "/frames"]
    assert numbers == frames["sequence"][::20].tolist()
    published = {topic: message.publish_time for topic, _, message, _ in reversed(messages)}
    assert published["/frames"] == frames["time_ns"][0]
    assert published["/events"] == frames["time_ns"][0] + 250_000_000
    plot = next(content for topic, _, _, content in messages if topic == "/plot")
    first = frames[:20]
    assert plot.position_y_mm == pytest.approx(first["position_mm"][:, 1].mean(), rel=1e-6)
    assert plot.force_z_n == pytest.approx(first["force_n"][:, 2].mean(), rel=1e-6)
    vibration = first["acceleration_m_s2"] - first["acceleration_m_s2"].mean(axis=0)
    rms = np.sqrt((vibration**2).sum(axis=1).mean())
    assert plot.vibration_rms_m_s2 == pytest.approx(rms, rel=1e-6)
    (written,) = [content for topic, _, _, content in messages if topic == "/output"]
    assert (written.mode, list(written.vibration_m_s2)) == ("model", [1.5, -2.5])
    assert written.time_ns == frames["time_ns"][0] + 500_000_000


def test_only_the_channels_present_are_in_the_schema(tmp_path):
    write_session(tmp_path / "a.mcap", made_frames(30, ("force",)))
    fields = {
        name: [field.name for field in content.DESCRIPTOR.fields]
        for _, name, _, content in decoded(tmp_path / "a.mcap")
    }
    assert fields == {
        "mmt.FrameBlock": ["sequence", "time_ns", "force_n"],
        "mmt.PlotSample": ["time_ns", "force_x_n", "force_y_n", "force_z_n"],
    }


def test_events_have_fields_and_a_line_in_the_log(tmp_path):
    messages = decoded(recorded(tmp_path / "run.mcap", scalars=False))
    (event,) = [content for topic, _, _, content in messages if topic == "/events"]
    assert (event.time_s, event.event, event.kind) == (0.25, "it begins", "mark")
    assert json.loads(event.json) == EVENT
    ((message, line),) = [(m, c) for topic, _, m, c in messages if topic == "/log"]
    assert (line.message, line.level, line.name) == ("it begins", 2, "mmt")
    assert line.timestamp.seconds * 10**9 + line.timestamp.nanos == message.log_time
    assert read_session(tmp_path / "run.mcap").events == [EVENT]


def test_scalars_are_the_frames_and_samples_one_by_one(tmp_path):
    frames = made_frames(50)
    output = OutputBlock(0.01, "model", np.arange(30.0))
    write_session(tmp_path / "a.mcap", frames, outputs=[output])
    arguments = ["session", "export", str(tmp_path / "a.mcap")]
    done = CliRunner().invoke(app, [*arguments, str(tmp_path / "b.mcap"), "--scalars"])
    assert done.exit_code == 0
    messages = decoded(tmp_path / "b.mcap")
    scalars = [(m, c) for topic, _, m, c in messages if topic == "/scalars"]
    assert [m.sequence for m, _ in scalars] == frames["sequence"].tolist()
    assert [c.time_ns for _, c in scalars] == frames["time_ns"].tolist()
    assert np.all(np.diff([m.log_time for m, _ in scalars]) == np.diff(frames["time_ns"]))
    found = [[c.force_x_n, c.force_y_n, c.force_z_n] for _, c in scalars]
    np.testing.assert_array_equal(np.float32(found), frames["force_n"])
    vibration = [c.vibration_m_s2 for topic, _, _, c in messages if topic == "/vibration"]
    np.testing.assert_array_equal(vibration, output.vibration_m_s2)
    assert not {"/scalars", "/vibration"} & {topic for topic, *_ in decoded(tmp_path / "a.mcap")}
    refused = CliRunner().invoke(app, [*arguments, str(tmp_path / "c.csv"), "--scalars"])
    assert "leave --scalars out" in str(refused.exception)


def test_a_converted_recording_keeps_its_date_and_its_session(tmp_path):
    recorded(tmp_path / "run.mcap", scalars=False)
    time.sleep(0.05)
    session = read_session(tmp_path / "run.mcap")
    write_session(tmp_path / "made.mcap", session.frames)
    export_session(session, tmp_path / "copy.mcap")
    names = ("run", "copy", "made")
    first = {name: decoded(tmp_path / f"{name}.mcap")[0][2].log_time for name in names}
    assert first["copy"] == first["run"] < first["made"] <= time.time_ns()
    ids = [read_session(tmp_path / f"{name}.mcap").session_id for name in names]
    assert ids == ["a1b2", "a1b2", None]


def test_a_file_of_version_1_is_read(tmp_path):
    """Its events are JSON, and its times are of a clock without a date."""
    frames = made_frames(20)
    with (tmp_path / "old.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="mmt")
        writer.add_metadata("mmt.session", {"format_version": "1", "rate_hz": "1000"})
        schema = writer.register_schema(FRAME_BLOCK, "protobuf", frame_schema(CHANNELS))
        events = writer.register_schema("mmt.Event", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/frames", "protobuf", schema)
        data = FrameCodec(CHANNELS).encode(frames)
        writer.add_message(channel, 5_000_000_000, data, int(frames["time_ns"][0]))
        channel = writer.register_channel("/events", "json", events)
        writer.add_message(channel, 5_500_000_000, b'{"event": "mark"}', 5_500_000_000)
        writer.finish()
    session = read_session(tmp_path / "old.mcap")
    np.testing.assert_array_equal(session.frames, frames)
    assert session.events == [{"time_s": 0.5, "event": "mark"}]
    assert session.began_utc_ns is None
