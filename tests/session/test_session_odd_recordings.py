"""Recordings as the programs of a laboratory write them come in as proposed, with right values."""

import json
import pickle
import re
import struct
import zipfile
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from recording_files import (
    FIELDS,
    TIME_S,
    TRUTH,
    force,
    hdf5,
    imported,
    lines,
    motion,
    to_workbook,
    vibration,
    write_columns,
)
from scipy.io import savemat
from scipy.sparse import csc_matrix

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose
from mmt.session.importing.recording import import_recording

pytestmark = pytest.mark.usefixtures("read_here")

KINDS = {}
"""Writers by the name of the file, with the channels that are in it and the options it needs."""


def kind(name, *arguments, channels=TRUTH, **given):
    """Have a file written by a function, imported, and compared with the truth."""

    def register(write):
        assert name not in KINDS, name
        KINDS[name] = (lambda path: write(path, *arguments), set(channels), given)
        return write

    return register


def rows_of(*made):
    """Rows of a time and the numbers of channels."""
    return np.column_stack([TIME_S, *(each(TIME_S) for each in made)]).tolist()


NAMED = {f"force_{axis}": f"f{axis}" for axis in "xyz"}
ONLY_FORCE = ["force"]


@kind("units.log", channels=["position", "force"])
def with_units(path):
    cells = ([f"{t:.3f} s", *(f"{f:.6f}N" for f in row[:3]), *(f"{p:.4f} mm" for p in row[3:])]
             for t, *row in rows_of(force, motion))  # fmt: skip
    lines(path, "time;Fx;Fy;Fz;px;py;pz", cells, ";")


@kind("hex.csv", channels=["acceleration"])
def in_hexadecimals(path):
    counts = np.rint(1000 * vibration(TIME_S)).astype(int)
    cells = ([f"0x{round(1e6 * t):08X}", *(f"0x{c & 0xFFFF:04x}" for c in row)]
             for t, row in zip(TIME_S, counts.tolist(), strict=True))  # fmt: skip
    lines(path, "t_us,ax_mm_s2,ay_mm_s2,az_mm_s2", cells)


@kind("first.mat", channels=["position", "force"])
def with_times_first(path):
    """As Simulink's block To File and QUARC write them: a row for the time and each element."""
    matrices = {"pos": motion(TIME_S), "force": np.column_stack([force(TIME_S), motion(TIME_S)])}
    savemat(path, {name: np.vstack([TIME_S, values.T]) for name, values in matrices.items()})


@kind("dataset.mat", channels=ONLY_FORCE)
def dataset_of_structures(path):
    series = {"Time": TIME_S[:, None], "Data": force(TIME_S)}
    savemat(path, {"logsout": {"force": {"Values": series}, "Name": "logsout"}})


@kind("scope.mat", "label")
@kind("outports.mat", "blockName")
def structure_with_time_of_simulink(path, told):
    fields = [(name, object) for name in dict.fromkeys(("values", "dimensions", "label", told))]
    signals = np.empty(len(TRUTH), dtype=fields)
    signals["label"] = ""
    for number, (channel, made) in enumerate(TRUTH.items()):
        signals["values"][number], signals["dimensions"][number] = made(TIME_S), 3.0
        signals[told][number] = channel if told == "label" else f"arm/{channel}"
    savemat(path, {"log": {"time": TIME_S, "signals": signals, "blockName": "arm/Scope"}})


@kind("workspace.mat")
def variables_of_simulink_without_labels(path):
    def variable(made):
        return {"time": TIME_S, "signals": {"values": made(TIME_S), "label": ""}, "blockName": "b"}

    made_of = {"x": motion, "F": force, "acc": vibration}
    savemat(path, {"tout": TIME_S} | {name: variable(made) for name, made in made_of.items()})


@kind("importdata.mat", "A", "colheaders", "N", channels=ONLY_FORCE)
@kind("acqknowledge.mat", "", "labels", "mN", channels=ONLY_FORCE)
def matrix_with_names_beside_it(path, owner, heads, unit):
    scale = {"N": 1, "mN": 1e3}[unit]
    content = {"data": np.column_stack([TIME_S, scale * force(TIME_S)])}
    content |= {heads: np.array(["t ", "Fx", "Fy", "Fz"]), "gain": 2.0}
    content |= {"units": np.array(["s ", unit, unit, unit])} if unit != "N" else {}
    savemat(path, {owner: content} if owner else content)


@kind("sparse.mat", channels=["force", "acceleration"])
def sparse_matrix_and_time_series(path):
    waves = {"Time": TIME_S[:, None], "Data": vibration(TIME_S).T[:, None, :]}
    savemat(path, {"t": TIME_S, "force": csc_matrix(force(TIME_S)), "acc": waves})


@kind("cells.mat", channels=ONLY_FORCE)
def with_times_as_texts(path):
    times = np.array([f"10:30:{time_s:06.3f}" for time_s in TIME_S], dtype=object)
    savemat(path, {"time": times, "force": force(TIME_S), "unit": "N", "axes": ["x", "y", "z"]})


MATLAB = {target: f"run.{target[0]}" for target in ("time", *TRUTH)}


@kind("two.mat", 2, columns={target: name + "{2}" for target, name in MATLAB.items()})
@kind("rows.mat", len(TIME_S), columns=MATLAB)
def an_array_of_structures_of_series_or_of_rows(path, trials):
    run = np.empty(trials, dtype=[(name, object) for name in "tpfa"])
    parts = (TIME_S, *(made(TIME_S) for made in TRUTH.values()))
    for number in range(trials):
        run[number] = tuple(part[number] if trials == len(TIME_S) else part for part in parts)
    savemat(path, {"run": run})


@kind("v7.3.mat", channels=ONLY_FORCE)
def version_7_3_of_matlab(path):
    with hdf5(path, userblock_size=512) as file:
        file["time_s"], file["force_n"] = TIME_S[None], force(TIME_S).T  # as MATLAB stores them
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@kind("cells of v7.3.mat", "runs")
@kind("structures of v7.3.mat", "run")
def series_of_trials_in_version_7_3_of_matlab(path, kind):
    """A structure array has references in each field, a cell array one to each structure."""
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")

    def add(group, name, values, told="double"):
        group[name] = values
        group[name].attrs["MATLAB_class"] = np.bytes_(told.encode())
        return group[name].ref

    with hdf5(path, userblock_size=512) as file:
        behind, trials = file.create_group("#refs#"), []
        for number in range(3):
            rows = slice(0, len(TIME_S) - 300 * number)
            trial = behind.create_group(str(number))
            fields = {n: (1 + number) * made(TIME_S)[rows].T for n, made in TRUTH.items()}
            refs = {n: add(trial, n, values) for n, values in fields.items()}
            text = np.frombuffer(b"rough oak"[number:], "u1").astype("u2")[:, None]
            refs |= {
                "t": add(trial, "t", TIME_S[None, rows]),
                "name": add(trial, "n", text, "char"),
            }
            trials.append(refs if kind == "run" else trial.ref)
        if kind == "run":
            for name in trials[0]:
                each = np.array([[refs[name]] for refs in trials], dtype=h5py.ref_dtype)
                file[f"run/{name}"] = each
        else:
            file["runs"] = np.array(trials, dtype=h5py.ref_dtype)[None]
            file["#refs#/0/own"] = np.array([behind["0"].ref], dtype=h5py.ref_dtype)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@kind("plot.mat", channels=ONLY_FORCE)
