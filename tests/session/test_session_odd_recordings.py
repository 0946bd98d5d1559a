"""Recordings as the programs of a laboratory write them come in as proposed, with right values."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording

pytestmark = pytest.mark.usefixtures("read_here")

TIME_S = np.arange(0.0, 2.0, 0.001)
"""Times of the rows of every file here, but those of tables with several sensors."""


def motion(time_s):
    return np.column_stack([40 * np.sin(4.4 * time_s), 2 * time_s, 5 * np.cos(3 * time_s)])


def force(time_s):
    return np.column_stack([0.3 * np.cos(4.4 * time_s), 0 * time_s, 1.5 + np.sin(1.9 * time_s)])


def vibration(time_s):
    return np.column_stack(
        [2 * np.sin(90 * time_s), 3 * np.cos(70 * time_s), 9.8 + np.sin(80 * time_s)]
    )


TRUTH = {"position": motion, "force": force, "acceleration": vibration}
FIELDS = {"position": "position_mm", "force": "force_n", "acceleration": "acceleration_m_s2"}


def lines(path, head, rows, sign=","):
    path.write_text("\n".join([head, *(sign.join(map(str, row)) for row in rows)]) + "\n")


def imported(path):
    """Import a file with the options that are proposed for it."""
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    return import_recording(path, proposal.options)[0]


def with_units(path):
    rows = zip(TIME_S, force(TIME_S), motion(TIME_S), strict=True)
    cells = ([f"{t:.3f} s", *(f"{f:.6f}N" for f in fs), *(f"{p:.4f} mm" for p in ps)]
             for t, fs, ps in rows)  # fmt: skip
    lines(path, "time;Fx;Fy;Fz;px;py;pz", cells, ";")


def in_a_column_of_units(path):
    rows = zip(TIME_S, 1e3 * force(TIME_S), strict=True)
    lines(path, "time,fx,fy,fz,Units", ([t, *fs, "mN"] for t, fs in rows))


def in_hexadecimals(path):
    counts = np.rint(1000 * vibration(TIME_S)).astype(int)
    cells = ([f"0x{round(1e6 * t):08X}", *(f"0x{c & 0xFFFF:04x}" for c in row)]
             for t, row in zip(TIME_S, counts.tolist(), strict=True))  # fmt: skip
    lines(path, "t_us,ax_mm_s2,ay_mm_s2,az_mm_s2", cells)


def readings(values):
    """Rows of three sensors, each at its times: time, sensor and three numbers."""
    for row, time_s in enumerate(TIME_S):
        for sensor, every, late_s in (("acc", 1, 0.0), ("force", 2, 2e-4), ("pos", 4, 3e-4)):
            if row % every == 0:
                t = round(time_s + late_s, 6)
                yield t, sensor, *np.round(values[sensor](np.array([t]))[0], 6).tolist()


SENSORS = {"acc": vibration, "force": force, "pos": motion}


def tidy(path):
    lines(path, "time,topic,x,y,z", readings(SENSORS))


def tidy_with_texts(path):
    lines(path, "topic,t,x,y,z,note", ((r[1], r[0], *r[2:], "fine") for r in readings(SENSORS)))


def tidy_by_axis(path):
    each = (
        (r[0], r[1], axis, value)
        for r in readings(SENSORS)
        for axis, value in zip("XYZ", r[2:], strict=True)
    )
    lines(path, "timestamp;sensor;axis;value", each, ";")


def molten(path):
    """As `pandas.melt` writes it: the rows of one sensor after those of another, with units."""
    scales = {"acc": (1 / 9.80665, "g"), "force": (1e3, "mN"), "pos": (1e-3, "m")}
    rows = ((r[1], r[0], place, r[2 + place]) for r in readings(SENSORS) for place in range(3))
    each = (
        (t, f"{s}_{'xyz'[place]}", value * scales[s][0], scales[s][1])
        for s, t, place, value in sorted(rows, key=lambda r: (r[0], r[2], r[1]))
    )
    lines(path, "time,variable,value,unit", each)


def pivoted(path):
    """As databases and R's pivot_longer write it."""
    each = (
        (r[0], f"{r[1]}_{axis}", v) for r in readings(SENSORS) for axis, v in axes_of(r).items()
    )
    lines(path, "_time,_field,_value", each)


