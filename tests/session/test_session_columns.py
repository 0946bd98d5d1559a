"""Columns of any name, unit and kind of file become the same frames."""

import time
from contextlib import suppress

import numpy as np
import pytest
from recording_files import force, motion, to_workbook, vibration

from mmt.core.errors import InputError
from mmt.session.files import import_session, read_session
from mmt.session.importing.proposal import propose
from mmt.session.importing.recording import import_recording
from mmt.session.info import info
from mmt.session.mcap.index import open_windows
from mmt.session.stream import open_recording

pytestmark = pytest.mark.usefixtures("read_here")

TIME_S = np.arange(2000) / 1000
POSITION_MM, FORCE_N, ACCELERATION_M_S2 = (made(TIME_S) for made in (motion, force, vibration))


def test_a_ros_2_bag_is_read_by_topic(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    types = {name.rsplit("/", 1)[-1]: kind for name, kind in store.types.items()}
    turn, nothing = types["Quaternion"](0.0, 0.0, 0.0, 1.0), types["Vector3"](0.0, 0.0, 0.0)
    unknown = np.zeros(9)

    def messages(row, header):
        force, acceleration = (
            types["Vector3"](*values[row].tolist()) for values in (FORCE_N, ACCELERATION_M_S2)
        )
        place = types["Point"](*(POSITION_MM[row] / 1e3).tolist())
        return {
            "/sensor/wrench": types["WrenchStamped"](header, types["Wrench"](force, nothing)),
            "/imu": types["Imu"](header, turn, unknown, nothing, unknown, acceleration, unknown),
            "/tool": types["PoseStamped"](header, types["Pose"](place, turn)),
        }

    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        connections = {}
        for row in range(len(TIME_S)):
            time_ns = 1_700_000_000_000_000_000 + row * 1_000_000
            stamp = types["Time"](time_ns // 10**9, time_ns % 10**9)
            for topic, message in messages(row, types["Header"](stamp, "tool")).items():
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                late_ns = time_ns + 3_000_000 + row % 7 * 100_000  # when it was received
                writer.write(connections[topic], late_ns, store.serialize_cdr(message, kind))
    columns = {"force": "/sensor/wrench", "acceleration": "/imu", "position": "/tool"}
    frames = import_session(tmp_path / "bag", columns=columns).frames
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM, atol=1e-3)
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-6)
    np.testing.assert_allclose(frames["acceleration_m_s2"], ACCELERATION_M_S2, atol=1e-5)


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
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=FORCE_N)
    with pytest.raises(InputError, match=r"--\w+ is for .*leave it out"):
        import_session(tmp_path / "a.npz", **given)


@pytest.mark.parametrize("gravity_m_s2", [0.0, 9.81])
def test_a_sound_recording_passes_without_a_word(tmp_path, gravity_m_s2):
    arrays = {"time_s": TIME_S, "position_mm": POSITION_MM, "force_n": FORCE_N}
    acceleration_m_s2 = ACCELERATION_M_S2 - [0.0, 0.0, gravity_m_s2]
    np.savez(tmp_path / "a.npz", **arrays, acceleration_m_s2=acceleration_m_s2)
    assert import_recording(tmp_path / "a.npz")[1].warnings == ()


@pytest.mark.parametrize("read", [import_session, read_session, open_recording, open_windows, info])
def test_warnings_are_logged_at_every_door(tmp_path, caplog, read):
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=-FORCE_N)
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


def test_formulas_without_values_are_told(tmp_path):
    table = {"t": TIME_S[:50], "fx": 0 * TIME_S[:50], "fy": 0 * TIME_S[:50]}
    to_workbook(tmp_path / "a.xlsx", table | {"fz": np.full(50, "=1+1")}, {})
    columns = {"time": "t", **{f"force_{axis}": f"f{axis}" for axis in "xyz"}}
    with pytest.raises(InputError, match="force_z has no value in any row; a workbook's formulas"):
        import_session(tmp_path / "a.xlsx", columns=columns)
    columns |= {"time": "fz", "force_z": "t"}
    with pytest.raises(InputError, match=r"its times \(fz\) 0; a workbook's formulas"):
        import_session(tmp_path / "a.xlsx", columns=columns)
