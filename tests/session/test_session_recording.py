"""Recording never disturbs the caller and loses nothing on a clean close."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from session_samples import START_NS, made_frames
from waiting import until

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.session.files import export_session, read_session
from mmt.session.mcap.writer import SessionWriter
from mmt.session.recorder import McapRecorder
from mmt.session.recover import recover


@given(sizes=st.lists(st.integers(0, 70), max_size=40))
@settings(max_examples=15)
def test_frames_recorded_are_frames_read(tmp_path_factory, sizes):
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    frames = made_frames(sum(sizes))
    recorder = McapRecorder(path, channels=CHANNELS)
    first = 0
    for size in sizes:
        recorder.record_frames(frames[first : first + size])
        first += size
    recorder.close()
    assert (recorder.frames, recorder.dropped, recorder.error) == (len(frames), 0, None)
    recorder.record_frames(made_frames(5))  # too late
    assert (recorder.frames, recorder.dropped) == (len(frames), 5)
    np.testing.assert_array_equal(read_session(path).frames, frames)


def test_single_frames_become_blocks_of_twenty_with_their_arrival(tmp_path):
    path = tmp_path / "run.mcap"
    frames = made_frames(50)
    now = iter(range(999_000_000, 2_000_000_000, 1_000_000))  # the first is asked for at once
    before_ns = time.time_ns()
    with McapRecorder(path, channels=CHANNELS, clock=lambda: next(now)) as recorder:
        for index in range(50):
            recorder.record_frames(frames[index : index + 1])
    with path.open("rb") as stream:
        messages = [m for _, _, m in make_reader(stream).iter_messages(topics=["/frames"])]
    # A partial block may end early where the flush fell into this run.
    firsts = [message.sequence for message in messages]
    first_ns = messages[0].log_time
    assert before_ns <= first_ns <= time.time_ns()  # by the date, not since the machine started
    assert [m.log_time - first_ns for m in messages] == [f * 1_000_000 for f in firsts]
    assert [m.publish_time for m in messages] == [int(frames["time_ns"][f]) for f in firsts]
    assert max(np.diff([*firsts, 50])) <= 20


def test_frames_that_come_late_stand_apart_and_are_read_at_their_places(tmp_path):
    path = tmp_path / "run.mcap"
    frames = made_frames(100)
    with McapRecorder(path, channels=CHANNELS, clock=lambda: 5_000_000_000) as recorder:
        recorder.record_frames(frames[:30])
        recorder.record_frames(frames[70:])
        recorder.record_backfill(frames[50:70], 4_900_000_000)
        recorder.record_backfill(frames[30:50], 4_800_000_000)
    assert (recorder.frames, recorder.dropped) == (100, 0)
    with path.open("rb") as stream:
        messages = [m for _, _, m in make_reader(stream).iter_messages(topics=["/backfill"])]
    assert [m.sequence for m in messages] == [30, 50]
    assert messages[1].log_time - messages[0].log_time == 100_000_000
    data = path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[:-300])
    recover(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
    np.testing.assert_array_equal(read_session(tmp_path / "saved.mcap").frames, frames)


def test_everything_recorded_comes_back_at_its_time(tmp_path):
    path = tmp_path / "runs" / "deep" / "run.mcap"
    clock_ns, packers = [7_000_000_000], []

    def pack():
        packers.append(threading.current_thread())
        return b"npz"

    recorder = McapRecorder(
        path, channels=CHANNELS, scene={"session": {"name": "x"}}, clock=lambda: clock_ns[0]
    )
    recorder.attach_annotations(b"truth")
    recorder.record_frames(made_frames(100))
    clock_ns[0] += 250_000_000
    recorder.record_event({"event": "now"})
    recorder.record_event({"time_s": 0.125, "event": "then"})
    recorder.record_event({"time_s": float("nan"), "event": "unclear"})
    recorder.attach_model(pack, 0.5)
    for index in range(45):
        mode = "streamed" if index < 30 else "model"
        recorder.record_output(7_000_000_000 + index * 1_000_000, mode, [float(index)])
    recorder.close()
    session = read_session(path)
    assert session.annotations == b"truth"
    assert session.scene == {"session": {"name": "x"}}
    assert session.models == [(0.5, b"npz")]
    assert packers != [threading.main_thread()]  # it takes longer than a tick
    assert session.events[:2] == [
        {"time_s": 0.25, "event": "now"},
        {"time_s": 0.125, "event": "then"},
    ]
    samples = np.concatenate([output.vibration_m_s2 for output in session.outputs])
    np.testing.assert_array_equal(samples, np.arange(45.0))
    for output in session.outputs:
        assert output.time_s == pytest.approx(output.vibration_m_s2[0] / 1000)
        expected = "streamed" if output.vibration_m_s2[0] < 30 else "model"
        assert output.mode == expected


def test_a_slow_disk_costs_the_oldest_frames_and_counts_them(tmp_path, monkeypatch):
    blocked = threading.Event()
    write = SessionWriter.write_frames

    def slow(self, *block):
        blocked.wait(60.0)
        write(self, *block)

    monkeypatch.setattr(SessionWriter, "write_frames", slow)
    path = tmp_path / "run.mcap"
    frames = made_frames(3000)
    recorder = McapRecorder(path, channels=CHANNELS, queue_limit=500)
    for index in range(0, 2000, 2):
        recorder.record_frames(frames[index : index + 2])
    recorder.attach_model(lambda: b"never dropped", 0.0)
    assert recorder.dropped >= 800
    blocked.set()
    recorder.close()
    session = read_session(path)
    assert recorder.dropped + recorder.frames == 2000
    assert recorder.dropped >= 800
    assert [data for _, data in session.models] == [b"never dropped"]
    # The newest are kept, in order.
    assert session.frames["sequence"][-1] == 1999
    assert len(session.frames) == recorder.frames
    assert np.all(np.diff(session.frames["sequence"].astype(int)) > 0)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_disk_that_is_full_is_reported_once_and_stops_nobody(tmp_path):
    (tmp_path / "run.mcap").symlink_to("/dev/full")
    reasons, frames = [], made_frames(100)
    recorder = McapRecorder(tmp_path / "run.mcap", channels=CHANNELS, on_error=reasons.append)
    recorder.record_frames(frames)
    until(lambda: recorder.error)
    recorder.record_frames(frames)
    recorder.record_event({"event": "late"})
    recorder.record_output(1, "model", [1.0])
    recorder.close()
    recorder.close()
    assert reasons == [recorder.error] == ["No space left on device"]
    assert (recorder.frames, recorder.dropped) == (0, 200)
    with McapRecorder(tmp_path / "run.mcap", channels=CHANNELS) as alone:  # which tells nobody
        alone.record_frames(frames)
    assert (alone.error, alone.frames, alone.dropped) == ("No space left on device", 0, 100)


FILLING = f"""
import resource, sys, time, pathlib
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
sys.path.insert(0, sys.argv[2])
from session_samples import made_frames
from mmt.session.recorder import McapRecorder
frames = made_frames(6000)
recorder = McapRecorder(pathlib.Path(sys.argv[1]), channels={CHANNELS})
for first in range(0, 6000, 500):
    recorder.record_frames(frames[first:first + 500]); time.sleep(0.15)