def tidy_rows_of_json(path):
    names = ("time", "topic", "x", "y", "z")
    path.write_text(
        "\n".join(json.dumps(dict(zip(names, r, strict=True))) for r in readings(SENSORS))
    )


def axes_of(row):
    return dict(zip("xyz", row[2:], strict=True))


MESSAGES = {
    "vectors": lambda r: [{"sensor": r[1], **axes_of(r), "temperature": 20.0}],
    "lists": lambda r: [{"topic": f"/{r[1]}", "value": r[2:]}],
    "within": lambda r: [{"meta": {"device": r[1]}, "data": axes_of(r)}],
    "axes": lambda r: [
        {"node": r[1], "data": {"axis": a, "value": v}} for a, v in axes_of(r).items()
    ],
    "own fields": lambda r: [{"sensor": r[1], **{r[1][0] + a: v for a, v in axes_of(r).items()}}],
}
"""A reading as messages of a topic that several sensors share."""


def tidy_messages(form):
    def write(path):
        pytest.importorskip("rosbags", reason="needs the extra 'import'")
        from mcap.writer import Writer

        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            topic = writer.register_channel("/readings", "json", 0)
            for row in readings(SENSORS):
                for message in MESSAGES[form](row):
                    at_ns = 1_765_000_000_000_000_000 + round(row[0] * 1e9)
                    writer.add_message(topic, at_ns, json.dumps(message).encode(), at_ns)
            writer.finish()

    return write


def tidy_objects_of_json(path):
    rows = ({"t": r[0], "meta": {"sensor": r[1]}, "data": axes_of(r)} for r in readings(SENSORS))
    path.write_text("\n".join(map(json.dumps, rows)))


def lists_of_sensors_in_any_order(path):
    rows = []
    for place, time_s in enumerate(TIME_S):
        read = ((n, n, *made(np.array([time_s]))[0].tolist()) for n, made in SENSORS.items())
        sensors = [{"name": r[0], **axes_of(r)} for r in read]
        rows.append({"t": time_s, "sensors": sensors[:: 1 if place % 3 else -1]})
    path.write_text("\n".join(map(json.dumps, rows)))


def tidy_array(path):
    kind = [("time", "f8"), ("sensor", "S8"), ("value", "f8", (3,))]
    np.save(path, np.array([(r[0], r[1], r[2:]) for r in readings(SENSORS)], dtype=kind))


def tidy_array_of_structures(path):
    kind = [("head", [("time", "f8"), ("sensor", "U8")]), ("value", "f8", (3,))]
    np.save(path, np.array([((r[0], r[1]), r[2:]) for r in readings(SENSORS)], dtype=kind))


def tidy_archive(path):
    """Structured arrays in an archive: a table of two sensors, one of a third, and an object."""
    kind = [("time", "f8"), ("sensor", "S8"), ("value", "f8", (3,))]
    slow = np.array([(r[0], r[1], r[2:]) for r in readings(SENSORS) if r[1] != "acc"], dtype=kind)
    fast = np.array([(r[0], (r[2:],)) for r in readings(SENSORS) if r[1] == "acc"],
                    dtype=[("t", "f8"), ("data", [("acc", "f8", (3,))])])  # fmt: skip
    np.savez_compressed(path, log=slow, imu=fast, note=np.array({"by": "ATI"}, dtype=object))


def tidy_arrays(path):
    rows = list(readings(SENSORS))
    np.savez(path, time=[r[0] for r in rows], topic=[r[1] for r in rows], xyz=[r[2:] for r in rows])


def tidy_structures(path):
    kind = [(name, object) for name in ("t", "sensor", "x", "y", "z")]
    savemat(path, {"log": np.array(list(readings(SENSORS)), dtype=kind)})


def two_tables(path):
    """A table of two sensors, one of a third alone, and sets that hold no numbers."""
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    kind = [("time", "f8"), ("sensor", h5py.string_dtype()), *((a, "f8") for a in "xyz")]
    rows = list(readings(SENSORS))
    with h5py.File(path, "w") as file:
        file["run/motion"] = np.array([r for r in rows if r[1] != "acc"], dtype=kind)
        fast = [(r[0], *r[2:]) for r in rows if r[1] == "acc"]
        file["acc"] = np.array(fast, dtype=[("time", "f8"), *((a, "f8") for a in "xyz")])
        file["channel"] = np.array([["a", "b"]], dtype="S1")


