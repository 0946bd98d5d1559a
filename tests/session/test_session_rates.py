"""Sessions whose acceleration has several samples a frame: recorded, read, exported, imported."""

import time

import numpy as np
import pytest
from command_runs import output_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, acceleration_samples
from mmt.session.data import (
    FRAME_PERIOD_NS,
    FRAME_PERIOD_S,
    OutputBlock,
    RecordedSession,
    sample_times,
)
from mmt.session.files import export_session, import_session, read_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.info import info
from mmt.session.recorder import McapRecorder
from mmt.session.recover import recover
from mmt.session.stream import blocks_of, open_recording, open_windows


def recorded(path, samples_per_frame, **options):
    """Record 90 frames, ten of them late, and two seconds of output; return the frames."""
    frames = made_frames(90, samples_per_frame=samples_per_frame)
    late = (frames["sequence"] >= 40) & (frames["sequence"] < 50)
    with McapRecorder(
        path, channels=CHANNELS, samples_per_frame=samples_per_frame, **options
    ) as recorder:
        for block in np.array_split(frames[~late], 20):
            recorder.record_frames(block)
        recorder.record_backfill(frames[late], time.monotonic_ns())
        for tick in range(60):
            samples = np.arange(tick * samples_per_frame, (tick + 1) * samples_per_frame)
            recorder.record_output(10**9 + tick * 10**6, "streamed", samples)
    return frames