def with_times_that_are_an_axis_of_a_plot_and_numbers_beside_units(path):
    force_n = {"Data": force(TIME_S), "Unit": "N", "Type": 4.0}
    savemat(path, {"log": {"X": {"Type": 4.0, "Data": TIME_S, "Unit": "s"}, "force": force_n}})


@kind("points.csv", "Time,Pos. {0},Force {0},Acc. {0},Gyr. {0},Ang. vel. {0}")
@kind("colons.csv", "Time,Tip: {0},FT: Force {0},Accel: {0},Gyro: {0},Torque: {0}")
@kind("delsys.csv", "X[s],T: POS.{0} 1,T: FORCE.{0} 1,T: ACC.{0} 1,T: GYRO.{0} 1,T: MAG.{0} 1")
def with_axes_behind_abbreviations(path, heads):
    time, *others = heads.split(",")
    head = ",".join([time, *(other.format(axis) for other in others for axis in "XYZ")])
    lines(path, head, ((*row, *range(6)) for row in rows_of(*TRUTH.values())))


@kind("stamps.csv", channels=ONLY_FORCE)
def with_the_time_of_day_in_seconds_beside_a_finer_time(path):
    rows = ((f"10:30:{int(t):02}", 1e3 * t, *row) for t, *row in rows_of(force))
    lines(path, "Timestamp,Time (ms),Fx,Fy,Fz", rows)


@kind("title.txt", channels=ONLY_FORCE)
def with_a_title_before_the_units(path):
    lines(path, "Sampling rate (Hz);1000\nabs time (s);Fx;Fy;Fz\nUnits:;N;N;N", rows_of(force), ";")


AXES = ",x,y,z" * 3
LEVELS = "".join(f",{channel}" * 3 for channel in TRUTH)
DATES = [f"2026-05-01 10:00:{time_s:09.6f}" for time_s in TIME_S]
DAYS_END = (np.datetime64("2026-01-31T23:59:59.8") + (TIME_S * 1e6).astype("m8[us]")).tolist()


@kind("named levels.csv", TIME_S, f"sensor{LEVELS}\naxis{AXES}\nt{',' * 9}")
@kind("levels.csv", TIME_S, f"{LEVELS}\n{AXES}\nstamp{',' * 9}")
@kind("merged.csv", 1e3 * TIME_S, f"Time{LEVELS}\nms{AXES}")
@kind("index.csv", DATES, ",px,py,pz,fx,fy,fz,ax,ay,az")
@kind("days.csv", [f"{d:%d-%b-%Y %H:%M:%S.%f}" for d in DAYS_END], f"t{LEVELS}\n{AXES}")
@kind("hours.csv", [f"{d:%H:%M:%S.%f}" for d in DAYS_END], f"t{LEVELS}\n{AXES}")
def each_channel(path, times, head):
    lines(
        path, head, ((t, *row[1:]) for t, row in zip(times, rows_of(*TRUTH.values()), strict=True))
    )


@kind("fixed.h5", True)
@kind("frame.h5", False)
def frame(path, fixed):
    """What pandas stores, as arrays with their columns' names or as a table."""
    names = [c[0] + axis for c in TRUTH for axis in "xyz"]
    values = np.hstack([made(TIME_S) for made in TRUTH.values()])
    with hdf5(path) as file:
        group = file.create_group("log")
        if fixed:
            group["axis1"], group["block0_values"] = TIME_S, values
            group["axis1"].attrs["name"] = np.bytes_(b"time")
            group["block0_items"] = np.array(names, dtype="S")
            return
        dtype = [("index", "i8"), ("block", "f8", (1,)), ("values_block_1", "f8", (9,))]
        rows = zip(range(len(TIME_S)), TIME_S[:, None], values, strict=True)
        group["table"] = np.array(list(rows), dtype=dtype)
        for field, told in (("block", ["t"]), ("values_block_1", names)):
            group["table"].attrs[f"{field}_kind"] = np.bytes_(pickle.dumps(told, protocol=0))


@kind("unity.csv", channels=["position", "force"])
def with_vectors_of_unity(path):
    rows = ((t, tuple(row[:3]), tuple(row[3:])) for t, *row in rows_of(motion, force))
    lines(path, "Time,Position,Force", rows)


def printed(values, form):
    """Return numbers as NumPy or Python print them, or as a cell of a table with commas."""
    if form == "array":
        return str(np.round(values, 6))
    text = str([round(float(value), 6) for value in values])
    forms = {"list": text, "tuple": f"({text[1:-1]})", "cell": f'"{text}"'}
    return {**forms, "tensor": f'"tensor({text})"', "dtype": f'"np.array({text}, dtype=f4)"'}[form]


@kind("array.csv", "array", ",", channels=["position", "force"])
@kind("list.csv", "list", "\t", channels=["position", "force"])
@kind("cell.csv", "cell", ",", channels=["position", "force"])
@kind("tensor.csv", "tensor", ",", channels=["position", "force"])
@kind("dtype.csv", "dtype", ",", channels=["position", "force"])
def with_cells_of_several_numbers(path, form, sign):
    rows = (
        (t, printed(row[:3], form), printed(row[3:], form)) for t, *row in rows_of(motion, force)
    )
    lines(path, sign.join(["t", "pos", "force"]), rows, sign)


NUMBERED = dict(zip(("time", *NAMED), "1234", strict=True))


@kind("list.txt", "list", channels=ONLY_FORCE, columns=NUMBERED)
@kind("tuple.txt", "tuple", channels=ONLY_FORCE, columns=NUMBERED)
@kind("array.txt", "array", channels=ONLY_FORCE, columns=NUMBERED)
def lists_a_line_each(path, form):
    path.write_text("\n".join(printed(row, form) for row in rows_of(force)))


@kind("sign.csv", ",", channels=ONLY_FORCE)
@kind("sign.txt", "\t", channels=ONLY_FORCE)
def with_names_behind_a_comments_sign(path, sign):
    lines(path, sign.join(["#", "t", *NAMED.values()]), rows_of(force), sign)


@kind("counted.csv", channels=ONLY_FORCE)
def with_row_numbers_and_a_column_without_values(path):
    lines(path, ",t,Fx,Fy,Fz,Comment", ((n, *row) for n, row in enumerate(rows_of(force))))


@kind("no names.csv", channels=ONLY_FORCE, columns=NUMBERED)
@kind("names.csv", "0,1,2,3", channels=ONLY_FORCE,
      columns=dict(zip(NUMBERED, "0123", strict=True)))  # fmt: skip
