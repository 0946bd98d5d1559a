"""Columns of any name, unit and kind of file become the same frames."""

import re
import time
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.session import import_session, read_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording
from mmt.session.info import info
from mmt.session.mcap_windows import open_windows
from mmt.session.stream import open_recording

pytestmark = pytest.mark.usefixtures("read_here")

TIME_S = np.arange(3000) / 1000
POSITION_MM = np.column_stack([30 * np.sin(5 * TIME_S), 10 * TIME_S, 0 * TIME_S])
FORCE_N = np.column_stack([0.1 * np.cos(5 * TIME_S), 0 * TIME_S, 1 + 0.5 * np.sin(2 * TIME_S)])
GRAVITY_M_S2 = np.array([0.0, 0.0, 9.81])
ACCELERATION_M_S2 = np.random.default_rng(1).standard_normal((3000, 3)) + GRAVITY_M_S2


def check(frames):
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM, atol=1e-3)
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-4)
    np.testing.assert_allclose(frames["acceleration_m_s2"], ACCELERATION_M_S2, atol=1e-4)


def write_rows(path, header, columns, delimiter=",", comma=False, encoding="utf-8"):
    rows = [delimiter.join(f"{value:.7f}" for value in row) for row in np.column_stack(columns)]
    text = "\n".join(rows)
    path.write_text(header + (text.replace(".", ",") if comma else text), encoding=encoding)
    return path


def test_columns_of_other_names_and_units_are_mapped(tmp_path):
    path = write_rows(
        tmp_path / "a.csv",
        "t,px,py,Fx,Fy,Fz,ax,ay,az,note\n",
        [
            *(1e3 * TIME_S, *(POSITION_MM[:, :2] / 1e3).T, *(-FORCE_N).T),
            *(ACCELERATION_M_S2 / 9.80665).T,
            0 * TIME_S,
        ],
    )
    columns = {"time": "t", "position_x": "px", "position_y": "py", "position_z": "0"}
    columns |= {f"force_{axis}": f"-F{axis}" for axis in "xyz"}
    columns |= {f"acceleration_{axis}": f"a{axis}" for axis in "xyz"}
    units = {"time": "ms", "position": "m", "acceleration": "g"}
    check(import_session(path, columns=columns, units=units).frames)


def test_a_german_measuring_program_is_understood(tmp_path):
    """Lines above the header, a row of units, semicolons, decimal commas, Windows' encoding."""
    path = write_rows(
        tmp_path / "a.txt",
        "Messung bei 22 °C\nPrüfer: M\n\n"
        "time_s;position_x_mm;position_y_mm;position_z_mm;force_x_n;force_y_n;force_z_n;"
        "acceleration_x_m_s2;acceleration_y_m_s2;acceleration_z_m_s2\n"
        "s;m;m;m;mN;mN;mN;mg;mg;mg\n",
        [
            *(TIME_S, *(POSITION_MM / 1e3).T, *(FORCE_N * 1e3).T),
            *(ACCELERATION_M_S2 / 9.80665e-3).T,
        ],
        delimiter=";",
        comma=True,
        encoding="cp1252",
    )
    check(import_session(path).frames)


def test_blanks_are_gaps_when_asked(tmp_path):
    force_n = FORCE_N.copy()
    force_n[500:800, 1] = np.nan
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=force_n)
    with pytest.raises(InputError, match=r"force_y is empty or NaN in row 500.*299 more rows"):
        import_session(tmp_path / "a.npz")
    frames = import_session(tmp_path / "a.npz", blanks_as_gaps=True).frames
    np.testing.assert_array_equal(frames["sequence"], np.r_[:500, 800:3000])


def test_a_matlab_structure_is_read_by_its_fields(tmp_path):
    content = {"run": {"t": TIME_S, "F": FORCE_N.T, "x": POSITION_MM, "a": ACCELERATION_M_S2}}
    scipy.io.savemat(tmp_path / "a.mat", {**content, "note": "rough wood"})
    columns = {"time": "run.t", "force": "run.F", "position": "run.x", "acceleration": "run.a"}
    check(import_session(tmp_path / "a.mat", columns=columns).frames)


@pytest.mark.parametrize("trials", [1, 2, 3000])
def test_a_matlab_array_of_structures_is_read_by_series_or_by_rows(tmp_path, trials):
    run = np.empty(trials, dtype=[(name, object) for name in "tFxa"])
    parts = (TIME_S, FORCE_N, POSITION_MM, ACCELERATION_M_S2)
    for number in range(trials):
        run[number] = tuple(part[number] if trials == len(TIME_S) else part for part in parts)
    scipy.io.savemat(tmp_path / "a.mat", {"run": run})
    which = "{2}" if trials == 2 else ""
    columns = {"time": "run.t", "force": "run.F", "position": "run.x", "acceleration": "run.a"}
    columns = {target: name + which for target, name in columns.items()}
    check(import_session(tmp_path / "a.mat", columns=columns).frames)