def opened(path):
    """Return the metadata of the session and of each topic, and the decoded messages by topic."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        about = {record.name: record.metadata for record in reader.iter_metadata()}
        topics, messages = {}, {}
        for _, channel, message, content in reader.iter_decoded_messages():
            topics[channel.topic] = channel.metadata
            messages.setdefault(channel.topic, []).append((message.log_time, content))
    return about["mmt.session"], topics, messages


@pytest.mark.parametrize("samples_per_frame", [1, 3, 10])
def test_a_recording_says_its_rate_and_is_read_by_all_ways(tmp_path, samples_per_frame):
    path = tmp_path / "run.mcap"
    frames = recorded(path, samples_per_frame)
    session = read_session(path)
    np.testing.assert_array_equal(session.frames, frames)
    assert {output.rate_hz for output in session.outputs} == {1000.0 * samples_per_frame}
    assert all(len(o.vibration_m_s2) == 20 * samples_per_frame for o in session.outputs)
    assert session.outputs[-1].end_s - session.outputs[0].time_s == pytest.approx(0.06)
    windows = open_windows(path)
    assert windows.samples_per_frame == samples_per_frame
    np.testing.assert_array_equal(windows.window(-1.0, 1e9).frames, frames)
    assert windows.window(0.0, 0.0).frames.dtype == frames.dtype
    recover(path, tmp_path / "again.mcap")
    np.testing.assert_array_equal(read_session(tmp_path / "again.mcap").frames, frames)
    export_session(session, tmp_path / "whole.mcap")
    stream = open_recording(tmp_path / "whole.mcap")
    assert stream.samples_per_frame == samples_per_frame
    np.testing.assert_array_equal(np.concatenate(list(blocks_of(stream))), frames)


@pytest.mark.parametrize("samples_per_frame", [1, 6])
def test_info_says_the_rates(tmp_path, samples_per_frame):
    frames = made_frames(50, ("acceleration",), samples_per_frame=samples_per_frame)
    output = OutputBlock(0.0, "streamed", np.zeros(9), samples_per_frame)
    export_session(RecordedSession(frames, outputs=[output]), tmp_path / "run.mcap")
    said = info(tmp_path / "run.mcap")
    assert said.acceleration_rate_hz == pytest.approx(samples_per_frame * said.rate_hz)
    assert said.output_rate_hz == 1000.0 * samples_per_frame
    export_session(RecordedSession(made_frames(50, ("force",))), tmp_path / "still.mcap")
    still = info(tmp_path / "still.mcap")
    anew = made_frames(9, ("force",))  # the follower restarted
    anew["time_ns"] += 3_000_000_000
    twice = RecordedSession(np.concatenate([made_frames(50, ("force",)), anew]))
    export_session(twice, tmp_path / "twice.mcap")
    assert info(tmp_path / "twice.mcap").rate_hz == pytest.approx(1000, rel=1e-3)
    assert (still.acceleration_rate_hz, still.output_rate_hz) == (None, None)


@given(st.lists(st.integers(0, 3_000_000), max_size=20), st.integers(1, 10))
def test_samples_have_the_same_times_by_whole_numbers_and_by_others(steps_ns, samples_per_frame):
    time_ns = np.cumsum(np.array([10**9, *steps_ns]))
    whole_ns = sample_times(time_ns, samples_per_frame, FRAME_PERIOD_NS)
    time_s = sample_times(time_ns / 1e9, samples_per_frame, FRAME_PERIOD_S)
    assert whole_ns.dtype == np.int64
    np.testing.assert_allclose(1e9 * time_s, whole_ns, atol=1.01)
    np.testing.assert_array_equal(whole_ns[samples_per_frame - 1 :: samples_per_frame], time_ns)
    assert np.diff(whole_ns).min(initial=0) >= 0
    assert np.diff(whole_ns).max(initial=0) <= 3_000_000


def test_a_program_that_knows_no_rates_refuses_the_file(tmp_path, monkeypatch):
    recorded(tmp_path / "new.mcap", 5)
    recorded(tmp_path / "as-ever.mcap", 1)
    monkeypatch.setattr("mmt.session.mcap.reader.FORMAT_VERSION", 2)
    with pytest.raises(InputError, match="format version 3, this program reads up to 2"):
        read_session(tmp_path / "new.mcap")
    assert len(read_session(tmp_path / "as-ever.mcap").frames) == 90


def test_standard_tools_decode_the_samples_in_their_order(tmp_path):
    frames = recorded(tmp_path / "run.mcap", 4, scalars=True)
    about, topics, messages = opened(tmp_path / "run.mcap")
    assert (about["format_version"], about["acceleration_rate_hz"]) == ("3", "4000")
    for topic in ("/frames", "/backfill", "/output"):
        assert topics[topic] == {"acceleration_rate_hz": "4000"}
    live = [content for _, content in messages["/frames"]]
    sequence = np.concatenate([content.sequence for content in live])
    samples = np.concatenate([content.acceleration_m_s2 for content in live])
    expected = frames[np.isin(frames["sequence"], sequence)]["acceleration_m_s2"]
    np.testing.assert_array_equal(samples.reshape(-1, 4, 3), expected)
    plain = {content.time_ns: content for _, content in messages["/acceleration"]}
    assert len(plain) == 4 * len(frames)
    for back in range(4):
        sample = plain[int(frames["time_ns"][50]) - back * 250_000]
        vector = frames["acceleration_m_s2"][50, 3 - back]
        assert sample.acceleration_y_m_s2 == vector[1]
    assert sample.DESCRIPTOR.full_name == "mmt.AccelerationSample"
    assert not hasattr(messages["/scalars"][0][1], "acceleration_x_m_s2")
    times_ns = [content.time_ns for _, content in messages["/vibration"]]
    np.testing.assert_array_equal(np.diff(times_ns), 250_000)


def test_a_file_at_1_khz_is_what_it_was(tmp_path):
    recorded(tmp_path / "run.mcap", 1, scalars=True)
    about, topics, messages = opened(tmp_path / "run.mcap")
    assert about["format_version"] == "2"
    assert "acceleration_rate_hz" not in about
    assert not any(topics.values())
    assert "/acceleration" not in messages
    assert hasattr(messages["/scalars"][0][1], "acceleration_x_m_s2")


def test_a_rate_that_there_is_not_and_two_rates_are_refused(tmp_path):
    recorded(tmp_path / "run.mcap", 11)
    with pytest.raises(InputError, match="acceleration_rate_hz of /frames is '11000', it must be"):
        read_session(tmp_path / "run.mcap")
    path, slow = tmp_path / "a.mcap", OutputBlock(0.0, "streamed", np.zeros(3))
    for session, said in (
        (RecordedSession(made_frames(5, samples_per_frame=12)),
         "12 samples of acceleration in a frame, a file holds 1"),
        (RecordedSession(made_frames(5, samples_per_frame=2), outputs=[slow]),
         "at 1000 and 2000 Hz; a file holds one rate"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            export_session(session, path)
        assert not path.exists()
    fast = OutputBlock(0.0, "streamed", np.zeros(8), 4)
    export_session(RecordedSession(made_frames(5, ("force",)), outputs=[fast]), path)
    assert read_session(path).outputs[0].rate_hz == 4000.0
    assert open_windows(path).samples_per_frame == 4


def test_columns_are_a_table_and_one_line_makes_them_a_signal():
    session = RecordedSession(made_frames(7, samples_per_frame=3))
    columns = session.columns()
    assert {len(values) for values in columns.values()} == {7}
    along_x = [values for name, values in columns.items() if name.startswith("acceleration_x")]
    signal = np.column_stack(along_x).ravel()
    np.testing.assert_array_equal(signal, session.vectors()["acceleration_m_s2"][:, 0])
    times_s = session.acceleration_time_s
    np.testing.assert_array_equal(times_s[2::3], session.time_s)
    assert np.all(np.diff(times_s) > 0)


def made_source(path, rate_hz, frequency_hz, begin_s=0.0, duration_s=1.5):
    """Save a tone of acceleration at a rate, beside a force at 1 kHz."""
    time_s = np.arange(0.0, duration_s, 1e-3)
    fast_s = begin_s + np.arange(round(duration_s * rate_hz)) / rate_hz
    tone = np.sin(2 * np.pi * frequency_hz * fast_s + 0.4)
    np.savez(
        path,
        time_s=time_s,
        force_n=np.column_stack([0 * time_s, 0 * time_s, 1 + 0 * time_s]),
        acceleration_time_s=fast_s,
        acceleration_m_s2=np.column_stack([tone, -tone, 2 * tone]),
    )
    return path


def inner(session):
    """Return the times and the samples of acceleration, without what is near the ends."""
    time_s = session.acceleration_time_s + 1e-9 * int(session.frames["time_ns"][0])
    kept = (time_s > 0.1) & (time_s < 1.4)
    return time_s[kept], acceleration_samples(session.frames)[kept].astype(float)


RATIOS = st.floats(1.0, 12.0)


@settings(max_examples=20)
@given(st.integers(1, 10), RATIOS, st.floats(0.02, 0.8), st.floats(0.0, 1e-3))
def test_what_is_kept_passes_without_delay(tmp_path_factory, several, ratio, share, begin_s):
    frequency_hz = 500.0 * several * share
    path = tmp_path_factory.mktemp("tone") / "tone.npz"
    made_source(path, 1000.0 * several * ratio, frequency_hz, begin_s)
    session = import_session(path, acceleration_rate_hz=1000 * several)
    assert session.samples_per_frame == several
    time_s, samples = inner(session)
    expected = np.sin(2 * np.pi * frequency_hz * time_s + 0.4)[:, None] * [1, -1, 2]
    np.testing.assert_allclose(samples, expected, atol=2 * (1 - 10 ** (-0.1 / 20)))


@settings(max_examples=20)
@given(st.integers(1, 10), st.floats(1.05, 12.0), st.floats(0.0, 0.98), st.floats(0.0, 1e-3))
def test_what_is_not_kept_is_60_db_down(tmp_path_factory, several, ratio, share, begin_s):
    kept_hz, source_hz = 500.0 * several, 500.0 * several * ratio
    frequency_hz = kept_hz + share * (source_hz - kept_hz)
    path = tmp_path_factory.mktemp("tone") / "tone.npz"
    made_source(path, 2 * source_hz, frequency_hz, begin_s)
    _, samples = inner(import_session(path, acceleration_rate_hz=1000 * several))
    assert np.std(samples[:, 0]) * np.sqrt(2) < 1e-3


def test_an_exported_file_keeps_its_rate_until_another_is_asked_for(tmp_path):
    frames = made_frames(2000, samples_per_frame=5)
    for kind in ("npz", "csv", "parquet"):
        export_session(RecordedSession(frames), tmp_path / f"a.{kind}")
        for asked, expected in ((None, 5), (5000, 5), (1000, 1), (10_000, 10)):
            session = import_session(tmp_path / f"a.{kind}", acceleration_rate_hz=asked)
            assert session.samples_per_frame == expected
            assert len(session.frames) == pytest.approx(2000, abs=2)


def test_several_samples_a_row_are_proposed_as_they_stand(tmp_path):
    path = tmp_path / "a.csv"
    export_session(RecordedSession(made_frames(300, samples_per_frame=4)), path)
    proposal = propose(path)
    assert (proposal.lacking, proposal.options.columns) == ((), {})
    assert try_proposal(path, proposal)[2] is None
    ragged = path.read_text().replace("acceleration_y_m_s2[3]", "other", 1)
    (tmp_path / "b.csv").write_text(ragged)
    with pytest.raises(InputError, match="300 x 3, 300 x 4"):
        import_session(tmp_path / "b.csv")


def test_the_command_keeps_the_rate_that_is_asked_for(tmp_path):
    options = ImportOptions(acceleration_rate_hz=4000)
    path, out = made_source(tmp_path / "a.npz", 8000.0, 900.0), tmp_path / "a.mcap"
    assert "kept to 2000 Hz" in output_of("session", "import", path, out, *options.arguments())
    assert read_session(out).samples_per_frame == 4
