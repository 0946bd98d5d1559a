"""Other people's recordings become frames at 1 kHz, or a short sentence that names the place."""

import io
import time
import zipfile
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_files import FIELDS, TIME_S, TRUTH, force, to_workbook
from scipy.io import savemat

from mmt.core.errors import InputError
from mmt.session.files import import_session, read_session
from mmt.session.formats import suffixes
from mmt.session.importing.proposal import propose
from mmt.session.importing.readers.cells import Numbers
from mmt.session.importing.recording import import_recording
from mmt.session.info import info
from mmt.session.stream import open_recording, open_windows

pytestmark = pytest.mark.usefixtures("read_here")


def tone(time_s, frequency_hz):
    """Three axes of one tone, offset as position and gravity are; shape (n, 3)."""
    phases = np.array([0.0, 1.0, 2.0])
    return 5.0 + np.sin(2 * np.pi * frequency_hz * np.asarray(time_s)[:, None] + phases)


def save(path, time_s, **arrays):
    np.savez(path, time_s=time_s, **arrays)
    return path


def grid_s(frames):
    return frames["sequence"] / 1000.0


@pytest.mark.parametrize("rate_hz", [250, 333, 800, 995, 1005, 2000, 10_000])
def test_a_tone_keeps_its_values_at_any_rate(tmp_path, rate_hz):
    time_s = 7.0 + np.arange(2 * rate_hz) / rate_hz
    path = save(tmp_path / "other.npz", time_s, position_mm=tone(time_s - 7.0, 20))
    frames = import_session(path).frames
    assert len(frames) == pytest.approx(2000, abs=1000 / rate_hz + 1)
    assert frames["sequence"][0] == 0
    assert np.all(np.diff(frames["sequence"].astype(int)) == 1)
    np.testing.assert_array_equal(np.diff(frames["time_ns"]), 1_000_000)
    inner = frames[40:-40]  # the decimating filter needs 32 ms on either side
    np.testing.assert_allclose(inner["position_mm"], tone(grid_s(inner), 20), atol=2e-3)
    np.testing.assert_allclose(frames["position_mm"], tone(grid_s(frames), 20), atol=0.05)


def test_frames_begin_and_end_where_all_channels_are_known(tmp_path):
    slow_s = np.arange(1000) / 500
    fast_s = 0.1 + np.arange(20_000) / 10_000
    path = save(
        tmp_path / "two.npz",
        slow_s,
        force_n=tone(slow_s, 3),
        acceleration_time_s=fast_s,
        acceleration_m_s2=tone(fast_s, 150),
    )
    frames = import_session(path).frames
    assert (frames["sequence"][0], frames["sequence"][-1]) == (100, 1998)
    inner = frames[40:-40]
    np.testing.assert_allclose(inner["force_n"], tone(grid_s(inner), 3), atol=1e-3)
    np.testing.assert_allclose(inner["acceleration_m_s2"], tone(grid_s(inner), 150), atol=2e-3)


def test_a_gap_in_one_channel_is_a_gap_in_all(tmp_path):
    slow_s = np.arange(500) / 500
    fast_s = np.delete(np.arange(4000), np.r_[1000:2000]) / 4000
    path = save(
        tmp_path / "gap.npz",
        slow_s,
        force_n=tone(slow_s, 1),
        acceleration_time_s=fast_s,
        acceleration_m_s2=tone(fast_s, 1),
    )
    sequence = import_session(path).frames["sequence"].astype(int)
    np.testing.assert_array_equal(sequence, np.r_[:250, 500:999])


@given(
    rate_hz=st.floats(60, 20_000),
    jitter=st.floats(0, 0.4),
    start_s=st.floats(-1e6, 1e6),
    seed=st.integers(0, 100),
)
@settings(max_examples=25)
def test_a_constant_stays_constant(tmp_path_factory, rate_hz, jitter, start_s, seed):
    """Uneven times, any rate, any origin: nothing but the value itself comes out."""
    rng = np.random.default_rng(seed)
    count = int(0.3 * rate_hz) + 2
    time_s = start_s + (np.arange(count) + rng.uniform(0, jitter, count)) / rate_hz
    path = tmp_path_factory.mktemp("constant") / "c.npz"
    frames = import_session(save(path, time_s, force_n=np.full((count, 3), 2.5))).frames
    np.testing.assert_allclose(frames["force_n"], 2.5, rtol=1e-6)
    assert len(frames) == pytest.approx((time_s[-1] - time_s[0]) * 1000, abs=2 + 800 / rate_hz)


HEADER = "time_s,force_x_n,force_y_n,force_z_n"