def test_a_matlab_file_of_version_7_3_is_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["time_s"], file["force_n"] = TIME_S[None], FORCE_N.T  # as MATLAB stores its columns
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with (tmp_path / "a.mat").open("r+b") as stream:
        stream.write(header)
    frames = import_session(tmp_path / "a.mat").frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-6)


def ros_bag(path, rows=2000):
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

    with rosbag2.Writer(path, version=9) as writer:
        connections = {}
        for row in range(rows):
            time_ns = 1_700_000_000_000_000_000 + row * 1_000_000
            stamp = types["Time"](time_ns // 10**9, time_ns % 10**9)
            for topic, message in messages(row, types["Header"](stamp, "tool")).items():
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                late_ns = time_ns + 3_000_000 + row % 7 * 100_000  # when it was received
                writer.write(connections[topic], late_ns, store.serialize_cdr(message, kind))
    return path


def test_a_ros_2_bag_is_read_by_topic(tmp_path):
    path = ros_bag(tmp_path / "bag")
    columns = {"force": "/sensor/wrench", "acceleration": "/imu", "position": "/tool"}
    frames = import_session(path, columns=columns).frames
    assert len(frames) == 2000
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM[:2000], atol=1e-3)
    np.testing.assert_allclose(frames["force_n"], FORCE_N[:2000], atol=1e-6)
    np.testing.assert_allclose(frames["acceleration_m_s2"], ACCELERATION_M_S2[:2000], atol=1e-5)


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


# What looks wrong is said, with the option that mends it.


def warnings_of(tmp_path, options=None, **arrays):
    held = {"position_mm": POSITION_MM, "force_n": FORCE_N, "acceleration_m_s2": ACCELERATION_M_S2}
    np.savez(tmp_path / "a.npz", **{"time_s": TIME_S, **held, **arrays})
    return import_recording(tmp_path / "a.npz", options)[1].warnings


def test_a_sound_recording_passes_without_a_word(tmp_path):
    assert warnings_of(tmp_path) == ()
    assert warnings_of(tmp_path, acceleration_m_s2=ACCELERATION_M_S2 - GRAVITY_M_S2) == ()


def test_what_a_warning_proposes_mends_it(tmp_path):
    options = ImportOptions(columns={"force": "-force_n"}, units={"acceleration": "g"})
    arrays = {"force_n": -FORCE_N, "acceleration_m_s2": ACCELERATION_M_S2 / 9.80665}
    assert warnings_of(tmp_path, options, **arrays) == ()


@pytest.mark.parametrize("read", [import_session, read_session, open_recording, open_windows, info])
def test_warnings_are_logged_at_every_door(tmp_path, caplog, read):
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=-FORCE_N)
    read(tmp_path / "a.npz")
    assert "--map force=-force_n" in caplog.text


