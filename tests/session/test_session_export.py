"""Exports hold what the session held, as the tools of each kind read it, and come back whole."""

import csv
import json
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.io import wavfile
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, frame_dtype
from mmt.session.data import RecordedSession
from mmt.session.export_files import read_comment
from mmt.session.files import export_session, import_session, read_session

pytestmark = pytest.mark.usefixtures("read_here")

SCENE = {"session": {"name": "wäre"}}
EVENTS = [{"time_s": 0.5, "event": "mark", "value": float("nan")}]


@pytest.fixture
def session():
    frames = made_frames(300, steps=np.where(np.arange(299) == 10, 6, 1))
    return RecordedSession(frames, SCENE, b"\x00truth", [(0.5, b"npz")], EVENTS)


def test_text_has_a_header_with_units_and_a_row_a_frame(tmp_path, session):
    path = tmp_path / "run.csv"
    export_session(session, path)
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == [
        *("sequence", "time_s", "position_x_mm", "position_y_mm", "position_z_mm"),
        *("force_x_n", "force_y_n", "force_z_n"),
        *("acceleration_x_m_s2", "acceleration_y_m_s2", "acceleration_z_m_s2"),
    ]
    assert len(rows) == 300
    assert (rows[0]["time_s"], rows[11]["sequence"]) == ("0.000000000", "16")
    force = np.array([row["force_y_n"] for row in rows], dtype=np.float32)
    np.testing.assert_array_equal(force, session.frames["force_n"][:, 1])


def test_parquet_has_flat_columns_and_the_scene(tmp_path, session):
    pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'export'")
    path = tmp_path / "run.parquet"
    export_session(session, path)
    table = pq.read_table(path)
    frames = session.frames
    np.testing.assert_array_equal(table["sequence"].to_numpy(), frames["sequence"])
    np.testing.assert_array_equal(table["time_ns"].to_numpy(), frames["time_ns"])
    np.testing.assert_array_equal(table["time_s"].to_numpy(), session.time_s)
    np.testing.assert_array_equal(
        table["acceleration_z_m_s2"].to_numpy(), frames["acceleration_m_s2"][:, 2]
    )
    assert json.loads(table.schema.metadata[b"mmt.scene"]) == SCENE
    assert table.schema.metadata[b"mmt.annotations"] == b"\x00truth"
    assert json.loads(table.schema.metadata[b"mmt.events"])[0]["value"] is None


@pytest.mark.parametrize("suffix", [".h5", ".hdf5", ".H5"])
def test_hdf5_has_the_fields_and_everything_else(tmp_path, session, suffix):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'export'")
    path = tmp_path / f"run{suffix}"
    export_session(session, path)
    with h5py.File(path) as file:
        for name in session.frames.dtype.names:
            np.testing.assert_array_equal(file[name], session.frames[name])
        np.testing.assert_array_equal(file["time_s"], session.time_s)
        texts = [file[name].dtype for name in ("scene", "events")]
        assert [kind.kind for kind in texts] == ["S", "S"]  # Octave stops at those of any length
        assert file["acceleration_m_s2"].attrs["units"] == "m/s2"
        assert file.attrs["rate_hz"] == 1000
        assert json.loads(file["scene"].asstr()[()]) == SCENE
        assert json.loads(file["events"].asstr()[()])[0]["event"] == "mark"
        assert file["annotations"][:].tobytes() == b"\x00truth"
        assert file["models/0001"][:].tobytes() == b"npz"
        assert file["models/0001"].attrs["time_s"] == 0.5


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".h5", ".mcap", ""])
@pytest.mark.parametrize("channels", [("position",), ("force", "acceleration")])
@pytest.mark.parametrize("count", [0, 1])
def test_small_and_partial_sessions_are_exported(tmp_path, suffix, channels, count):
    path = tmp_path / f"run{suffix}"
    export_session(RecordedSession(made_frames(count, channels)), path)
    assert path.stat().st_size > 0
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("suffix", "package"), [(".parquet", "pyarrow"), (".h5", "h5py")])
def test_a_missing_package_is_named_with_the_command(
    tmp_path, session, monkeypatch, suffix, package
):
    for name in [m for m in sys.modules if m.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"{package}, which is not .*\[export\]"):
        export_session(session, tmp_path / f"run{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".h5", ".mcap"])
def test_a_folder_that_is_not_there_is_named(tmp_path, session, suffix):
    with pytest.raises(InputError, match=r"cannot write .*nowhere"):
        export_session(session, tmp_path / "nowhere" / f"run{suffix}")


def test_unknown_suffixes_are_refused(tmp_path, session):
    for name, said in (("run.bag", r"\.bag cannot be written.*\.parquet"),
                       ("run.2", "or none for a ROS 2 bag")):  # fmt: skip
        with pytest.raises(InputError, match=said):
            export_session(session, tmp_path / name)


MARKED = [{"time_s": 0.5, "event": "mark"}]
SUFFIXES = (".mcap", ".npz", ".csv", ".parquet", ".h5", ".mat", ".wav", "")


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(
    channels=st.sets(st.sampled_from(ALL_CHANNELS), min_size=1),
    several=st.integers(1, 10),
    steps=st.lists(st.sampled_from([1, 1, 1, 4, 30]), min_size=1, max_size=50),
    jitter_ns=st.sampled_from([1, 400_000]),
    began_ns=st.integers(10**18, 2 * 10**18),
)
@settings(max_examples=12, phases=[Phase.generate])
def test_arrays_rate_and_date_survive(suffix, channels, several, steps, jitter_ns, began_ns):
    """Jittered times and missing frames included: nothing is resampled twice."""
    sound = suffix == ".wav"  # it has no times of its own
    channels = {*channels, "acceleration"} if sound else channels
    channels = tuple(c for c in ALL_CHANNELS if c in channels)
    several = several if "acceleration" in channels else 1
    steps = [1] * len(steps) if sound else steps
    frames = made_frames(len(steps) + 1, channels, steps=steps, samples_per_frame=several)
    frames["time_ns"] += np.random.default_rng(1).integers(0, jitter_ns, len(frames))
    session = RecordedSession(frames, began_utc_ns=began_ns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{suffix}"
        export_session(session, path)
        back = read_session(path)
    assert back.frames.dtype == frame_dtype(["acceleration"] if sound else channels, several)
    for name in back.frames.dtype.names:
        if name not in ("sequence", "time_ns"):
            np.testing.assert_array_equal(back.frames[name], frames[name])
    np.testing.assert_array_equal(np.diff(back.frames["sequence"]), steps)
    off_ns = np.diff(back.frames["time_ns"]) - np.diff(frames["time_ns"])
    assert np.abs(off_ns).max() <= (jitter_ns + 20_000 if sound else 0)
    # text is read in double precision
    assert abs(back.began_utc_ns - began_ns) <= (256 if suffix == ".csv" else 0)


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".h5", ".mat"])
def test_what_belongs_to_the_frames_survives(tmp_path, suffix):
    session = RecordedSession(made_frames(60), SCENE, b"\x00truth", (), MARKED)
    export_session(session, tmp_path / f"run{suffix}")
    back = import_session(tmp_path / f"run{suffix}")
    assert (back.scene, back.annotations, back.events) == (SCENE, b"\x00truth", MARKED)
    assert back.began_utc_ns is None