def tidy_sets(path):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    rows = list(readings(SENSORS))
    with h5py.File(path, "w") as file:
        group = file.create_group("log")
        group["t"], group["xyz"] = [r[0] for r in rows], [r[2:] for r in rows]
        group["sensor"] = [r[1] for r in rows]


def tidy_parquet(path):
    pa = pytest.importorskip("pyarrow", reason="needs the extra 'export'")
    import pyarrow.parquet

    columns = list(zip(*readings(SENSORS), strict=True))
    named = dict(zip(("time", "topic", "x", "y", "z"), columns, strict=True))
    named["topic"] = pa.array(named["topic"]).dictionary_encode()
    pyarrow.parquet.write_table(pa.table(named), path)


def with_blanks_for_others(path):
    """Columns of all sensors, of which each row has those of its own, and texts."""
    cells = (
        (r[0], r[1], *(f"{v}" if r[1] == s else "" for s in SENSORS for v in r[2:]), "fine")
        for r in readings(SENSORS)
    )
    lines(path, "t,device,ax,ay,az,fx,fy,fz,px,py,pz,note", cells)


def with_times_first(path):
    """As Simulink's block To File and QUARC write them: a row for the time and each element."""
    matrices = {"pos": motion(TIME_S), "force": np.column_stack([force(TIME_S), motion(TIME_S)])}
    savemat(path, {name: np.vstack([TIME_S, values.T]) for name, values in matrices.items()})


def dataset_of_structures(path):
    series = {"Time": TIME_S[:, None], "Data": force(TIME_S)}
    savemat(path, {"logsout": {"force": {"Values": series}, "Name": "logsout"}})


def with_a_title_before_the_units(path):
    head = "Sampling rate (Hz);1000\nabs time (s);Fx;Fy;Fz\nUnits:;N;N;N"
    cells = ((t, *row) for t, row in zip(TIME_S, force(TIME_S).tolist(), strict=True))
    lines(path, head, cells, ";")


def each_channel(times, head=""):
    """Return a writer of rows with all channels, behind times in any form."""

    def write(path):
        values = np.hstack([made(TIME_S) for made in TRUTH.values()]).tolist()
        lines(path, head, ((t, *row) for t, row in zip(times, values, strict=True)))

    return write


AXES = ",x,y,z" * 3
LEVELS = "".join(f",{channel}" * 3 for channel in TRUTH)
DATES = [f"2026-05-01 10:00:{time_s:09.6f}" for time_s in TIME_S]


def frame(fixed):
    """Return a writer of what pandas stores, as arrays with their columns' names or as a table."""

    def write(path):
        h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
        names = [c[0] + axis for c in TRUTH for axis in "xyz"]
        values = np.hstack([made(TIME_S) for made in TRUTH.values()])
        with h5py.File(path, "w") as file:
            group = file.create_group("log")
            if fixed:
                group["axis1"], group["block0_values"] = TIME_S, values
                group["axis1"].attrs["name"] = np.bytes_(b"time")
                group["block0_items"] = np.array(names, dtype="S")
                return
            kind = [("index", "i8"), ("block", "f8", (1,)), ("values_block_1", "f8", (9,))]
            rows = zip(range(len(TIME_S)), TIME_S[:, None], values, strict=True)
            group["table"] = np.array(list(rows), dtype=kind)
            for field, told in (("block", ["t"]), ("values_block_1", names)):
                group["table"].attrs[f"{field}_kind"] = np.bytes_(pickle.dumps(told, protocol=0))

    return write


def tidy_frame(path):
    """As pandas stores a frame with a column of texts, which PyTables pickles."""
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    rows = list(readings(SENSORS))
    texts = np.array([("fine", r[1], None) for r in rows], dtype=object)
    with h5py.File(path, "w") as file:
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


def with_vectors_of_unity(path):
    rows = zip(TIME_S, motion(TIME_S).tolist(), force(TIME_S).tolist(), strict=True)
    lines(path, "Time,Position,Force", ((t, tuple(p), tuple(f)) for t, p, f in rows))


def behind_arduinos_time(path):
    texts = ((f"10:30:{t:06.3f} -> {ax}", ay, az) for t, (ax, ay, az) in
             zip(TIME_S, vibration(TIME_S).tolist(), strict=True))  # fmt: skip
    lines(path, "10:30:00.000 -> ax,ay,az", texts)