recorder.close()
print(recorder.error, recorder.frames, recorder.dropped, sep="|")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files")
def test_a_disk_that_fills_up_leaves_a_file_to_recover(tmp_path):
    path = tmp_path / "run.mcap"
    arguments = [sys.executable, "-c", FILLING, path, Path(__file__).parent]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True, timeout=60)
    error, frames, dropped = done.stdout.strip().split("|")
    assert error == "File too large"
    assert 500 <= int(frames) < 6000
    assert int(frames) + int(dropped) == 6000
    saved = recover(path, tmp_path / "saved.mcap")
    assert saved.frames >= int(frames)
    expected = made_frames(6000)[: saved.frames]
    np.testing.assert_array_equal(read_session(saved.path).frames, expected)


def test_what_cannot_be_recorded_is_refused_at_once(tmp_path):
    with pytest.raises(InputError, match="Is a directory"):
        McapRecorder(tmp_path, channels=CHANNELS)
    with McapRecorder(tmp_path / "run.mcap", channels=("force",)) as recorder:
        with pytest.raises(InputError, match="expected"):
            recorder.record_frames(made_frames(3))
        recorder.record_frames(made_frames(3, ("force",)))
    assert len(read_session(tmp_path / "run.mcap").frames) == 3


def test_a_pause_of_the_stream_leaves_no_frame_behind(tmp_path):
    """Fewer frames than a block are in the file although the recording goes on."""
    path = tmp_path / "run.mcap"
    with McapRecorder(path, channels=CHANNELS) as recorder:
        recorder.record_frames(made_frames(7))
        until(lambda: recorder.frames >= 7)
        saved = recover(path, tmp_path / "saved.mcap")
    assert saved.frames == 7
    assert read_session(saved.path).frames["time_ns"][0] >= START_NS


