"""Exports hold what the session held, as the tools of each kind read it."""

import csv
import json
import sys

import numpy as np
import pytest
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.session.data import RecordedSession
from mmt.session.files import export_session

pytestmark = pytest.mark.usefixtures("read_here")

SCENE = {"session": {"name": "wood"}}
EVENTS = [{"time_s": 0.5, "event": "mark", "value": float("nan")}]


@pytest.fixture
def session():
    steps = np.ones(299, dtype=int)
    steps[10] = 6
    frames = made_frames(300, steps=steps)
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