def test_text_columns_may_end_early_where_rates_differ(tmp_path):
    axes = ",".join(f"acceleration_{axis}_m_s2" for axis in "xyz")
    rows = [f"{HEADER},acceleration_time_s,{axes}"]
    for row in range(2000):
        slow = f"{row / 500},1,2,3" if row < 500 else ",,,"
        rows.append(f"{slow},{row / 2000},4,5,6")
    (tmp_path / "two.csv").write_text("\n".join(rows))
    frames = import_session(tmp_path / "two.csv").frames
    np.testing.assert_allclose(frames["force_n"], [[1, 2, 3]] * 999, rtol=1e-6)
    np.testing.assert_allclose(frames["acceleration_m_s2"], [[4, 5, 6]] * 999, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the file is empty"),
        (HEADER, "force has 0 rows, at least 2"),
        (HEADER + "\n0,1,1,1\n0.001,1,oops,1", "force_y_n is 'oops' in line 3"),
        (HEADER + "\n0,1,1,1\n0.002,1,1,1\n0.001,1,1,1", "time of force is 0.001 s in line 4"),
        (HEADER + "\n0,1,1,1\n0.001,1,nan,1", "force_y is empty or NaN in line 3"),
        (HEADER + "\n0,1,1,1\n0.001,,1,1\n0.002,1,1,1", "force_x is empty or NaN in line 3"),
        (HEADER + "\n0,1,1,1\n.1,1,1,1\n.2,1,1\n.3,1,1", "force_z is empty or NaN in line 4, "),
        ("\x00\x01\x02", "not text in columns"),
    ],
)
def test_text_that_is_wrong_is_named(tmp_path, text, reason):
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(InputError, match=reason):
        import_session(tmp_path / "wrong.csv")


def test_files_of_another_kind_are_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"not an archive")
    with (tmp_path / "b.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    np.savez(tmp_path / "c.npz", time_s=np.array([{}]), force_n=np.ones((1, 3)))
    for name in "a.npz", "b.npz", "c.npz":
        with pytest.raises(InputError, match="this is"):
            import_session(tmp_path / name)
    savemat(tmp_path / "d.mat", {"time_s": TIME_S, "force_n": force(TIME_S) + 1j})
    with pytest.raises(InputError, match="force_n holds complex128, not numbers"):
        import_session(tmp_path / "d.mat")
    for name in "absent.npz", "absent.csv", "absent":
        with pytest.raises(InputError, match="No such file"):
            import_session(tmp_path / name)


def test_what_is_no_bag_is_explained(tmp_path):
    pytest.importorskip("rosbags")
    (tmp_path / "bag").mkdir()
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(40))
    (tmp_path / "b.db3").write_bytes(b"SQLite format 3\0" + bytes(100))
    for name in "bag", "a.mcap", "b.db3":
        with pytest.raises(InputError, match="is not a ROS bag"):
            import_session(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(200)),
        ("b.mat", b""),
        ("c.mat", b"not a matlab file at all" * 20),
        ("d.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(2000)),
        ("a.xlsx", b"PK\x03\x04 nothing"),
        ("b.xlsx", b""),
    ],
)
def test_damaged_files_are_explained(tmp_path, name, content):
    pytest.importorskip("openpyxl")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"MATLAB file|workbook|holds none|Unable|open"):
        import_session(tmp_path / name)


@pytest.mark.parametrize("given", [{"sheet": "a"}, {"separator": ","}, {"offsets": {"b": "1"}}])
def test_options_of_other_kinds_of_files_are_refused(tmp_path, given):
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=force(TIME_S))
    with pytest.raises(InputError, match=r"--\w+ is for .*leave it out"):
        import_session(tmp_path / "a.npz", **given)


@pytest.mark.parametrize("gravity_m_s2", [0.0, 9.81])
def test_a_sound_recording_passes_without_a_word(tmp_path, gravity_m_s2):
    arrays = {FIELDS[channel]: made(TIME_S) for channel, made in TRUTH.items()}
    arrays["acceleration_m_s2"] -= [0.0, 0.0, gravity_m_s2]
    np.savez(tmp_path / "a.npz", time_s=TIME_S, **arrays)
    assert import_recording(tmp_path / "a.npz")[1].warnings == ()


@pytest.mark.parametrize("read", [import_session, read_session, open_recording, open_windows, info])
def test_warnings_are_logged_at_every_door(tmp_path, caplog, read):
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=-force(TIME_S))
    read(tmp_path / "a.npz")
    assert "--map force=-force_n" in caplog.text