def in_sections(path):
    each = (np.column_stack([TIME_S, made(TIME_S)]).tolist() for made in (force, motion))
    texts = ["\n".join(",".join(map(str, row)) for row in rows) for rows in each]
    path.write_text(f"[Force]\nt,x,y,z\n{texts[0]}\n[Camera]\nt,x,y,z\n{texts[1]}\n")


ALL = set(TRUTH)
KINDS = {
    "tidy.csv": (tidy, ALL),
    "tidy first.csv": (tidy_with_texts, ALL),
    "tidy axis.csv": (tidy_by_axis, ALL),
    "molten.csv": (molten, ALL),
    "tidy.jsonl": (tidy_rows_of_json, ALL),
    "objects.jsonl": (tidy_objects_of_json, ALL),
    "lists.jsonl": (lists_of_sensors_in_any_order, ALL),
    **{f"{form}.mcap": (tidy_messages(form), ALL) for form in MESSAGES},
    "tables.h5": (two_tables, ALL),
    "sets.h5": (tidy_sets, ALL),
    "fixed.h5": (frame(fixed=True), ALL),
    "frame.h5": (frame(fixed=False), ALL),
    "texts.h5": (tidy_frame, ALL),
    "lines.json": (tidy_rows_of_json, ALL),
    "longer.csv": (pivoted, ALL),
    "structures.mat": (tidy_structures, ALL),
    "tidy.npy": (tidy_array, ALL),
    "within.npy": (tidy_array_of_structures, ALL),
    "tidy.npz": (tidy_arrays, ALL),
    "fields.npz": (tidy_archive, ALL),
    "tidy.parquet": (tidy_parquet, ALL),
    "blanks.csv": (with_blanks_for_others, ALL),
    "first.mat": (with_times_first, {"position", "force"}),
    "dataset.mat": (dataset_of_structures, {"force"}),
    "levels.csv": (each_channel(TIME_S, f"{LEVELS}\n{AXES}\nstamp{',' * 9}"), ALL),
    "merged.csv": (each_channel(1e3 * TIME_S, f"Time{LEVELS}\nms{AXES}"), ALL),
    "index.csv": (each_channel(DATES, ",px,py,pz,fx,fy,fz,ax,ay,az"), ALL),
    "unity.csv": (with_vectors_of_unity, {"position", "force"}),
    "arduino.log": (behind_arduinos_time, {"acceleration"}),
    "force.csv": (in_sections, {"force"}),
    "title.txt": (with_a_title_before_the_units, {"force"}),
    "a column.csv": (in_a_column_of_units, {"force"}),
    "units.log": (with_units, {"position", "force"}),
    "hex.csv": (in_hexadecimals, {"acceleration"}),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_recording_comes_in_as_it_was_made(tmp_path, name):
    make, channels = KINDS[name]
    make(tmp_path / name)
    session = imported(tmp_path / name)
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


REFUSED = {
    "lines.txt": (tidy_rows_of_json, "its lines are JSON: it is read if it is called .jsonl"),
    "rows.csv": (of_rows_in_two_units, "the table is in N and in mN: keep one"),
    "many.csv": (of_many_sensors, "topic tells 300 sensors apart.* keep what is needed"),
    "mixed.csv": (of_a_sensor_in_two_units, "ax is in g and in mN: keep one"),
    "two units.csv": (of_two_units, r"Fz are written with N or with mN"),
}


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


def in_a_group_with_its_unit(path, unit, **others):
    """Forces in mN, or others, as the members of a group or structure that has a unit."""
    axes = dict(zip("xyz", 1e3 * force(TIME_S).T, strict=True))
    content = {"force": {"time": TIME_S, **axes, **unit}, **others}
    if path.suffix == ".mat":
        savemat(path, content)
    elif path.suffix == ".json":
        path.write_text(json.dumps(content, default=np.ndarray.tolist))
    else:
        h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
        with h5py.File(path, "w") as file:
            for name, values in content["force"].items():
                if name in unit and path.suffix == ".h5":
                    file["force"].attrs[name] = values
                else:
                    file[f"force/{name}"] = values


@pytest.mark.parametrize("name", ["a.mat", "a.json", "a.h5", "a.hdf5"])
@pytest.mark.parametrize("unit", ["unit", "Units"])
def test_the_unit_of_a_group_is_that_of_its_columns(tmp_path, name, unit):
    in_a_group_with_its_unit(tmp_path / name, {unit: "mN"})
    frames = imported(tmp_path / name).frames
    np.testing.assert_allclose(frames["force_n"], force(TIME_S), atol=1e-5)
    in_a_group_with_its_unit(tmp_path / name, {unit: "V"})
    with pytest.raises(InputError, match="which is in 'V' by the file"):
        import_recording(tmp_path / name, propose(tmp_path / name).options)


@pytest.mark.parametrize(
    "head",
    ["Units: mN", "# Units: mN", "Unit,mN", "Date,2024-01-01\nForce Units,mN,Length Units,m",
     "force unit = mN\nrate,1000", "Sensor: ATI,,,\nUnits,mN,,", "# Forces in mN, all of them",
     "# tip,force in [mN]."],
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


@pytest.mark.parametrize(
    ("unit", "scale"), [("Millimeters", 1), ("Meters", 1e-3), ("Inches", 1 / 25.4)]
)
@pytest.mark.parametrize("angles", [True, False])
def test_the_unit_of_length_in_motives_head_is_heeded(tmp_path, unit, scale, angles):
    """As OptiTrack's Motive writes a rigid body, with or without its rotation."""
    over = [*["Rotation"] * (4 * angles), *["Position"] * 3]
    axes = [*"XYZW"[: 4 * angles], *"XYZ"]
    head = f"Format Version,1.23,Capture Frame Rate,1000.0,Length Units,{unit},Rotation Type,XYZ"
    named = [["", "Type", *["Rigid Body"] * len(axes)], ["", "Name", *["Tool"] * len(axes)],
             ["", "", *over], ["Frame", "Time (Seconds)", *axes]]  # fmt: skip
    turns = [1.0, 0.0, 0.0, 0.0][: 4 * angles]
    each = zip(TIME_S, (scale * motion(TIME_S)).tolist(), strict=True)
    head = "\n".join([head, "", *map(",".join, named)])
    lines(tmp_path / "a.csv", head, ((i, t, *turns, *p) for i, (t, p) in enumerate(each)))
    frames = imported(tmp_path / "a.csv").frames
    np.testing.assert_allclose(frames["position_mm"], motion(TIME_S), atol=1e-4)


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


def test_a_number_has_no_underscores(tmp_path):
    lines(tmp_path / "a.csv", "Date,Fz", ((f"20240301_1000{int(t):02}", t) for t in TIME_S))
    with pytest.raises(InputError, match="Date does not hold numbers: '20240301_100000'"):
        import_session(tmp_path / "a.csv", columns={"time": "Date", "force": "Fz"})


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


def test_axes_without_a_name_are_told(tmp_path):
    lines(tmp_path / "a.csv", "time,x,y,z", ((t, t, t, t) for t in TIME_S))
    assert "nothing says that it is one" in str(propose(tmp_path / "a.csv").columns.notes)


@pytest.mark.parametrize("comment", ["", "\tComment"])
def test_the_units_in_a_labview_files_heading_are_heeded(tmp_path, comment):
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    head += "Channels\t2\t\nY_Unit_Label\tmN\tg\nDelta_X\t0.001\t0.001\n***End_of_Header***\t\t\n"
    rows = zip(TIME_S, 1e3 * force(TIME_S)[:, 2], vibration(TIME_S)[:, 2] / 9.80665, strict=True)
    lines(tmp_path / "a.lvm", f"{head}X_Value\tFz\taccZ{comment}", rows, "\t")
    frames = imported(tmp_path / "a.lvm").frames
    np.testing.assert_allclose(frames["force_n"][:, 2], force(TIME_S)[:, 2], atol=1e-5)
    found = frames["acceleration_m_s2"][:, 2]
    np.testing.assert_allclose(found, vibration(TIME_S)[:, 2], atol=1e-5)


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


@pytest.mark.parametrize("factor", ["0.001", "1e-3", "1.0"])
def test_a_factor_above_a_table_is_told_and_not_applied(tmp_path, factor):
    rows = ((t, *fs) for t, fs in zip(TIME_S, force(TIME_S).tolist(), strict=True))
    lines(tmp_path / "a.csv", f"Rig 3\nScale factor: {factor}\ntime,fx,fy,fz", rows)
    _, report = import_recording(tmp_path / "a.csv", propose(tmp_path / "a.csv").options)
    told = (
        f"line 2, 'Scale factor: {factor}', was not applied: --map TARGET=COLUMN*{factor} does so"
    )
    assert (told in report.warnings) == (float(factor) != 1)