def with_columns_that_are_numbered(path, *head):
    rows = [",".join(map(str, row)) for row in rows_of(force)]
    path.write_text("\n".join([*head, *rows]) + "\n")


@kind("arduino.log", "10:30:", " -> ", channels=["acceleration"])
@kind("terminal.log", "[2026-05-01 10:30:", "] ", channels=["acceleration"])
def behind_a_monitors_time(path, day, sign):
    """As Arduino's monitor and Tera Term write it."""
    texts = ((f"{day}{t:06.3f}{sign}{ax}", ay, az) for t, ax, ay, az in rows_of(vibration))
    lines(path, f"{day}00.000{sign}ax,ay,az", texts)


@kind("force.csv", channels=ONLY_FORCE)
def in_sections(path):
    texts = [
        "\n".join(",".join(map(str, row)) for row in rows_of(made)) for made in (force, motion)
    ]
    path.write_text(f"[Force]\nt,x,y,z\n{texts[0]}\n[Camera]\nt,x,y,z\n{texts[1]}\n")


@kind("settings=.txt", ("Name=", "Range=", "Unit="), channels=ONLY_FORCE, columns={"time": "1"})
@kind("settings.txt", ("", "", ""), channels=ONLY_FORCE, columns={"time": "1"})
@kind("t.txt", ("t", "", "s"), channels=ONLY_FORCE)
def with_settings_of_the_columns(path, keys):
    settings = (["Fx", "10 V", "mN"], ["Fy", "±2.5 V", "mN"], ["Fz", "±2.5 V", "mN"])
    head = ["Interval=\t0.001 s", *map("\t".join, zip(keys, *settings, strict=True))]
    rows = ((t, *(1e3 * value for value in row)) for t, *row in rows_of(force))
    lines(path, "\n".join(head), rows, "\t")


@kind("brackets.txt", "Time (s) Fx (mN) Fy (mN) Fz (mN)", channels=ONLY_FORCE)
@kind("words.txt", "Time (s) Force x (mN) Force y (mN) Force z (mN)", channels=ONLY_FORCE)
@kind("wide.txt", "Time stamp  Force x mN  Force y mN  Force z mN", channels=ONLY_FORCE)
@kind("sign.log", "# Time (s), Force x (mN), Force y (mN), Force z (mN)", channels=ONLY_FORCE)
@kind("between.log", "Time\tForce x [mN]\tForce y [mN]\tForce z [mN]", channels=ONLY_FORCE)
def with_blanks_in_names_above_columns_between_blanks(path, head):
    lines(path, head, ((t, *(1e3 * value for value in row)) for t, *row in rows_of(force)), " ")


@pytest.mark.parametrize("part", [None, 1, 2])
def test_blocks_below_settings_of_their_own_follow_each_other(tmp_path, part):
    """As LabChart writes them, each with times that begin anew."""
    head = "Interval=\t0.001 s\nExcelDateTime=\t45000.5\t2026-01-31\nChannelTitle=\tFx\tFy\tFz\n"
    head += "Range=\t10 V\t10 V\t10 V\nUnitName=\tmN\tmN\tmN"
    blocks = [force(TIME_S[:999]), force(TIME_S[1000:])]
    rows = [np.column_stack([TIME_S[: len(block)], 1e3 * block]).tolist() for block in blocks]
    texts = ["\n".join("\t".join(map(str, row)) for row in each) for each in rows]
    (tmp_path / "a.txt").write_text("\n".join([head, texts[0], head, texts[1]]))
    found = imported(tmp_path / "a.txt", columns={"time": "1"}, episode=part).frames["force_n"]
    expected = np.concatenate(blocks) if part is None else blocks[part - 1]
    np.testing.assert_allclose(found, expected, atol=1e-5)


@kind("blanks of r.txt", " ", '"', channels=ONLY_FORCE)
@kind("tabs of r.txt", "\t", "", channels=ONLY_FORCE)
@kind("commas of r.csv", ",", '"', channels=ONLY_FORCE)
@kind("from zero.csv", ",", "", 0, channels=ONLY_FORCE)
def with_row_numbers_that_have_no_name(path, sign, quote, begin=1):
    """As ``write.table`` of R writes them."""
    names = [f"{quote}{name}{quote}" for name in ("t", "Fx", "Fy", "Fz")]
    rows = enumerate(rows_of(force), start=begin)
    lines(path, sign.join(names), ([f"{quote}{n}{quote}", *row] for n, row in rows), sign)


@kind("header.csv", "t;Fx;Fy;Fz\ns;mN;mN;mN", channels=ONLY_FORCE)
@kind("header;.csv", "t;Fx;Fy;Fz;\ns;mN;mN;mN;", channels=ONLY_FORCE)
@kind("names;.csv", "t;Fx;Fy;Fz;", channels=ONLY_FORCE, units={"force": "mN"})
def with_its_header_repeated(path, head):
    end = ";" if head.endswith(";") else ""
    each = ([t, *(1e3 * value for value in row)] for t, *row in rows_of(force))
    rows = [";".join(map(str, row)) + end for row in each]
    path.write_text("\n".join([head, *rows[:99], head, *rows[99:]]) + "\n")


VICON = """Trajectories
1000
,,pen:tip,,,cap:top,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm"""


@kind("vicon.txt", channels=["position"], rate_hz=1000.0,
      columns={f"position_{axis}": f"pen:tip.{axis.upper()}" for axis in "xyz"})  # fmt: skip
def trajectories_of_vicon_above_its_devices(path):
    rows = [(n, 0, *row[1:], 0, 0, 0) for n, row in enumerate(rows_of(motion))]
    below = ["", "Devices", "2000", "Frame,Sub Frame,Fx", ",,N", "1,0,7", "1,1,7"]
    lines(path, VICON, [*rows, *(line.split(",") for line in below)])


@kind("devices.csv", channels=ONLY_FORCE, rate_hz=1000.0)
def devices_of_vicon_above_trajectories_that_begin_hidden(path):
    head = "Devices\n1000\n,,Plate,,,Plate,,\nFrame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz\n"
    rows = [(n, 0, *row[1:], 0, 0, 0) for n, row in enumerate(rows_of(force))]
    below = [*VICON.splitlines(), "0,0,,,,1,2,3", *("1,0,1,2,3,1,2,3" for _ in TIME_S)]
    units = ",,N,N,N,N.mm,N.mm,N.mm"
    lines(path, head + units, [*rows, *(line.split(",") for line in below)])


@kind("qualisys.tsv", channels=["position"])
def markers_of_qualisys(path):
    head = "NO_OF_FRAMES\t2000\nTIME_STAMP\t2026-01-01, 10:00:00.000\t123.4\nMARKER_NAMES\ttip\n"
    rows = ((n, *row) for n, row in enumerate(rows_of(motion)))
    lines(path, f"{head}Frame\tTime\ttip X\ttip Y\ttip Z", rows, "\t")