@pytest.mark.parametrize("end", ["", ")", "]", " x"])
@pytest.mark.parametrize("part", ["(", "[x", " ", "a ", "(N", " per ", "s_", "aB", "1."])
def test_a_heading_as_long_as_a_file_takes_no_time(part, end, tmp_path):
    heading = part * (100_000 // len(part)) + end
    (tmp_path / "a.csv").write_text(f"time,force_x,{heading}\n0,1,2\n0.001,2,3\n", "utf-8")
    started = time.monotonic()
    with suppress(InputError):
        propose(tmp_path / "a.csv")
    assert time.monotonic() - started < 40.0


@pytest.mark.parametrize("lines", [["sec: 5", "x:"], ["7 a", "b c", "d"], ["1:", "10:x:3", "e"]])
def test_each_cell_of_a_text_without_a_table_is_read_a_few_times(lines, tmp_path, monkeypatch):
    read, reads = [], Numbers.reads
    monkeypatch.setattr(Numbers, "reads", lambda self, cell: read.append(cell) or reads(self, cell))
    text = "\n".join(lines * 500)
    (tmp_path / "a.txt").write_text(text, "utf-8")
    with suppress(InputError):
        import_session(tmp_path / "a.txt", columns={"force_z": "1"})
    assert 0 < len(read) < 50 * len(text.split())


def test_formulas_without_values_are_told(tmp_path):
    table = {"t": TIME_S[:50], "fx": 0 * TIME_S[:50], "fy": 0 * TIME_S[:50]}
    to_workbook(tmp_path / "a.xlsx", table | {"fz": np.full(50, "=1+1")}, {})
    columns = {"time": "t", **{f"force_{axis}": f"f{axis}" for axis in "xyz"}}
    with pytest.raises(InputError, match="force_z has no value in any row; a workbook's formulas"):
        import_session(tmp_path / "a.xlsx", columns=columns)
    columns |= {"time": "fz", "force_z": "t"}
    with pytest.raises(InputError, match=r"its times \(fz\) 0; a workbook's formulas"):
        import_session(tmp_path / "a.xlsx", columns=columns)


def archive(path, **members):
    with zipfile.ZipFile(path, "w") as stream:
        for name, data in members.items():
            stream.writestr(f"{name}.npy", data)
    return path


def header(shape):
    stream = io.BytesIO()
    told = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, told)
    return stream.getvalue()


def patched(path, offset_local, offset_central, value):
    """Overwrite a 2-byte field of both headers of an archive's only member."""
    data = bytearray(path.read_bytes())
    central = data.index(b"PK\x01\x02")
    for at in (offset_local, central + offset_central):
        data[at : at + 2] = value.to_bytes(2, "little")
    path.write_bytes(data)
    return path


def stored(path):
    np.savez(path, time_s=np.arange(5.0))
    return path


@pytest.mark.parametrize(
    "made",
    [
        lambda path: archive(path, time_s=header((10**15,))),
        lambda path: patched(stored(path), 6, 8, 1),
        lambda path: patched(stored(path), 8, 10, 99),
    ],
    ids=["huge shape", "encrypted", "odd method"],
)
def test_an_odd_archive_is_explained(tmp_path, made):
    said = r"odd\.npz: this is not a .npz archive of numbers"
    with pytest.raises(InputError, match=said) as told:
        import_session(made(tmp_path / "odd.npz"))
    assert len(str(told.value)) < 400


def test_a_line_without_end_is_refused_before_it_is_taken_apart(tmp_path):
    path = tmp_path / "line.csv"
    path.write_bytes(b"time_s\n" + b"1," * (10 << 20))
    with pytest.raises(InputError, match=r"line\.csv: a line has more than 1048576 characters"):
        import_session(path)


@given(
    name=st.sampled_from(["scene", "events", "annotations"]),
    value=st.one_of(
        st.none(),  # a group
        st.text("abc {}[]", min_size=1),
        st.integers(-9, 9),
        st.lists(st.floats(-9, 9), max_size=3),
    ),
    ours=st.booleans(),
)
@settings(max_examples=25)
def test_data_sets_of_a_sessions_names_are_anything_in_other_files(name, value, ours):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "other.h5"
        with h5py.File(path, "w") as file:
            file["time_s"] = np.arange(50) / 1000
            file["force_n"] = np.ones((50, 3))
            if ours:
                file["sequence"] = file["time_ns"] = np.arange(50)
            if value is None:
                file.create_group(name)
            else:
                file[name] = value
        session, said = None, ""
        try:
            session = import_session(path)
        except InputError as error:
            said = str(error)
    if session is None:
        assert ours
        assert f"{name} is not" in said or "this is not an HDF5 file" in said
    else:
        assert len(session.frames) == 50
        assert ours or (session.scene, session.annotations) == (None, b"")


@pytest.mark.parametrize("suffix", [".mcap", *suffixes("import")])
def test_a_pointer_of_git_lfs_is_called_by_its_name(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n")
    for read in (read_session, import_session):
        with pytest.raises(InputError, match=rf"a{suffix}: .*not fetched: git lfs pull"):
            read(path)