def test_two_recorders_never_write_the_same_file(tmp_path):
    path = tmp_path / "run.mcap"
    with McapRecorder(path, channels=CHANNELS) as first:
        first.record_frames(made_frames(100))
        with pytest.raises(InputError, match=r"run\.mcap: another leader records into it: end"):
            McapRecorder(path, channels=CHANNELS)
    assert len(read_session(path).frames) == 100


def test_a_recorder_that_was_killed_leaves_its_file_free(tmp_path):
    path = tmp_path / "run.mcap"
    program = (
        "import os, pathlib, sys\n"
        "from mmt.session.recorder import McapRecorder\n"
        "McapRecorder(pathlib.Path(sys.argv[1]), channels=('force',))\n"
        "os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", program, path], check=False, timeout=60)
    with McapRecorder(path, channels=CHANNELS, existing="replace") as recorder:
        recorder.record_frames(made_frames(20))
    assert len(read_session(path).frames) == 20


def test_where_the_system_has_no_locks_recording_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt.session.recorder.fcntl", None)
    with McapRecorder(tmp_path / "run.mcap", channels=CHANNELS) as recorder:
        recorder.record_frames(made_frames(20))
    assert len(read_session(tmp_path / "run.mcap").frames) == 20


@given(
    offset_ns=st.one_of(st.just(0), st.integers(-(10**15), 0), st.integers(10**10, 10**15)),
    drift_ppm=st.floats(-100.0, 100.0),
    late_ns=st.integers(1, 10**9),
    jumps=st.booleans(),
)
@settings(max_examples=30)
def test_a_session_began_when_its_first_frame_was_measured(
    tmp_path_factory, offset_ns, drift_ppm, late_ns, jumps
):
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    frames = made_frames(50)
    measured_ns = time.monotonic_ns() - late_ns  # by the leader's clock
    offset_ns = max(offset_ns, -measured_ns)  # the follower's counts from its machine's start
    frames["time_ns"] += measured_ns + offset_ns - frames["time_ns"][0]
    arrived_ns, later_ns = measured_ns + late_ns, 10**9
    compared = {
        "event": "clocks compared",
        "clock_time_ns": measured_ns + later_ns,
        "clock_offset_ns": offset_ns + round(drift_ppm * 1e-6 * later_ns),
        "clock_drift_ppm": drift_ppm,
        "clock_uncertainty_ns": 1000,
    }
    with McapRecorder(path, channels=CHANNELS, clock=lambda: arrived_ns) as recorder:
        recorder.record_frames(frames)
        if jumps:
            recorder.record_event({"event": "clock set", "clock_step_ns": 5})
        recorder.record_event(compared)
    session = read_session(path)
    with path.open("rb") as stream:
        first = next(make_reader(stream).iter_messages(topics=["/frames"]))[2]
    before_arrival_ns = 0 if jumps else late_ns
    assert abs(first.log_time - session.began_utc_ns - before_arrival_ns) <= 100
    copy = path.with_name("copy.mcap")
    export_session(session, copy)
    assert abs(read_session(copy).began_utc_ns - session.began_utc_ns) <= 1