@kind("m.csv", "Meters", 1e-3, False, channels=["position"])
@kind("inches.csv", "Inches", 1 / 25.4, True, channels=["position"])
def a_rigid_body_of_motive(path, unit, scale, angles):
    """As OptiTrack's Motive writes it, with or without its rotation."""
    over = [*["Rotation"] * (4 * angles), *["Position"] * 3]
    axes = [*"XYZW"[: 4 * angles], *"XYZ"]
    head = f"Format Version,1.23,Capture Frame Rate,1000.0,Length Units,{unit},Rotation Type,XYZ"
    named = [["", "Type", *["Rigid Body"] * len(axes)], ["", "Name", *["Tool"] * len(axes)],
             ["", "", *over], ["Frame", "Time (Seconds)", *axes]]  # fmt: skip
    turns = [1.0, 0.0, 0.0, 0.0][: 4 * angles]
    rows = ((n, t, *turns, *(scale * p for p in ps)) for n, (t, *ps) in enumerate(rows_of(motion)))
    lines(path, "\n".join([head, "", *map(",".join, named)]), rows)


@kind("labview.lvm", "", channels=["force", "acceleration"])
@kind("comment.lvm", "\tComment", channels=["force", "acceleration"])
def a_labview_file_with_units_in_its_heading(path, comment):
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    head += "Channels\t6\t\nY_Unit_Label" + "\tmN" * 3 + "\tg" * 3
    head += "\nDelta_X" + "\t0.001" * 6 + "\n***End_of_Header***\t\t\n"
    names = "\t".join(["X_Value", "Fx", "Fy", "Fz", "accX", "accY", "accZ"])
    values = np.column_stack([TIME_S, 1e3 * force(TIME_S), vibration(TIME_S) / 9.80665])
    lines(path, f"{head}{names}{comment}", values.tolist(), "\t")