def test_a_follower_that_began_anew_and_a_value_that_is_none_survive_in_parquet(tmp_path):
    frames = made_frames(300)
    frames["sequence"][101:] -= 60
    frames["time_ns"][101:] -= 80_000_000
    frames["force_n"][7, 1] = np.nan
    export_session(RecordedSession(frames), tmp_path / "run.parquet")
    assert read_session(tmp_path / "run.parquet").frames.tobytes() == frames.tobytes()


@pytest.mark.parametrize("text", [b"recorded by someone", b"[1]", b"[" * 100_000])
def test_a_comment_of_another_program_says_nothing(tmp_path, text):
    path = tmp_path / "a.wav"
    wavfile.write(path, 1000, np.zeros(9, np.int16))
    comment = b"INFOICMT" + struct.pack("<I", len(text)) + text
    path.write_bytes(path.read_bytes() + b"LIST" + struct.pack("<I", len(comment)) + comment)
    assert read_comment(path) == {}


def test_a_sound_holds_what_is_missing_and_other_programs_may_cut_and_round_it(tmp_path):
    steps = np.ones(59, dtype=int)
    steps[9] = 11
    frames = made_frames(60, steps=steps)
    export_session(RecordedSession(frames), tmp_path / "a.wav")
    back = read_session(tmp_path / "a.wav").frames["acceleration_m_s2"]
    np.testing.assert_array_equal(back[9:20], frames["acceleration_m_s2"][[9] * 11])
    np.testing.assert_array_equal(back[20:], frames["acceleration_m_s2"][10:])
    rate_hz, samples = wavfile.read(tmp_path / "a.wav")
    assert 0.5 < np.abs(samples).max() <= 1.0
    sound = (tmp_path / "a.wav").read_bytes()
    wavfile.write(tmp_path / "b.wav", rate_hz, np.round(samples[:50] * 32767).astype(np.int16))
    with (tmp_path / "b.wav").open("ab") as stream:
        stream.write(sound[sound.index(b"LIST") :])
    rounded = read_session(tmp_path / "b.wav").frames["acceleration_m_s2"]
    np.testing.assert_allclose(rounded, back[:50], atol=0.002)
    samples[9] = np.finfo("f4").max  # of a sensor that was torn off
    frames["acceleration_m_s2"] = samples[:60]
    export_session(RecordedSession(frames[:20]), tmp_path / "a.wav")
    back = read_session(tmp_path / "a.wav").frames["acceleration_m_s2"]
    np.testing.assert_allclose(back[:10], frames["acceleration_m_s2"][:10], atol=1e-6)
    export_session(RecordedSession(frames[:0]), tmp_path / "a.wav")
    with pytest.raises(InputError, match="it holds 0 frames"):
        read_session(tmp_path / "a.wav")
    with pytest.raises(InputError, match="sound is made of acceleration, and there is none"):
        export_session(RecordedSession(made_frames(60, ("force",))), tmp_path / "c.wav")


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs octave-cli")
@pytest.mark.parametrize(
    ("suffix", "belonging"),
    [
        (".h5", "jsondecode(scene), jsondecode(events), annotations, models"),
        (".mat", "jsondecode(scene_json), jsondecode(events_json), annotations, began_utc_ns"),
    ],
)
def test_octave_loads_the_whole_file(tmp_path, suffix, belonging):
    frames = made_frames(60)
    models = ((0.1, b"one"), (0.2, b"two"))
    session = RecordedSession(frames, SCENE, b"truth", models, MARKED, began_utc_ns=10**18)
    export_session(session, tmp_path / f"run{suffix}")
    program = (
        f"load run{suffix}; {belonging}; disp('sums'), printf('%.9g\\n', sum(force_n(:)), time_s)"
    )
    command = ["octave-cli", "--eval", program]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120.0
    )
    assert "sums" in done.stdout, done.stderr
    total, *time_s = map(float, done.stdout.partition("sums")[2].split())
    assert total == pytest.approx(frames["force_n"].astype(float).sum(), rel=1e-6)
    np.testing.assert_allclose(time_s, session.time_s, atol=1e-9)