@pytest.mark.parametrize("end", ["", ")", "]", " x"])
@pytest.mark.parametrize("part", ["(", "[x", " ", "a ", "(N", " per ", "s_", "aB", "1."])
def test_a_heading_as_long_as_a_file_takes_no_time(part: str, end: str, tmp_path: Path) -> None:
    heading = part * (100_000 // len(part)) + end
    (tmp_path / "a.csv").write_text(f"time,force_x,{heading}\n0,1,2\n0.001,2,3\n", "utf-8")
    started = time.monotonic()
    with suppress(InputError):
        propose(tmp_path / "a.csv")
    assert time.monotonic() - started < 10.0


def stamped_table(path, seconds, fraction, ticks, unit_per_mm=1.0):
    """Write a table whose times stand in two columns, of whole seconds and of ticks."""
    whole = np.floor(TIME_S + 1.7e9)
    ticked = np.round(np.round(TIME_S - (whole - 1.7e9), 6) * ticks)
    names = [f"pose.position.{axis}" for axis in "xyz"]
    names += [f"wrench.force.{axis}" for axis in "xyz"]
    names += [f"linear_acceleration.{axis}" for axis in "xyz"]
    rows = [*(unit_per_mm * POSITION_MM).T, *FORCE_N.T, *ACCELERATION_M_S2.T]
    header = ",".join([seconds, fraction, *names]) + "\n"
    return write_rows(path, header, [whole, ticked, *rows])


@pytest.mark.parametrize(
    ("seconds", "fraction", "ticks"),
    [
        ("header.stamp.sec", "header.stamp.nanosec", 1e9),
        ("secs", "nsecs", 1e9),
        ("field.header.stamp.secs", "field.header.stamp.nsecs", 1e9),
        ("tv_sec", "tv_usec", 1e6),
        ("Seconds", "Milliseconds", 1e3),
        ("sec", "microseconds", 1e6),
    ],
)
def test_seconds_and_their_parts_in_two_columns_are_one_time(tmp_path, seconds, fraction, ticks):
    path = stamped_table(tmp_path / "a.csv", seconds, fraction, ticks)
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    assert proposal.options.columns["time"] == seconds
    assert proposal.options.columns["time_fraction"] == fraction
    session = import_recording(path, proposal.options)[0]
    check(session.frames)
    assert np.array_equal(np.diff(session.frames["sequence"]), np.ones(2999))


def test_parts_of_a_second_are_added_to_whole_seconds_alone(tmp_path):
    path = stamped_table(tmp_path / "a.csv", "sec", "nanosec", 1e9)
    columns = {**propose(path).options.columns, "time": "pose.position.x"}
    with pytest.raises(InputError, match=r"whole seconds, one a row; pose\.position\.x, to which"):
        import_session(path, columns=columns)


@pytest.mark.parametrize("in_metres", [True, False])
def test_positions_named_as_in_ros_are_proposed_in_metres_if_a_hand_moves_so(tmp_path, in_metres):
    path = stamped_table(tmp_path / "a.csv", "sec", "nanosec", 1e9, 1e-3 if in_metres else 1.0)
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    assert proposal.options.units.get("position") == ("m" if in_metres else None)
    check(import_recording(path, proposal.options)[0].frames)


@pytest.mark.parametrize(
    ("heading", "ticks"), [("Time", 1.0), ("X[s]", 1.0), ("t (ms)", 1e3), ("Time", 1e3)]
)
def test_each_signal_may_have_its_time_before_it(tmp_path, heading, ticks):
    """As measuring programs write them that record each channel at its own rate."""
    signals = {"x": POSITION_MM[:, 0], "Fz": FORCE_N[::2, 2], "az": ACCELERATION_M_S2[:, 2]}
    columns = []
    for name, values in signals.items():
        times = ticks * (TIME_S[::2] if name == "Fz" else TIME_S)
        columns += [[f"{value:.6f}" for value in column] for column in (times, values)]
    header = ",".join(f"{heading},{name}" for name in signals)
    rows = [",".join(row) for row in zip_longest(*columns, fillvalue="")]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    base = re.sub(r"\W.*", "", heading)
    wanted = {f"{c}_time": f"{base}.{n}" for n, c in enumerate(CHANNELS, 1)}
    assert wanted.items() <= proposal.options.columns.items()
    frames = import_recording(path, proposal.options)[0].frames
    count = len(frames)
    assert count > 2990
    np.testing.assert_allclose(frames["position_mm"][:, 0], POSITION_MM[:count, 0], atol=1e-3)
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:count, 2], atol=1e-3)
    np.testing.assert_allclose(
        frames["acceleration_m_s2"][:, 2], ACCELERATION_M_S2[:count, 2], atol=1e-3
    )


def test_formulas_without_values_are_told(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in [["t", "fx", "fy", "fz"], *([0.001 * n, 0, 0, "=1+1"] for n in range(50))]:
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    columns = {"time": "t", **{f"force_{axis}": f"f{axis}" for axis in "xyz"}}
    with pytest.raises(InputError, match="force_z has no value in any row; a workbook's formulas"):
        import_session(tmp_path / "a.xlsx", columns=columns)


@pytest.mark.parametrize("form", ["_{}", "[{}]", ".{}", "array"])
@pytest.mark.parametrize("robot", ["ur", "franka"])
def test_what_robots_call_their_measurements_is_proposed(tmp_path, robot, form):
    names, first = {
        "ur": (("actual_TCP_pose", "actual_TCP_force", "actual_tool_accelerometer"), 0),
        "franka": (("O_T_EE", "O_F_ext_hat_K", "actual_tool_accelerometer"), 12),
    }[robot]
    pose = np.random.default_rng(3).random((3000, 16))
    pose[:, first : first + 3] = POSITION_MM / 1e3
    arrays = {names[0]: pose, names[1]: np.column_stack([FORCE_N, pose[:, 3:6]])}
    arrays |= {names[2]: ACCELERATION_M_S2, "timestamp": TIME_S}
    if form == "array":
        np.savez(path := tmp_path / "a.npz", **arrays)
    else:
        columns = {"timestamp": arrays.pop("timestamp")}
        for name, values in arrays.items():
            columns |= {name + form.format(place): each for place, each in enumerate(values.T)}
        path = write_rows(tmp_path / "a.csv", ",".join(columns) + "\n", list(columns.values()))
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    check(import_recording(path, proposal.options)[0].frames)
    assert proposal.options.units["position"] == "m"


def test_a_unit_in_an_hdf5_file_counts_more_than_what_robots_use(tmp_path):
    h5py = pytest.importorskip("h5py")
    pose = np.zeros((3000, 16))
    pose[:, 12:15] = POSITION_MM
    with h5py.File(path := tmp_path / "a.h5", "w") as file:
        file["time"], file["O_T_EE"], file["O_F_ext_hat_K"] = TIME_S, pose, FORCE_N
        file["O_T_EE"].attrs["units"] = "mm"
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    assert proposal.options.units == {"force": "N"}
    frames = import_recording(path, proposal.options)[0].frames
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM, atol=1e-3)