@kind("seconds.csv", "header.stamp.sec", "header.stamp.nanosec", 1e9)
@kind("tv.csv", "tv_sec", "tv_usec", 1e6)
@kind("milliseconds.csv", "Seconds", "Milliseconds", 1e3)
@kind("microseconds.csv", "sec", "microseconds", 1e6)
def with_seconds_and_their_parts(path, seconds, fraction, ticks):
    parts = ("pose.position", "wrench.force", "linear_acceleration")
    names = [seconds, fraction, *(f"{part}.{axis}" for part in parts for axis in "xyz")]
    rows = enumerate(rows_of(*TRUTH.values()))
    cells = ((1.7e9 + n // 1000, round(n % 1000 / 1e3 * ticks), *row[1:]) for n, row in rows)
    lines(path, ",".join(names), cells)


def pandas_json(path, form, encoding):
    """A table as pandas writes it by `form`, rows below their names, or one by dates."""
    names, rows = ["t", *NAMED.values()], rows_of(force)
    objects = [dict(zip(names, row, strict=True)) for row in rows]
    content = {
        "columns": {name: {str(n): row[name] for n, row in enumerate(objects)} for name in names},
        "index": {str(n): row for n, row in enumerate(objects)},
        "split": {"columns": names, "index": list(range(len(rows))), "data": rows},
        "rows": [names, *rows],
        "dated": {f"{9 + 1e3 * row.pop('t'):.0f}": row for row in map(dict, objects)},
    }[form]
    path.write_text(json.dumps(content), encoding)


for form in ("columns", "index", "split", "rows"):
    kind(f"{form}.json", form, "utf-8-sig", channels=ONLY_FORCE)(pandas_json)
kind("utf-16.json", "split", "utf-16", channels=ONLY_FORCE)(pandas_json)
kind("dated.json", "dated", "utf-8", channels=ONLY_FORCE,
     columns={"time": "index"}, units={"time": "ms"})(pandas_json)  # fmt: skip


TIMES = {
    "numbers": TIME_S,
    "column": TIME_S[:, None],
    "dates": np.array(DAYS_END, dtype="M8[us]"),
    "durations": np.round(TIME_S * 1e6).astype("m8[us]"),
    "texts": np.array([f"{time_s:.6f}" for time_s in TIME_S]),
    "texts of dates": np.array(DATES),
    "decimals": np.array([Decimal(n) / 1000 for n in range(len(TIME_S))]),
}


def with_times_and_vectors(path, times):
    vectors = force(TIME_S) if path.suffix == ".parquet" else force(TIME_S).T
    write_columns(path, {"t": TIMES[times], "force": vectors})


LACKING = {"npz": ("decimals",), "h5": ("dates", "durations", "decimals"), "parquet": ("column",)}
"""Forms of times that a kind of file cannot hold."""

for suffix, lacking in LACKING.items():
    for times in (each for each in TIMES if each not in lacking):
        kind(f"{times}.{suffix}", times, channels=ONLY_FORCE)(with_times_and_vectors)


@kind("rooms.h5", "oak", "pine")
@kind("asked.h5", "action", "observation")
def groups_that_hold_the_same_channels(path, other, whole):
    """Of two trials one lacks a channel; what was asked for is no trial."""
    with hdf5(path) as file:
        for number, name in enumerate((other, whole)):
            file[f"{name}/t"] = TIME_S
            for channel in list(TRUTH)[: 2 + number]:
                file[f"{name}/{channel}"] = TRUTH[channel](TIME_S) - 5 * (name == other)


@kind("structures.h5", channels=ONLY_FORCE)
def structures_within_structures(path):
    table = np.zeros(len(TIME_S), [("t", "f8"), ("tip", [("force", [(a, "f8") for a in "xyz"])])])
    table["t"] = TIME_S
    for axis, column in zip("xyz", force(TIME_S).T, strict=True):
        table["tip"]["force"][axis] = column
    with hdf5(path) as file:
        file["log"] = table


@kind("structures.parquet", channels=ONLY_FORCE)
def structures_of_parquet(path):
    tips = [{"force": dict(zip("xyz", row[1:], strict=True))} for row in rows_of(force)]
    write_columns(path, {"t": TIME_S, "tip": tips})


@kind("one cell.xlsx", "A1", channels=ONLY_FORCE)
@kind("few cells.xlsx", "A1:B20", channels=ONLY_FORCE)
@kind("many cells.xlsx", "A1:Z9999", channels=ONLY_FORCE)
def workbook_that_states_another_size(path, stated):
    columns = np.column_stack([TIME_S, force(TIME_S)]).T
    whole = path.with_name("whole.xlsx")
    to_workbook(whole, dict(zip(("t", *NAMED.values()), columns, strict=True)), {})
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content, size = source.read(name), f'ref="{stated}"'.encode()
            target.writestr(name, re.sub(rb'ref="A1:D\d+"', size, content))


SENSORS = {"acc": vibration, "force": force, "pos": motion}


def readings():
    """Rows of three sensors, each at its times: time, sensor and three numbers."""
    for row, time_s in enumerate(TIME_S):
        for sensor, every, late_s in (("acc", 1, 0.0), ("force", 2, 2e-4), ("pos", 4, 3e-4)):
            if row % every == 0:
                t = round(time_s + late_s, 6)
                yield t, sensor, *np.round(SENSORS[sensor](np.array([t]))[0], 6).tolist()


def axes_of(row):
    return dict(zip("xyz", row[2:], strict=True))


@kind("tidy.csv")
def tidy(path):
    lines(path, "time,topic,x,y,z", readings())


@kind("tidy first.csv")
def tidy_with_texts(path):
    lines(path, "topic,t,x,y,z,note", ((r[1], r[0], *r[2:], "fine") for r in readings()))


@kind("tidy axis.csv")
def tidy_by_axis(path):
    each = ((r[0], r[1], axis.upper(), v) for r in readings() for axis, v in axes_of(r).items())
    lines(path, "timestamp;sensor;axis;value", each, ";")


@kind("molten.csv")
def molten(path):
    """As `pandas.melt` writes it: the rows of one sensor after those of another, with units."""
    scales = {"acc": (1 / 9.80665, "g"), "force": (1e3, "mN"), "pos": (1e-3, "m")}
    rows = ((r[1], r[0], place, r[2 + place]) for r in readings() for place in range(3))
    each = (
        (t, f"{s}_{'xyz'[place]}", value * scales[s][0], scales[s][1])
        for s, t, place, value in sorted(rows, key=lambda r: (r[0], r[2], r[1]))
    )
    lines(path, "time,variable,value,unit", each)


@kind("longer.csv", "_")
@kind("paths.csv", ".")
def pivoted(path, sign):
    """As databases, R's pivot_longer and Foxglove write it."""
    each = ((r[0], f"{r[1]}{sign}{a}", v) for r in readings() for a, v in axes_of(r).items())
    lines(path, "_time,_field,_value", each)


@kind("blanks.csv")
def with_blanks_for_others(path):
    """Columns of all sensors, of which each row has those of its own, and texts."""
    cells = (
        (r[0], r[1], *(f"{v}" if r[1] == s else "" for s in SENSORS for v in r[2:]), "fine")
        for r in readings()
    )
    lines(path, "t,device,ax,ay,az,fx,fy,fz,px,py,pz,note", cells)


@kind("tidy.jsonl")
@kind("lines.json")
def tidy_rows_of_json(path):
    rows = ({"time": r[0], "topic": r[1], **axes_of(r)} for r in readings())
    path.write_text("\n".join(map(json.dumps, rows)))


@kind("lists.jsonl")
def lists_of_sensors_in_any_order(path):
    rows = []
    for place, time_s in enumerate(TIME_S):
        read = ((n, n, *made(np.array([time_s]))[0].tolist()) for n, made in SENSORS.items())
        sensors = [{"name": r[0], **axes_of(r)} for r in read]
        rows.append({"t": time_s, "sensors": sensors[:: 1 if place % 3 else -1]})
    path.write_text("\n".join(map(json.dumps, rows)))


@kind("vectors.mcap", lambda r: [{"sensor": r[1], **axes_of(r), "temperature": 20.0}])
@kind("lists.mcap", lambda r: [{"topic": f"/{r[1]}", "value": r[2:]}])
@kind("within.mcap", lambda r: [{"meta": {"device": r[1]}, "data": axes_of(r)}])
@kind("axes.mcap", lambda r: [{"node": r[1], "data": {"axis": a, "value": v}}
                              for a, v in axes_of(r).items()])  # fmt: skip
@kind("own.mcap", lambda r: [{"sensor": r[1], **{r[1][0] + a: v for a, v in axes_of(r).items()}}])
def tidy_messages(path, messages):
    """Messages of a topic that several sensors share."""
    pytest.importorskip("rosbags", reason="needs the extra 'import'")
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        topic = writer.register_channel("/readings", "json", 0)
        for row in readings():
            for message in messages(row):
                at_ns = 1_765_000_000_000_000_000 + round(row[0] * 1e9)
                writer.add_message(topic, at_ns, json.dumps(message).encode(), at_ns)
        writer.finish()


VALUES = ("value", "f8", (3,))


@kind("tidy.npy")
def tidy_array(path):
    dtype = [("time", "f8"), ("sensor", "S8"), VALUES]
    np.save(path, np.array([(r[0], r[1], r[2:]) for r in readings()], dtype=dtype))


@kind("fields.npz")
def tidy_archive(path):
    """Structured arrays in an archive: a table of two sensors, one of a third, and an object."""
    dtype = [("time", "f8"), ("sensor", "S8"), VALUES]
    slow = np.array([(r[0], r[1], r[2:]) for r in readings() if r[1] != "acc"], dtype=dtype)
    fast = np.array([(r[0], (r[2:],)) for r in readings() if r[1] == "acc"],
                    dtype=[("t", "f8"), ("data", [("acc", "f8", (3,))])])  # fmt: skip
    np.savez_compressed(path, log=slow, imu=fast, note=np.array({"by": "ATI"}, dtype=object))


@kind("structures.mat")
def tidy_structures(path):
    dtype = [(name, object) for name in ("t", "sensor", "x", "y", "z")]
    savemat(path, {"log": np.array(list(readings()), dtype=dtype)})


@kind("tables.h5")
def two_tables(path):
    """A table of two sensors, one of a third alone, and sets that hold no numbers."""
    rows = list(readings())
    with hdf5(path) as file:
        axes = [(axis, "f8") for axis in "xyz"]
        slow = [(r[0], r[1].encode(), *r[2:]) for r in rows if r[1] != "acc"]
        file["run/motion"] = np.array(slow, dtype=[("time", "f8"), ("sensor", "S8"), *axes])
        fast = [(r[0], *r[2:]) for r in rows if r[1] == "acc"]
        file["acc"] = np.array(fast, dtype=[("time", "f8"), *axes])
        file["channel"] = np.array([["a", "b"]], dtype="S1")


@kind("pickled.h5")
def tidy_frame(path):
    """As pandas stores a frame with a column of texts, which PyTables pickles."""
    rows = list(readings())
    texts = np.array([("fine", r[1], None) for r in rows], dtype=object)
    with hdf5(path) as file:
        group = file.create_group("log")
        group["axis1"], group["block0_values"] = range(len(rows)), [(r[0], *r[2:]) for r in rows]
        group["block0_items"] = np.array(["t", *"xyz"], dtype="S")
        pickled(group, texts, ["note", "sensor", "remark"])


def pickled(group, array, names, protocol=pickle.HIGHEST_PROTOCOL):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    group["block1_items"] = np.array(names, dtype="S")
    code = np.frombuffer(pickle.dumps(np.asfortranarray(array), protocol), np.uint8)
    stored = group.create_dataset("block1_values", (1,), h5py.vlen_dtype(np.uint8))
    stored[0], stored.attrs["PSEUDOATOM"] = code, np.bytes_(b"object")


@pytest.mark.parametrize("name", KINDS)
def test_a_recording_comes_in_as_it_was_made(tmp_path, name):
    make, channels, given = KINDS[name]
    make(tmp_path / name)
    session = imported(tmp_path / name, **given)
    time_s = session.frames["time_ns"] / 1e9
    assert set(session.channels) == channels
    assert len(time_s) == pytest.approx(len(TIME_S), abs=6)
    for channel in channels:
        found = session.frames[FIELDS[channel]].reshape(-1, 3)
        np.testing.assert_allclose(found, TRUTH[channel](time_s), atol=2e-3)


def of_two_units(path):
    lines(path, "time,Fz", [(f"{t:.3f}", "7 mN" if t > 1 else "1.5 N") for t in TIME_S])


def of_many_sensors(path):
    lines(path, "time,topic,value", ((row, f"s{row % 300}", 1.0) for row in range(3000)))


def of_a_sensor_in_two_units(path):
    rows = ((t, "Fz" if t else "ax", 1, "N" if row % 3 else "mN") for row, t in enumerate(TIME_S))
    lines(path, "time,signal,value,unit", [*rows, *((t, "ax", 1, "g") for t in TIME_S)])


def of_rows_in_two_units(path):
    lines(path, "time,Fz,unit", [(t, 1, "mN" if t > 1 else "N") for t in TIME_S])


def with_decimal_commas(path):
    cells = np.column_stack([TIME_S, force(TIME_S)])
    lines(path, "time_s,Fx,Fy,Fz", ([f"{c:.3f}".replace(".", ",") for c in row] for row in cells))


REFUSED = {
    "commas.csv": (with_decimal_commas, "8 cells for 4 names.* semicolons or tabs between"),
    "lines.txt": (tidy_rows_of_json, "its lines are JSON: it is read if it is called .jsonl"),
    "rows.csv": (of_rows_in_two_units, "the table is in N and in mN: keep one"),
    "many.csv": (of_many_sensors, "topic tells 300 sensors apart.* keep what is needed"),
    "mixed.csv": (of_a_sensor_in_two_units, "ax is in g and in mN: keep one"),
    "two units.csv": (of_two_units, r"Fz are written with N or with mN"),
}


def an_object(name, kind):
    """A variable of a class, as MATLAB stores it: its content is elsewhere in the file."""

    def part(tag, data):
        return struct.pack("<II", tag, len(data)) + data + b"\0" * (-len(data) % 8)

    place = part(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    shape = part(5, struct.pack("<ii", 6, 1))
    numbers = part(14, part(6, struct.pack("<II", 13, 0)) + shape + part(1, b"") + place)
    texts = b"".join(part(1, text.encode()) for text in (name, "MCOS", kind))
    return part(14, part(6, struct.pack("<II", 17, 0)) + texts + numbers)


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize("kind", ["timetable", "duration"])
def test_objects_of_matlab_are_left_out_with_a_word(tmp_path, version, kind):
    path = tmp_path / "a.mat"
    if version == "5":
        savemat(path, {"t": TIME_S, "force": force(TIME_S)})
        path.write_bytes(path.read_bytes() + an_object("first", kind) + an_object("TT", kind))
    else:
        with hdf5(path, userblock_size=512) as file:
            file["t"], file["force"], file["TT"] = TIME_S[None], force(TIME_S).T, np.ones((1, 6))
            file["TT"].attrs.update(MATLAB_class=np.bytes_(kind), MATLAB_object_decode=3)
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    proposal = propose(path)
    assert set(proposal.names) == {"t", "force"}
    assert any(note.startswith(f"TT is a {kind} of MATLAB") for note in proposal.columns.notes)
    assert len(imported(path).frames) == len(TIME_S)


@pytest.mark.parametrize("name", REFUSED)
def test_a_recording_that_cannot_be_read_right_is_refused(tmp_path, name):
    make, reason = REFUSED[name]
    make(tmp_path / name)
    with pytest.raises(InputError, match=reason):
        imported(tmp_path / name)


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("time,mode,Fz", lambda i, t: (t, "force" if i // 99 % 2 else "position", t)),
        ("time,sensor,Fz", lambda _, t: (t, "ATI", t)),
        ("time,channel,Fz", lambda i, t: (t, i * 7919 % 4096, t)),
        ("time,signal,Fz", lambda i, t: (t, i % 2, t)),
        ("time,axis,Fz", lambda _, t: (t, 3, t)),
        ("time,source,Fz", lambda i, t: (t, "auto" if i // 99 % 2 else "manual", t)),
        ("time,marker,Fz", lambda i, t: (t, {99: "start", 999: "stop"}.get(i, ""), t)),
    ],
)
def test_a_column_that_tells_no_sensors_apart_is_let_alone(tmp_path, head, row):
    lines(tmp_path / "a.csv", head, (row(i, t) for i, t in enumerate(TIME_S)))
    names = propose(tmp_path / "a.csv").names
    assert list(names) == head.split(",")


ASIDE = {
    "a unit": np.array("N"),
    "units of members": np.array(["s", "mm", "N"]),
    "units in a table": np.array([["s", "mm"], ["N", "V"]]),
    "an object": np.array({"name": "ATI"}, dtype=object),
    "complex": np.exp(1j * TIME_S),
    "records": np.zeros(3, dtype=[("gain", "f8"), ("id", "i4")]),
    "a few numbers": np.arange(3),
    "pairs": np.arange(2 * len(TIME_S)).reshape(-1, 2) % 2,
    "a state": np.arange(len(TIME_S)) % 2,
    "words": np.array(["ok", "fault"])[np.arange(len(TIME_S)) % 2],
    "one unit": np.full(len(TIME_S), "mN"),
}


@pytest.mark.parametrize("value", ASIDE)
@pytest.mark.parametrize("name", ["unit", "sensor", "channel", "Units"])
def test_what_stands_beside_whole_channels_changes_nothing(tmp_path, name, value):
    named = {FIELDS[channel]: made(TIME_S) for channel, made in TRUTH.items()}
    np.savez(tmp_path / "a.npz", time_s=TIME_S, **named)
    np.savez(tmp_path / "b.npz", time_s=TIME_S, **named, **{name: ASIDE[value]})
    plain, beside = (import_session(tmp_path / each).frames for each in ("a.npz", "b.npz"))
    np.testing.assert_array_equal(beside, plain)


def test_two_arms_that_take_turns_are_told_apart(tmp_path):
    for late_s in (0.0, 5e-4):
        rows = (
            (t + late_s * arm, arm, 9 * arm + t, t, t, arm - t, 0, t)
            for t in TIME_S
            for arm in (0, 1)
        )
        lines(tmp_path / "a.csv", "t,device,px,py,pz,fx,fy,fz", rows)
        assert "device_1.px" in propose(tmp_path / "a.csv").names


@pytest.mark.parametrize("state", [lambda i: i % 2, lambda i: i // 300 % 2])
def test_a_state_beside_several_channels_tells_no_arms_apart(tmp_path, state):
    press = [5.0 * (i // 300 % 2) for i in range(len(TIME_S))]
    rows = ((t, state(i), t, t, t, 0, 0, press[i]) for i, t in enumerate(TIME_S))
    lines(tmp_path / "a.csv", "t,device,px,py,pz,fx,fy,fz", rows)
    assert "px" in propose(tmp_path / "a.csv").names


def in_a_group_with_its_unit(path, unit):
    """Forces in mN, or others, as the members of a group or structure that has a unit."""
    members = {"time": TIME_S, **dict(zip("xyz", 1e3 * force(TIME_S).T, strict=True)), **unit}
    if path.suffix == ".mat":
        savemat(path, {"force": members})
    elif path.suffix == ".json":
        path.write_text(json.dumps({"force": members}, default=np.ndarray.tolist))
    else:
        with hdf5(path) as file:
            group = file.create_group("force")
            for name, values in members.items():
                where = group.attrs if name in unit and path.suffix == ".h5" else group
                where[name] = values


@pytest.mark.parametrize("name", ["a.mat", "a.json", "a.h5", "a.hdf5"])
@pytest.mark.parametrize("unit", ["unit", "Units"])
def test_the_unit_of_a_group_is_that_of_its_columns(tmp_path, name, unit):
    in_a_group_with_its_unit(tmp_path / name, {unit: "mN"})
    frames = imported(tmp_path / name).frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)
    in_a_group_with_its_unit(tmp_path / name, {unit: "V"})
    with pytest.raises(InputError, match="which is in 'V' by the file"):
        import_recording(tmp_path / name, propose(tmp_path / name).options)


def units_beside_rows(path, units):
    """Forces in mN, or others, as rows of JSON beside their units, or behind these."""
    rows = [
        {"t": t, "force": (1e3 * fs).tolist()} for t, fs in zip(TIME_S, force(TIME_S), strict=True)
    ]
    whole = {"about": units, "rows": rows}
    texts = map(json.dumps, [units, *rows] if path.suffix == ".jsonl" else [whole])
    path.write_text("\n".join(texts))


def units_of_a_file(path, units):
    """The same with the units as attributes of the file, or in a group."""
    if path.suffix == ".mat":
        savemat(path, {"log": {"t": TIME_S, "force": 1e3 * force(TIME_S), **units}})
        return
    with hdf5(path) as file:
        file["t"], file["force"] = TIME_S, 1e3 * force(TIME_S)
        if "units" in units:
            file.update({f"units/{name}": unit for name, unit in units["units"].items()})
        else:
            file.attrs.update(units)


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.json", units_beside_rows), ("a.jsonl", units_beside_rows),
     ("a.h5", units_of_a_file), ("a.mat", units_of_a_file)],
)  # fmt: skip
@pytest.mark.parametrize("units", [{"force_unit": "mN"}, {"units": {"t": "s", "force": "mN"}}])
def test_units_that_are_named_beside_the_columns_are_theirs(tmp_path, name, write, units):
    write(tmp_path / name, units)
    frames = imported(tmp_path / name).frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)


@pytest.mark.parametrize(
    "head",
    ["Units: mN", "# Units: mN", "Unit,mN", "Date,2024-01-01\nForce Units,mN,Length Units,m",
     "force unit = mN\nrate,1000", "Sensor: ATI,,,\nUnits,mN,,", "# Forces in mN, all of them",
     "# tip,force in [mN].", "s,mN,mN,mN"],
)  # fmt: skip
def test_a_line_above_a_table_tells_its_unit(tmp_path, head):
    rows = ((t, *fs) for t, fs in zip(TIME_S, (1e3 * force(TIME_S)).tolist(), strict=True))
    lines(tmp_path / "a.csv", f"{head}\ntime,fx,fy,fz", rows)
    frames = imported(tmp_path / "a.csv").frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)
    text = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_text(text.replace("mN", "V"))
    with pytest.raises(InputError, match="which is in 'V' by the file"):
        import_recording(tmp_path / "a.csv", propose(tmp_path / "a.csv").options)


def test_each_column_may_have_a_column_of_its_unit(tmp_path):
    rows = zip(TIME_S, force(TIME_S) * [1e3, 1, 1e-3], strict=True)
    cells = ([t, *fs, "mN", "N", "kN"] for t, fs in rows)
    lines(tmp_path / "a.csv", "t,Fx,Fy,Fz,Fx_unit,fy_units,Fz_Unit", cells)
    frames = imported(tmp_path / "a.csv").frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)


@pytest.mark.parametrize("names", ["t,fx,fy,fz,unit", "t,fx,fy,fz,force_unit"])
def test_a_unit_of_all_rows_is_that_of_each_trial_and_sensor(tmp_path, names):
    rows = [(t, *(1e3 * fs), "mN") for t, fs in zip(TIME_S, force(TIME_S), strict=True)]
    lines(tmp_path / "a.csv", names, rows)
    np.testing.assert_allclose(
        imported(tmp_path / "a.csv").frames["force_n"], force(TIME_S), atol=1e-5
    )
    rows = [(t, s, 1e3 * t) for t in TIME_S for s in "ab"]
    lines(tmp_path / "b.csv", "Units: mN\ntime,sensor,fz", rows)
    rows = [(t, s, 1e3 * t) for s in "ab" for t in TIME_S]
    lines(tmp_path / "c.csv", "Units: mN\ntime,trial,fz", rows)
    for name, time, columns in (("b.csv", "b.time", "b.fz"), ("c.csv", "time", "fz")):
        options = ImportOptions({"time": time, "force": columns}, episode={"c.csv": "b"}.get(name))
        frames = import_recording(tmp_path / name, options)[0].frames
        np.testing.assert_allclose(frames["force_n"][:, 2], TIME_S, atol=1e-5)


def test_a_unit_beside_several_channels_is_told(tmp_path):
    units = np.array(["s", "mN", "mm"], dtype=object)
    savemat(tmp_path / "a.mat", {"force": force(TIME_S), "pos": motion(TIME_S), "unit": "N"})
    assert "unit was not taken for the unit" in str(propose(tmp_path / "a.mat").columns.notes)
    savemat(tmp_path / "a.mat", {"t": TIME_S, "force": force(TIME_S), "units": units})
    assert "units was not taken for the unit" in str(propose(tmp_path / "a.mat").columns.notes)


def test_two_columns_of_units_are_no_unit(tmp_path):
    rows = ([t, *fs, "mN", "N"] for t, fs in zip(TIME_S, force(TIME_S), strict=True))
    lines(tmp_path / "a.csv", "time,fx,fy,fz,unit,Units", rows)
    frames = imported(tmp_path / "a.csv").frames
    time_s = frames["time_ns"] / 1e9
    np.testing.assert_allclose(frames["force_n"], force(time_s), atol=2e-3)


def test_rows_that_name_no_sensor_are_left_out_with_a_word(tmp_path):
    rows = [(t, ("acc", "force", "")[i % 3 if t < 1.5 else 2], t) for i, t in enumerate(TIME_S)]
    lines(tmp_path / "a.csv", "time,sensor,value", rows)
    found = propose(tmp_path / "a.csv")
    assert found.names == ["acc.time", "acc.value", "force.time", "force.value"]
    assert "1000 rows that name none were left out" in str(found.columns.notes)


def test_numbers_of_sensors_are_names(tmp_path):
    lines(tmp_path / "a.csv", "t,channel,value", ((t, c, c + t) for t in TIME_S for c in range(3)))
    columns = {"time": "channel_0.t", "force_x": "0", "force_y": "0", "force_z": "channel_2.value"}
    session = import_session(tmp_path / "a.csv", columns=columns)
    np.testing.assert_allclose(session.frames["force_n"][:, 2], 2 + TIME_S, atol=1e-6)


@pytest.mark.parametrize("ids", [range(17), range(1000, 1064), [20240101 + n for n in range(99)]])
@pytest.mark.parametrize("molten", [True, False])
def test_any_number_of_sensors_can_be_told_apart_by_numbers(tmp_path, ids, molten):
    rows = [(t, s, place + t) for t in TIME_S[:100] for place, s in enumerate(ids)]
    rows = sorted(rows, key=lambda row: row[1]) if molten else rows
    lines(tmp_path / "a.csv", "t,sensor,value", rows)
    names = propose(tmp_path / "a.csv").names
    assert names == [f"sensor_{s}.{column}" for s in ids for column in ("t", "value")]


def test_readings_are_no_numbers_of_sensors(tmp_path):
    counts = np.rint(500 + 100 * np.sin(30 * TIME_S)).astype(int)
    lines(tmp_path / "a.csv", "time,sensor,Fz", zip(TIME_S, counts, TIME_S, strict=True))
    found = propose(tmp_path / "a.csv")
    assert found.names == ["time", "sensor", "Fz"]
    told = "sensor: its numbers, in few or many rows, are none of sensors"
    assert told in found.columns.notes


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [("gain", 0.5, True), ("Calibration", 2.0, True), ("offset", 0, False), ("note", 2.0, False),
     ("scale_factor", 2.0, False)],
)  # fmt: skip
def test_a_scale_that_is_not_applied_is_said(tmp_path, name, value, told):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"], file["force_n"] = TIME_S, force(TIME_S)
        file["force_n"].attrs[name] = value
    _, report = import_recording(tmp_path / "a.h5")
    assert any(f"force_n: its {name} {value} is not applied" in w for w in report.warnings) == told


@pytest.mark.parametrize("protocol", [2, 4, 5])
@pytest.mark.parametrize("kind", [float, int, lambda n: None if n > 1 else n, np.float64, bool])
def test_numbers_that_pandas_pickled_are_read_right_or_refused(tmp_path, protocol, kind):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    values = np.array([(kind(fz), "text") for fz in force(TIME_S)[:, 2].tolist()], dtype=object)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"] = TIME_S
        pickled(file, values, ["fz", "note"], protocol)
    options = ImportOptions({"force": "fz"}, blanks_as_gaps=True, longest_gap_s=9.0)
    if kind in (np.float64, bool):
        with pytest.raises(InputError, match="other than texts and numbers"):
            import_recording(tmp_path / "a.h5", options)
        return
    frames = import_recording(tmp_path / "a.h5", options)[0].frames
    made = np.array([np.nan if value is None else value for value, _ in values], dtype=float)
    rows = np.rint(frames["time_ns"] / 1e6).astype(int)
    found = np.where(np.isnan(made[rows]), np.nan, frames["force_n"][:, 2])
    np.testing.assert_allclose(found, made[rows], atol=1e-5)


@pytest.mark.parametrize(
    ("names", "told"), [("time,x,y,z", "nothing says that it is one"), ("fx,fy,fz", "than there")]
)
def test_axes_without_a_name_are_told(tmp_path, names, told):
    lines(tmp_path / "a.csv", names, ((t, t, t, t) for t in TIME_S))
    assert told in str(propose(tmp_path / "a.csv").columns.notes)


def test_a_labview_file_without_times_needs_a_rate(tmp_path):
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n\t\n"
    head += "Channels\t2\t\nSamples\t2000\t2000\nDelta_X\t0.001\t0.001\n***End_of_Header***\t\t\n"
    rows = ([f"\t{fx:.6f}", f"{fz:.6f}"] for fx, _, fz in force(TIME_S))
    lines(tmp_path / "a.lvm", f"{head}X_Value\tForce X\tForce Z", rows, "\t")
    proposal = propose(tmp_path / "a.lvm")
    with pytest.raises(InputError, match=r"its times .X_Value. 0.* give --rate HZ"):
        import_recording(tmp_path / "a.lvm", proposal.options)
    options = replace(proposal.options, rate_hz=1000.0)
    frames = import_recording(tmp_path / "a.lvm", options)[0].frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)


@pytest.mark.parametrize(
    ("head", "factor"),
    [("Scale factor: 0.001", "0.001"), ("Scale factor: 1e-3", "1e-3"), ("Scale factor: 1.0", "1.0"),
     ("Counts per Unit Force: 1000000", "1e-06"), ("Sensitivity (mV/g): 100", "0.01")],
)  # fmt: skip
def test_a_factor_above_a_table_is_told_and_not_applied(tmp_path, head, factor):
    rows = ((t, *fs) for t, fs in zip(TIME_S, force(TIME_S).tolist(), strict=True))
    lines(tmp_path / "a.csv", f"Rig 3\n{head}\ntime,fx,fy,fz", rows)
    _, report = import_recording(tmp_path / "a.csv", propose(tmp_path / "a.csv").options)
    told = f"line 2, '{head}', was not applied: --map TARGET=COLUMN*{factor} does so"
    assert (told in report.warnings) == (float(factor) != 1)


def test_names_that_are_more_than_columns_are_told_of(tmp_path):
    lines(tmp_path / "a.txt", "Time s Load N Pos mm", ((t, t, t) for t in TIME_S), " ")
    assert "6 names for 3 columns" in str(propose(tmp_path / "a.txt").columns.notes)


@pytest.mark.parametrize("names", ["Fn,Ft", "Normal force,ft", "normal_force,FT"])
def test_a_tangential_force_is_no_vector_of_a_sensor(tmp_path, names):
    lines(tmp_path / "a.csv", f"t,{names}", ((t, 1 + t, 9) for t in TIME_S))
    frames = imported(tmp_path / "a.csv").frames
    np.testing.assert_allclose(frames["force_n"][:, 2], 1 + TIME_S, atol=1e-5)


def test_a_last_line_that_ends_within_vectors_is_told_of(tmp_path):
    with_cells_of_several_numbers(tmp_path / "a.csv", "list", ";")
    whole = (tmp_path / "a.csv").read_text().splitlines()[:9]
    (tmp_path / "a.csv").write_text("\n".join([*whole, "0.008;[1 2];(3)"]))
    _, report = import_recording(tmp_path / "a.csv", propose(tmp_path / "a.csv").options)
    assert any("cut off" in warning for warning in report.warnings)
