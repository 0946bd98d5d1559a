"""Every kind of file, written with any names, units, order and holes, is read as it was meant."""

import gzip
import json
import re
import zipfile
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import scipy.io
import scipy.io.wavfile
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from unit_samples import FOREIGN, UNITS

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.readers.table import read_table
from mmt.session.importing.recording import import_recording

pytestmark = pytest.mark.usefixtures("read_here")

ROWS = 300
TIME_S = np.arange(ROWS) / 1000
POSITION_MM = np.column_stack([30 * np.sin(5 * TIME_S), 10 * TIME_S, 0.3 * np.cos(3 * TIME_S)])
FORCE_N = np.column_stack([0.1 * np.cos(5 * TIME_S), 0.2 * TIME_S, 1 + 0.5 * np.sin(2 * TIME_S)])
ACCELERATION_M_S2 = np.random.default_rng(1).standard_normal((ROWS, 3)) + np.array([0.0, 0.0, 9.81])

CHANNELS = {"position": POSITION_MM, "force": FORCE_N, "acceleration": ACCELERATION_M_S2}
TRUTH = {
    "time": TIME_S,
    **{f"{c}_{axis}": v[:, place] for c, v in CHANNELS.items() for place, axis in enumerate("xyz")},
}
"""By target."""

a_unit = st.fixed_dictionaries(
    {target: st.sampled_from(sorted(UNITS[target.split("_")[0]])) for target in TRUTH}
)
an_order = st.permutations(list(TRUTH))


def in_file(target, unit):
    """Return a target's values as they stand in a file in this unit."""
    return TRUTH[target] / UNITS[target.split("_")[0]][unit]


def name_of(target):
    return f"c{list(TRUTH).index(target)}q"


def check(frames, rtol=1e-5):
    assert len(frames) == ROWS
    for channel, field in zip(
        CHANNELS, ("position_mm", "force_n", "acceleration_m_s2"), strict=True
    ):
        np.testing.assert_allclose(frames[field], CHANNELS[channel], rtol=rtol, atol=1e-4)


def text(columns, header, sep, comma, above):
    lines = [*above, *(sep.join(row) for row in header)]
    for row in np.column_stack(columns).tolist():
        cells = (f"{value:.12g}" for value in row)
        lines.append(sep.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return "\n".join(lines) + "\n"


@given(
    units=a_unit,
    order=an_order,
    style=st.sampled_from(["brackets", "round", "row"]),
    sep=st.sampled_from([",", ";", "\t", "|", " ", "   "]),
    comma=st.booleans(),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    packed=st.booleans(),
    above=st.lists(
        st.sampled_from(["Sample rate,1000", "12000", "# at 22 °C: 3, 4", "", "Run;7;8", "a b c"]),
        max_size=12,
    ),
)
@settings(max_examples=30)
def test_text_of_any_form_is_read_in_its_units(
    units, order, style, sep, comma, encoding, packed, above
):
    mark = {"brackets": "{}[{}]", "round": "{}({})", "row": "{}"}[style]
    header = [[mark.format(name_of(target), units[target]) for target in order]]
    if style == "row":
        header.append([units[target] for target in order])
    content = text(
        [in_file(target, units[target]) for target in order],
        header,
        sep,
        comma and sep != ",",
        above,
    )
    if encoding == "cp1252":  # which has only one of the two letters
        content = content.replace("\u03bc", "\u00b5")
    content = content.encode(encoding)
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("a.csv.gz" if packed else "a.txt")
        path.write_bytes(gzip.compress(content) if packed else content)
        check(import_session(path, columns={target: name_of(target) for target in TRUTH}).frames)


def write_npz(path, columns, units):
    np.savez(path, **{f"{name}_{units[name]}": values for name, values in columns.items()})
    return {name: f"{name}_{units[name]}" for name in columns}


def write_npy(path, columns, units):
    names = {name: f"{name}_{units[name]}" for name in columns}
    table = np.zeros(ROWS, dtype=[(names[name], "f8") for name in columns])
    for name, values in columns.items():
        table[names[name]] = values
    np.save(path, table)
    return names


def write_mat(path, columns, units):
    structure = {f"{name}_{units[name]}": values for name, values in columns.items()}
    scipy.io.savemat(path, {"run": structure, "note": "rough wood"})
    return {name: f"run.{name}_{units[name]}" for name in columns}


def write_h5(path, columns, units):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"run/{name}"] = values
            file[f"run/{name}"].attrs["units"] = units[name]
    return {name: f"run.{name}" for name in columns}


def write_xlsx(path, columns, units):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.create_sheet("notes")
    for row in [["Run 7", 12], list(columns), [units[name] for name in columns]]:
        book.active.append(row)
    for row in np.column_stack(list(columns.values())).tolist():
        book.active.append(row)
    book.save(path)
    return {name: name for name in columns}


def write_parquet(path, columns, units):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    names = {name: f"{name}_{units[name]}" for name in columns}
    parquet.write_table(
        pyarrow.table({names[name]: values for name, values in columns.items()}), path
    )
    return names


def write_tdms(path, columns, units):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("run", name, values, {"unit_string": units[name]})
                for name, values in columns.items()
            ]
        )
    return {name: name for name in columns}


def write_json(path, columns, units):
    names = {name: f"{name}_{units[name]}" for name in columns}
    lists = {names[name]: values.tolist() for name, values in columns.items()}
    path.write_text(json.dumps({"run": lists}))
    return {name: f"run.{told}" for name, told in names.items()}


def write_jsonl(path, columns, units):
    names = {name: f"{name}_{units[name]}" for name in columns}
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [json.dumps({"run": dict(zip(names.values(), row, strict=True))}) for row in rows]
    path.write_text("\n".join(lines))
    return {name: f"run.{told}" for name, told in names.items()}


WRITERS = {
    "json": write_json,
    "jsonl": write_jsonl,
    "npz": write_npz,
    "npy": write_npy,
    "mat": write_mat,
    "h5": write_h5,
    "xlsx": write_xlsx,
    "parquet": write_parquet,
    "tdms": write_tdms,
}
TELLING = ("h5", "tdms", "xlsx")
"""Kinds that tell units apart from names."""


@pytest.mark.parametrize("kind", WRITERS)
@given(units=a_unit, order=an_order)
@settings(max_examples=8)
def test_each_kind_of_file_is_read_in_the_units_that_it_tells(kind, units, order):
    """By attribute, by a row of units, or by the ends of the names."""
    if kind not in TELLING:
        plain = {"time": "ms", "position": "um", "force": "mN", "acceleration": "mg"}
        units = {target: plain[target.split("_")[0]] for target in units}
    columns = {name_of(target): in_file(target, units[target]) for target in order}
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{kind}"
        names = WRITERS[kind](path, columns, {name_of(t): unit for t, unit in units.items()})
        check(import_session(path, columns={t: names[name_of(t)] for t in TRUTH}).frames)


@pytest.mark.parametrize("target", ["time", "position_y", "force_z", "acceleration_x"])
@pytest.mark.parametrize("kind", ["csv", *WRITERS])
def test_a_unit_of_something_else_is_refused_by_name_or_scaled(tmp_path, kind, target):
    unit = FOREIGN[target.split("_")[0]]
    units = dict.fromkeys(map(name_of, TRUTH), "") | {name_of(target): unit}
    own = {"time": "s", "position": "mm", "force": "N", "acceleration": "m/s2"}
    units |= {name_of(t): own[t.split("_")[0]] for t in TRUTH if t != target}
    columns = {name_of(t): values for t, values in TRUTH.items()}
    columns[name_of(target)] = columns[name_of(target)] / 2.5
    path = tmp_path / f"a.{kind}"
    if kind == "csv":
        header = [[f"{name} ({units[name]})" for name in columns]]
        path.write_text(text(list(columns.values()), header, ",", comma=False, above=[]))
        names = {name: name for name in columns}
    else:
        units = units | {
            name: unit.replace("/", "_") for name, unit in units.items() if kind not in TELLING
        }
        names = WRITERS[kind](path, columns, units)
    mapped = {t: names[name_of(t)] for t in TRUTH}
    with pytest.raises(InputError, match=rf"{target} is mapped to .* in '{unit}' by the file"):
        import_session(path, columns=mapped)
    check(import_session(path, columns={**mapped, target: f"{mapped[target]}*2.5"}).frames)
    unit_said = {target: own[target.split("_")[0]]}
    options = ImportOptions({**mapped, target: f"{mapped[target]}*2.5"}, unit_said)
    check(import_recording(path, options)[0].frames)


def test_objects_and_lists_of_json_are_columns(tmp_path):
    rows = [
        {"t": at, "tip": {"p": [*place], "f": [{"n": z}]}, "a": a if a > -1 else None}
        for at, place, z, a in zip(
            TIME_S.tolist(),
            POSITION_MM.tolist(),
            FORCE_N[:, 2].tolist(),
            ACCELERATION_M_S2[:, 2].tolist(),
            strict=True,
        )
    ]
    lines = [json.dumps(row) for row in rows]
    lines[5] = lines[5].replace('"a"', '"a": NaN, "a"')
    columns = {"time": "t", "position": "tip.p", "force": "tip.f.0.n"}
    forms = [
        ("a.ndjson", "\n".join(lines)),
        ("a.json", f"[{','.join(lines)}]"),
        ("b.json", f'{{"about": {{"rate": [1000]}}, "rows": [{",".join(lines)}]}}'),
    ]
    for name, content in forms:
        (tmp_path / name).write_text(content)
        frames = import_session(tmp_path / name, columns=columns).frames
        np.testing.assert_allclose(frames["position_mm"], POSITION_MM, rtol=1e-6)
        np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
        assert propose(tmp_path / name).names == ["t", "tip.p", "tip.f.0.n", "a", "a.1", "a.2"]
    (tmp_path / "a.jsonl").write_text("\n".join(lines)[:-9])
    session, report = import_recording(tmp_path / "a.jsonl", ImportOptions(columns))
    assert len(session.frames) == ROWS - 1
    assert any("last line is cut off" in warning for warning in report.warnings)


def test_arrays_of_json_count_more_than_a_shorter_list_of_objects(tmp_path):
    content = {"t": TIME_S.tolist(), "f": FORCE_N.tolist(), "sensors": [{"name": "a"}] * 3}
    (tmp_path / "a.json").write_text(json.dumps(content))
    frames = import_session(tmp_path / "a.json", columns={"time": "t", "force": "f"}).frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8"])
@pytest.mark.parametrize("form", ["columns", "index", "split", "rows", "dated"])
def test_the_forms_of_json_that_pandas_writes_are_tables(tmp_path, form, encoding):
    names = ["t", "fx", "fy", "fz"]
    rows = np.column_stack([TIME_S, FORCE_N]).tolist()
    objects = [dict(zip(names, row, strict=True)) for row in rows]
    content = {
        "columns": {
            name: {str(n): row[i] for n, row in enumerate(rows)} for i, name in enumerate(names)
        },
        "index": {str(n): row for n, row in enumerate(objects)},
        "split": {"columns": names, "index": list(range(ROWS)), "data": rows},
        "rows": [names, *rows],
        "dated": {
            f"{9 + 1e3 * row[0]:.0f}": {"fx": row[1], "fy": row[2], "fz": row[3]} for row in rows
        },
    }[form]
    (tmp_path / "a.json").write_text(json.dumps(content), encoding)
    if form == "dated":
        mapped = {"time": "index", "force_x": "fx", "force_y": "fy", "force_z": "fz"}
        frames = import_session(tmp_path / "a.json", columns=mapped, units={"time": "ms"}).frames
    else:
        proposed = propose(tmp_path / "a.json")
        assert proposed.names == names
        frames = import_recording(tmp_path / "a.json", proposed.options)[0].frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("separator", [None, "comma", "semicolon", "tab"])
@pytest.mark.parametrize(
    "form", ["t: {:.6f} X: {:.6f} Y: {:.6f} Z: {:.6f} N", "t={},X={},Y={},Z={} N"]
)
def test_lines_that_name_each_of_their_values_are_a_table(tmp_path, form, separator):
    rows = np.round(np.column_stack([TIME_S, FORCE_N]), 6)
    lines = [form.format(*row) for row in rows.tolist()]
    (tmp_path / "a.txt").write_text("\n".join(["# a sketch", *lines, "X: 1"]))
    columns = {"time": "t", **{f"force_{axis}": axis.upper() for axis in "xyz"}}
    read = import_recording(tmp_path / "a.txt", ImportOptions(columns, separator=separator))
    np.testing.assert_allclose(read[0].frames["force_n"], rows[:, 1:], rtol=1e-6)
    assert any(note.startswith("each line names its values") for note in read[1].warnings)


def test_a_table_of_pandas_may_have_a_column_without_a_name(tmp_path):
    content = {"columns": ["t", ""], "index": [0, 1, 2], "data": [[0, 1], [0.001, 2], [0.002, 3]]}
    (tmp_path / "a.json").write_text(json.dumps(content))
    assert propose(tmp_path / "a.json").names == ["t", "2"]
    found = import_session(tmp_path / "a.json", columns={"time": "t", "force": "2"})
    assert found.frames["force_n"][:, 2].tolist() == [1.0, 2.0, 3.0]
    content["data"][1].append(4)
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(
        InputError, match="row 2 is not a list of as many values as there are names"
    ):
        import_session(tmp_path / "a.json", columns={"time": "t", "force": "2"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{}\n[1, 2]\n", "row 2 is not an object"),
        ("[0, 1]\n[1]\n", "row 2 is not a list of as many values as the first"),
        ('{"t": 0}\n{"t": \n{"t": 1}', "line 2 is not JSON"),
        ('{"t": 0}\n{"t": [0]}', "lists of t are not all of one length"),
        ('{"t": [0]}\n{"t": [0, 1]}', "lists of t are not all of one length"),
        ('{"t": {}}\n{"t": "soon"}', "t does not hold numbers: .*soon"),
        ("[" * 100_000, "this is not JSON"),
        ("", "t, which is not there"),
    ],
)
def test_json_of_another_form_is_refused(tmp_path, content, message):
    (tmp_path / "a.jsonl").write_text(content)
    with pytest.raises(InputError, match=message):
        import_session(tmp_path / "a.jsonl", columns={"time": "t", "force_z": "t"})


def test_waveforms_of_tdms_have_their_own_times(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    begin = np.datetime64("2026-01-31T23:59:59.900000")

    def wave(group, name, values, rate_hz, after_ms):
        about = {
            "wf_increment": 1 / rate_hz,
            "wf_start_time": begin + np.timedelta64(after_ms, "ms"),
        }
        return nptdms.ChannelObject(group, name, values, about)

    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([wave("ni", "z", np.sin(0.1 * np.arange(2 * ROWS)), 2000, 0)])
        writer.write_segment([wave("arm", "z", FORCE_N[:, 2], 1000, 50)])
        writer.write_segment([nptdms.ChannelObject("arm", "note", ["a", "b"])])
    columns = {"acceleration": "ni.z", "force": "arm.z"}
    session = import_session(tmp_path / "a.tdms", columns=columns)
    assert session.began_utc_ns == (begin + np.timedelta64(50, "ms")).astype("M8[ns]").astype(int)
    force = session.frames["force_n"][:, 2]
    np.testing.assert_allclose(force, FORCE_N[: len(force), 2], rtol=1e-6)
    assert propose(tmp_path / "a.tdms").names == ["ni.z", "arm.z", "arm.note"]
    (tmp_path / "a.tdms").write_bytes(b"TDSm" + bytes(24) + b"x" * 40)
    with pytest.raises(InputError, match="not a TDMS file"):
        import_session(tmp_path / "a.tdms", columns=columns)


@pytest.mark.parametrize("holder", ["channel", "group", "file"])
@pytest.mark.parametrize(
    ("kind", "status"), [("Linear", ""), ("PieceWise", "unscaled"), ("PieceWise", "scaled")]
)
def test_raw_values_of_an_unknown_scale_need_a_factor(tmp_path, holder, kind, status):
    nptdms = pytest.importorskip("nptdms")
    scale = {"Scale_Type": kind, "Linear_Slope": 0.5, "Linear_Y_Intercept": 0.0}
    about = {f"NI_Scale[0]_{name}": value for name, value in scale.items()}
    about |= {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}
    about |= {"NI_Scaling_Status": status} if status else {}
    told = {h: about if h == holder else {} for h in ("channel", "group", "file")}
    own = {"wf_increment": 0.001, "unit_string": "N", **told["channel"]}
    raw = np.rint(1000 * FORCE_N[:, 2])
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        objects = [nptdms.RootObject(told["file"]), nptdms.GroupObject("ni", told["group"])]
        writer.write_segment([*objects, nptdms.ChannelObject("ni", "Fz", raw, own)])
    factor = {"Linear": 0.5, "PieceWise": 1.0}[kind]
    if (kind, status) == ("PieceWise", "unscaled"):
        with pytest.raises(InputError, match="raw values, its scale is of an unknown kind: Piece"):
            import_session(tmp_path / "a.tdms", columns={"force": "Fz"})
        factor, columns = 0.001, {"force": "Fz*0.001"}
    else:
        columns = {"force": "Fz"}
    frames = import_session(tmp_path / "a.tdms", columns=columns).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], factor * raw, rtol=1e-6)


def test_a_workbook_beside_a_text_keeps_its_numbers(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["t", "x", "y", "touches"])
    for row in np.column_stack([TIME_S, FORCE_N[:, :2]]).tolist():
        book.active.append([*row, row[0] > 0.1])
    book.save(tmp_path / "f.xlsx")
    lines = [f"{at:.9g};{z:.9g}" for at, z in zip(TIME_S, ACCELERATION_M_S2[:, 2], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["t;a", *lines]).replace(".", ","))
    columns = {f"force_{axis}": f"f.xlsx:{axis}" for axis in "xy"}
    columns |= {"force_z": "f.xlsx:touches", "force_time": "f.xlsx:t"}
    columns |= {"acceleration": "a.csv:a", "acceleration_time": "a.csv:t"}
    paths = [tmp_path / "f.xlsx", tmp_path / "a.csv"]
    frames = import_session(paths, columns=columns, decimal=",").frames
    expected = np.column_stack([FORCE_N[:, :2], TIME_S > 0.1])
    np.testing.assert_allclose(frames["force_n"], expected, rtol=1e-6)
    np.testing.assert_allclose(
        frames["acceleration_m_s2"][:, 2], ACCELERATION_M_S2[:, 2], rtol=1e-6
    )


def printed(values, form):
    """Return numbers as NumPy or Python print them, or as a cell of a table with commas."""
    if form == "array":
        return str(np.round(values, 6))
    text = str([round(float(value), 6) for value in values])
    forms = {"list": text, "tuple": f"({text[1:-1]})", "cell": f'"{text}"'}
    return {**forms, "tensor": f'"tensor({text})"', "dtype": f'"np.array({text}, dtype=f4)"'}[form]


@pytest.mark.parametrize(
    ("form", "sign"),
    [
        *(("array", ","), ("array", ";"), ("list", "\t"), ("tuple", ";"), ("cell", ",")),
        *(("tensor", ","), ("dtype", ",")),
    ],
)
def test_a_cell_of_several_numbers_is_a_vector(tmp_path, form, sign):
    rows = [
        sign.join([f"{when:.3f}", printed(position, form), printed(force, form)])
        for when, position, force in zip(TIME_S, POSITION_MM, FORCE_N, strict=True)
    ]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([sign.join(["t", "pos", "force"]), *rows]))
    found = propose(path).options
    assert found.columns == {"time": "t", "position": "pos", "force": "force"}
    frames = import_session(path, columns=found.columns).frames
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM, atol=1e-5)
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-5)
    path.write_text("\n".join([*path.read_text().splitlines()[:9], f"0.008{sign}[1 2]{sign}(3)"]))
    report = import_recording(path, found)[1]
    assert any("cut off" in warning for warning in report.warnings)


@pytest.mark.parametrize("form", ["list", "tuple", "array"])
def test_lists_printed_a_line_each_are_rows(tmp_path, form):
    rows = [printed(row, form) for row in np.column_stack([TIME_S, FORCE_N])]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(rows))
    columns = {"time": "1", "force_x": "2", "force_y": "3", "force_z": "4"}
    frames = import_session(path, columns=columns).frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-5)


def test_the_segments_of_a_labview_file_follow_each_other(tmp_path):
    heading = "Channels\t1\nSamples\t100\nDate\t2026/05/01\n***End_of_Header***\nX_Value\tFz\n"
    rows = [f"{when:.3f}\t{force:.9g}\n" for when, force in zip(TIME_S, FORCE_N[:, 2], strict=True)]
    parts = [heading + "".join(rows[begin : begin + 100]) for begin in range(0, ROWS, 100)]
    top = "LabVIEW Measurement\nDate\t2026/05/01\n***End_of_Header***\n\n"
    path = tmp_path / "a.lvm"
    path.write_text(top + "\n".join(parts))
    frames = import_session(path, columns={"time": "X_Value", "force": "Fz"}).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
    path.write_text(path.read_text().replace(rows[250], "0.250\toops\n"))
    number = path.read_text().splitlines().index("0.250\toops") + 1
    with pytest.raises(InputError, match=f"Fz is 'oops' in line {number}"):
        import_session(path, columns={"time": "X_Value", "force": "Fz"})


@pytest.mark.parametrize("imaginary", [0.0, 1e-9])
def test_complex_numbers_without_an_imaginary_part_are_numbers(tmp_path, imaginary):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": TIME_S, "force": FORCE_N + 1j * imaginary})
    columns = {"time": "t", "force": "force"}
    if imaginary:
        with pytest.raises(InputError, match="force holds complex128, not numbers"):
            import_session(path, columns=columns)
    else:
        assert propose(path).options.columns == columns
        frames = import_session(path, columns=columns).frames
        np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


def rows_of(path, header, columns):
    path.write_text(text(columns, [header], ",", comma=False, above=[]), encoding="utf-8")
    return path


def test_numbers_are_columns_where_columns_are_numbered(tmp_path):
    columns = {"time": "1", "force_x": "2", "force_y": "3", "force_z": "4"}
    path = tmp_path / "a.csv"
    path.write_text(text([TIME_S, *FORCE_N.T], [], ",", comma=False, above=[]))
    np.testing.assert_allclose(import_session(path, columns=columns).frames["force_n"], FORCE_N)
    rows_of(path, ["0", "1", "2", "3"], [TIME_S, *FORCE_N.T])
    zero = import_session(
        path, columns={"time": "0", "force_z": "3", "force_x": "1", "force_y": "2"}
    )
    np.testing.assert_allclose(zero.frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("again", [True, False])
def test_a_recorder_that_began_anew_gives_both_parts(tmp_path, again):
    lines, others = (
        text([TIME_S, part], [["t", "Fz"]], ",", comma=False, above=[]).splitlines()
        for part in (FORCE_N[:, 2], FORCE_N[:, 2] + 1)
    )
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*lines, *(others if again else others[1:])]))
    session, report = import_recording(path, ImportOptions({"time": "t", "force": "Fz"}))
    assert len(session.frames) == 2 * ROWS
    both_n = [*FORCE_N[:, 2], *FORCE_N[:, 2] + 1]
    np.testing.assert_allclose(session.frames["force_n"][:, 2], both_n, rtol=1e-6)
    assert any("begins anew" in warning for warning in report.warnings)
    assert any("1 lines of text were left out" in warning for warning in report.warnings) == again


@pytest.mark.parametrize("names", ["t,Fz", "Frame,X", "note,left"])
def test_a_second_table_of_as_many_columns_is_left_out(tmp_path, names):
    path = table_of(tmp_path / "a.csv", TIME_S)
    later = [f"{when:.3f},7" for when in TIME_S + 1]
    path.write_text("\n".join([path.read_text(), names, "s,N", *later]))
    options = ImportOptions({"time": "t", "force": "Fz"})
    session, report = import_recording(path, options)
    goes_on = names == "t,Fz"
    assert (session.frames["force_n"][-1, 2] == 7) == goes_on
    said = f"another table begins above line {ROWS + 4}: it was left out, as all below"
    assert (said in report.warnings) != goes_on


@pytest.mark.parametrize("keys", [("Name=", "Range=", "Unit="), ("", "", ""), ("t", "", "s")])
def test_settings_of_the_columns_are_no_names(tmp_path, keys):
    above = ["Interval=\t0.001 s"]
    header = [*zip(keys, ["Fz", "10 V", "mN"], ["Acc", "±2.5 V", "g"], strict=True)]
    columns = [TIME_S, 1e3 * FORCE_N[:, 2], ACCELERATION_M_S2[:, 2] / 9.80665]
    path = tmp_path / "a.txt"
    path.write_text(text(columns, header, "\t", comma=False, above=above), encoding="utf-8")
    found = propose(path)
    first = keys[0].rstrip("=") if keys[0] == "t" else "1"
    assert found.names == [first, "Fz", "Acc"]
    frames = import_session(path, columns={**found.options.columns, "time": first}).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-5)
    np.testing.assert_allclose(
        frames["acceleration_m_s2"][:, 2], ACCELERATION_M_S2[:, 2], rtol=1e-5
    )


@pytest.mark.parametrize(
    ("rows", "begins"),
    [
        (["0.000 sx,1.5 Nx", "0.001 sx,1.5 Nx"], "0.000 sx"),
        (["00q,1Fq", "01q,2Aq"], "00q"),
    ],
)
def test_a_table_without_plain_numbers_is_refused_with_its_first_cell(tmp_path, rows, begins):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["t,Fz", *rows]))
    with pytest.raises(InputError, match="no line holds numbers alone; the first, line 2") as error:
        import_session(path, columns={"time": "t", "force": "Fz"})
    assert f"begins with {begins!r}" in str(error.value)


@pytest.mark.parametrize(
    "form",
    [
        *("%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ", "%d.%m.%Y %H:%M:%S.%f"),
        *("%d-%b-%Y %H:%M:%S.%f", "%H:%M:%S.%f"),
    ],
)
def test_dates_and_times_of_day_are_times(tmp_path, form):
    stamps = (
        np.datetime64("2026-01-31T23:59:59.800000") + (TIME_S * 1e6).astype("m8[us]")
    ).tolist()
    cells = [f"{stamp:{form}},{z:.9g}" for stamp, z in zip(stamps, FORCE_N[:, 2], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["when,Fz", *cells]))
    columns = {"time": "when", "force": "Fz"}
    frames = import_session(tmp_path / "a.csv", columns=columns, units={"time": "ms"}).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)


def test_a_sound_needs_the_factor_of_its_sensor(tmp_path):
    wave = np.column_stack([np.sin(0.3 * np.arange(8000)), np.zeros(8000)])
    for kind, full in (("i2", 32767), ("i4", 2**31 - 1), ("f4", 1.0)):
        scipy.io.wavfile.write(tmp_path / "a.wav", 8000, (0.5 * full * wave).astype(kind))
        with pytest.raises(InputError, match="1, which is in 'full scale'"):
            import_session(tmp_path / "a.wav", columns={"acceleration": "1"})
        frames = import_session(tmp_path / "a.wav", columns={"acceleration": "1*40"}).frames
        assert frames["acceleration_m_s2"][50:-50, 2].max() == pytest.approx(20, rel=0.05)


@pytest.mark.parametrize("lost", [0, 1, 1000])
@pytest.mark.parametrize("stated", ["all", "none", "endless"])
def test_a_sound_whose_recorder_died_is_read_as_far_as_it_goes(tmp_path, stated, lost):
    path = tmp_path / "a.wav"
    wave = np.rint(3e4 * np.sin(0.3 * np.arange(2000))).astype("i2")
    scipy.io.wavfile.write(path, 1000, wave)
    content = bytearray(path.read_bytes()[: -lost or None])
    size = {"all": 4000, "none": 0, "endless": 0xFFFFFFFF}[stated]
    content[40:44] = size.to_bytes(4, "little")
    path.write_bytes(content)
    session, report = import_recording(path, ImportOptions({"acceleration": "1*32768"}))
    kept = len(wave) - -(-lost // 2)
    np.testing.assert_array_equal(session.frames["acceleration_m_s2"][:, 2], wave[:kept])
    said = any("the file ends before its header says" in each for each in report.warnings)
    assert said == (lost > 0) or stated != "all"


@given(late_s=st.floats(-3, 3), seed=st.integers(0, 20))
@settings(max_examples=10)
def test_files_of_one_recording_are_joined_by_a_tap(late_s, seed):
    rng = np.random.default_rng(seed)
    slow_s, fast_s = np.arange(0, 12, 0.002), np.arange(0, 12, 1 / 4000)
    force_n = 1 + 0.01 * rng.standard_normal(len(slow_s)) + 9 * np.exp(-((slow_s - 5) ** 2) / 2e-5)
    shock = 50 * np.exp(-((fast_s - 5 - late_s) ** 2) / 8e-6)
    with TemporaryDirectory() as folder:
        np.savez(Path(folder) / "f.npz", t=slow_s, F=force_n)
        np.savez(Path(folder) / "a.npz", t=fast_s, a=shock + rng.standard_normal(len(fast_s)))
        paths = [Path(folder) / name for name in ("f.npz", "a.npz")]
        columns = {"force": "f.npz:F", "force_time": "f.npz:t"}
        columns |= {"acceleration": "a.npz:a", "acceleration_time": "a.npz:t"}
        joined = import_session(paths, columns=columns, offsets={"a.npz": "match"}).frames
        force_at, shock_at = (
            int(np.argmax(joined[name][:, 2])) for name in ("force_n", "acceleration_m_s2")
        )
        assert abs(force_at - shock_at) <= 4
        with pytest.raises(InputError, match="say of which file"):
            import_session(paths, columns={"force": "F"})


@given(
    blank=st.sets(st.integers(1, 998), max_size=30),
    fault=st.integers(1, 999),
    rows=st.integers(20, 2000),
)
@settings(max_examples=12)
def test_rows_of_several_files_are_called_by_their_own_lines(blank, fault, rows):
    time_s = np.arange(1000) / 500
    time_s[fault] = -1.0  # falls
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("f.csv", "a.csv")]
        forces = [f"{row / 400},1,1,1\n" for row in range(rows)]
        paths[0].write_text("t,fx,fy,fz\n" + "".join(forces))
        cells = ["" if row in blank - {fault} else row % 7 for row in range(1000)]
        lines = [f"{at},{cell},1,1\n" for at, cell in zip(time_s, cells, strict=True)]
        paths[1].write_text("recorded by A\n\nt,ax,ay,az\n" + "".join(lines))
        columns = {"force_time": "f.csv:t", "acceleration_time": "a.csv:t"}
        columns |= {f"force_{axis}": f"f.csv:f{axis}" for axis in "xyz"}
        columns |= {f"acceleration_{axis}": f"a.csv:a{axis}" for axis in "xyz"}
        for offset in ("match", "0.5"):
            options = ImportOptions(columns, blanks_as_gaps=True, offsets={"a.csv": offset})
            with pytest.raises(InputError, match=rf"a\.csv: .* in line {fault + 4}, after"):
                import_recording(paths, options)


def test_a_file_is_read_twice_for_a_proposal_once_for_its_names(tmp_path, monkeypatch):
    force_n = np.where(np.arange(ROWS) == 9, np.nan, FORCE_N[:, 2])
    path = rows_of(tmp_path / "a.csv", ["t (us)", "Fz"], [1e6 * TIME_S, force_n])
    read = []

    def noting(*arguments):
        read.append(arguments[0])
        return read_table(*arguments)

    monkeypatch.setattr("mmt.session.importing.readers.text_file.read_table", noting)
    proposal, report, error = try_proposal(path, propose(path))
    assert (error, len(read)) == (None, 2)
    assert report.channels[0].rows == ROWS - 1
    assert proposal.options.blanks_as_gaps


@given(
    order=st.permutations(["t", "fx", "fy", "fz", "ax", "ay", "az", "x", "y", "z", "note"]),
    unit=st.sampled_from(["", " [m]", "_um", " (inch)"]),
    holes=st.booleans(),
)
@settings(max_examples=15)
def test_what_is_proposed_runs(order, unit, holes):
    named = dict(
        zip(["t", *(f"{q}{axis}" for q in ("", "f", "a") for axis in "xyz")], TRUTH, strict=True)
    )
    header = [name + unit if name in ("x", "y", "z") else name for name in order]
    scale = {"": 1.0, " [m]": 1e3, "_um": 1e-3, " (inch)": 25.4}[unit]
    columns = [TRUTH.get(named.get(name, ""), TIME_S) for name in order]
    columns = [
        c / scale if n in ("x", "y", "z") else c for n, c in zip(order, columns, strict=True)
    ]
    with TemporaryDirectory() as folder:
        path = rows_of(Path(folder) / "a.csv", header, columns)
        if holes:
            lines = path.read_text().splitlines()
            lines[200] = ",".join(
                "NA" if n == "fx" else c for n, c in zip(order, lines[200].split(","), strict=True)
            )
            path.write_text("\n".join(lines))
        proposal, report, error = try_proposal(path, propose(path))
        assert report is not None, error
        session = import_recording(path, proposal.options)[0]
        assert len(session.frames) == ROWS
        np.testing.assert_allclose(
            session.frames["position_mm"][:100], POSITION_MM[:100], rtol=1e-5, atol=1e-4
        )


@pytest.mark.parametrize("cut", [1, 7, 12])
def test_a_last_line_that_is_cut_off_costs_itself_alone(tmp_path, cut):
    whole = text([TIME_S, *FORCE_N.T], [["t", "fx", "fy", "fz"]], ",", comma=False, above=[])
    last = whole.splitlines()[-1]
    (tmp_path / "a.csv").write_text(whole[: whole.rindex(last)] + last[:cut])
    columns = {"time": "t", **{f"force_{axis}": f"f{axis}" for axis in "xyz"}}
    session, report = import_recording(tmp_path / "a.csv", ImportOptions(columns))
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N[:-1], rtol=1e-6)
    assert "the last line, 301, is cut off" in report.warnings[0]


def test_names_over_two_rows_are_all_reachable(tmp_path):
    header = [["Time", "Position", "", "", "Force", "", ""], ["", *"xyz", *"xyz"]]
    header.append(["ms", *["m"] * 3, *["mN"] * 3])
    columns = [1e3 * TIME_S, *(POSITION_MM / 1e3).T, *(1e3 * FORCE_N).T]
    (tmp_path / "a.csv").write_text(text(columns, header, ",", comma=False, above=["Run 7"]))
    mapped = {f"position_{axis}": f"{axis}.1" for axis in "xyz"}
    mapped |= {f"force_{axis}": f"{axis}.2" for axis in "xyz"}
    frames = import_session(tmp_path / "a.csv", columns={"time": "Time", **mapped}).frames
    np.testing.assert_allclose(frames["position_mm"], POSITION_MM, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-5)


MOMENTS = np.datetime64("2026-01-31T23:59:59.800000") + np.rint(TIME_S * 1e6).astype("m8[us]")
FORMS_OF_TIMES = {
    "numbers": TIME_S,
    "column": TIME_S[:, None],
    "dates": MOMENTS,
    "durations": MOMENTS - MOMENTS[0],
    "texts": np.array([f"{time_s:.6f}" for time_s in TIME_S]),
    "texts of dates": MOMENTS.astype(str),
    "decimals": np.array([Decimal(n) / 1000 for n in range(ROWS)]),
}


def table_of(path, times, forces=FORCE_N[:, 2]):
    rows = [f"{when},{z:.9g}" for when, z in zip(times, forces, strict=True)]
    path.write_text("\n".join(["t,Fz", *rows]))
    return path


def parquet_of(path, columns, unit=""):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    arrays = [
        pa.array(list(c)) if c.ndim == 2 or c.dtype == object else pa.array(c)
        for c in columns.values()
    ]
    told = {"Units": unit} if unit else None
    fields = [
        pa.field(n, a.type, metadata=told if n == "force" else None)
        for n, a in zip(columns, arrays, strict=True)
    ]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields)), path)


def hdf5_of(path, columns, unit=""):
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, column in columns.items():
            file[name] = column.astype("S") if column.dtype.kind == "U" else column
        file["force"].attrs.update({"UNIT": unit} if unit else {})


@pytest.mark.parametrize(
    ("kind", "form"),
    [
        *(("npz", form) for form in FORMS_OF_TIMES if form != "decimals"),
        *(
            ("h5", form)
            for form in FORMS_OF_TIMES
            if form not in ("dates", "durations", "decimals")
        ),
        *(("parquet", form) for form in FORMS_OF_TIMES if form != "column"),
    ],
)
def test_times_and_vectors_of_arrays_may_have_any_form(tmp_path, kind, form):
    path = tmp_path / f"a.{kind}"
    force = FORCE_N if kind == "parquet" else FORCE_N.T
    columns = {"t": FORMS_OF_TIMES[form], "force": force}
    {"npz": lambda p, c: np.savez(p, **c), "h5": hdf5_of, "parquet": parquet_of}[kind](
        path, columns
    )
    mapped = {"time": "t", "force": "force"}
    frames = import_session(path, columns=mapped).frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)
    assert len(frames) == ROWS


@pytest.mark.parametrize(("kind", "write"), [("h5", hdf5_of), ("parquet", parquet_of)])
def test_the_unit_among_a_columns_attributes_is_its_unit(tmp_path, kind, write):
    path = tmp_path / f"a.{kind}"
    write(path, {"t": TIME_S, "force": 1e3 * FORCE_N}, "mN")
    frames = import_session(path, columns={"time": "t", "force": "force"}).frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


@settings(max_examples=20)
@given(st.floats(1e-3, 1e-2), st.floats(-1, 1), st.sets(st.integers(1, ROWS - 2), max_size=5))
def test_packed_numbers_are_unpacked_behind_any_link(scale, offset, holes):
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.h5")
        with pytest.importorskip("h5py").File(path, "w") as file:
            import h5py

            counts = np.rint((FORCE_N - offset) / scale).astype("i2")
            counts[sorted(holes)] = -32768
            file["raw/force"], file["raw/t"] = counts, TIME_S
            told = {"scale_factor": scale, "add_offset": offset, "_FillValue": np.int16(-32768)}
            file["raw/force"].attrs.update(told)
            file["raw/again"] = h5py.SoftLink("/raw")
            file["now"], file["lost"] = h5py.SoftLink("/raw"), h5py.SoftLink("/nowhere")
        mapped = {"time": "now.t", "force": "now.force"}
        frames = import_session(path, columns=mapped, blanks_as_gaps=True).frames
    there = np.setdiff1d(np.arange(ROWS), sorted(holes))
    np.testing.assert_array_equal(frames["sequence"], there)
    np.testing.assert_allclose(frames["force_n"], FORCE_N[there], atol=0.51 * scale)


@pytest.mark.parametrize("kind", ["h5", "parquet", "npy"])
def test_members_of_structures_are_columns(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    if kind != "parquet":
        inner = [("x", "f8"), ("y", "f4"), ("z", "f8")]
        table = np.zeros(ROWS, [("t", "f8"), ("tip", [("force", inner)])])
        table["t"] = TIME_S
        for axis, column in zip("xyz", FORCE_N.T, strict=True):
            table["tip"]["force"][axis] = column
        if kind == "npy":
            np.save(path, table)
        else:
            with pytest.importorskip("h5py").File(path, "w") as file:
                file["log"] = table
    else:
        pa = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        inner = pa.StructArray.from_arrays([pa.array(c) for c in FORCE_N.T], list("xyz"))
        outer = pa.StructArray.from_arrays([inner], ["force"])
        parquet.write_table(pa.table({"t": TIME_S, "tip": outer}), path)
    proposed = propose(path).options
    frames = import_recording(path, proposed)[0].frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("stated", ["A1", "A1:B20", "A1:Z9999"])
def test_a_workbook_is_read_whole_whatever_size_it_states(tmp_path, stated):
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (["t", "Fz"], *zip(TIME_S.tolist(), FORCE_N[:, 2].tolist(), strict=True)):
        book.active.append(row)
    book.save(tmp_path / "whole.xlsx")
    with (
        zipfile.ZipFile(tmp_path / "whole.xlsx") as source,
        zipfile.ZipFile(tmp_path / "a.xlsx", "w") as target,
    ):
        for name in source.namelist():
            content = source.read(name)
            target.writestr(name, re.sub(rb'ref="A1:B\d+"', f'ref="{stated}"'.encode(), content))
    frames = import_session(tmp_path / "a.xlsx", columns={"time": "t", "force": "Fz"}).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)


@settings(max_examples=20)
@given(st.lists(st.integers(0, ROWS - 1), min_size=1, max_size=2 * ROWS))
def test_rows_that_were_written_twice_count_once(again):
    rows = np.sort([*range(ROWS), *again])
    with TemporaryDirectory() as folder:
        path = table_of(Path(folder, "a.csv"), TIME_S[rows], FORCE_N[rows, 2])
        options = ImportOptions({"time": "t", "force": "Fz"})
        session, report = import_recording(path, options)
    np.testing.assert_allclose(session.frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
    assert f"{len(again)} rows were written twice" in " ".join(report.warnings)


@settings(max_examples=40)
@given(
    kind=st.sampled_from(["no cell", "a cell more", "a comment"]),
    places=st.sets(st.integers(3, ROWS - 2), min_size=1, max_size=3),
    sign=st.sampled_from([",", "\t", " "]),
)
def test_a_damaged_line_costs_itself_alone(kind, places, sign):
    lines = [sign.join(f"{v:.6f}" for v in row) for row in np.column_stack([TIME_S, FORCE_N])]
    for place in places:
        cells = lines[place].split(sign)
        lines[place] = {
            "no cell": sign.join([cells[0], *cells[2:]]),
            "a cell more": sign.join([*cells, "7"]),
            "a comment": f"# {lines[place]}",
        }[kind]
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.txt")
        path.write_text("\n".join([sign.join(["t", "Fx", "Fy", "Fz"]), *lines]))
        columns = {"time": "t", **{f"force_{axis}": f"F{axis}" for axis in "xyz"}}
        session, report = import_recording(path, ImportOptions(columns))
    there = np.setdiff1d(np.arange(ROWS), sorted(places))
    np.testing.assert_array_equal(session.frames["sequence"], there)
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N[there], atol=1e-6)
    assert "left out" in " ".join(report.warnings)


@settings(max_examples=30)
@given(
    until=st.integers(0, ROWS - 20),
    word=st.sampled_from(["nan", "", "1.#QNAN", "<NA>"]),
    head=st.booleans(),
    late=st.integers(1, 5),
)
def test_a_sensor_that_starts_late_costs_no_row_of_the_others(until, word, head, late):
    names = ["t", "x", "y", "z", "Fx", "Fy", "Fz"]
    rows = [[f"{v:.6f}" for v in r] for r in np.column_stack([TIME_S, POSITION_MM, FORCE_N])]
    for row in rows[:until]:
        row[-late:] = [word] * late
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.csv")
        path.write_text("\n".join(",".join(row) for row in [*([names] if head else []), *rows]))
        named = names if head else [str(place) for place in range(1, 8)]
        targets = ["time", "position_x", "position_y", "position_z"]
        columns = dict(zip(targets, named[:4], strict=True)) | {"position_y": "0.0"}
        frames = import_session(path, columns=columns, blanks_as_gaps=True).frames
    there = until if late > 3 else 0  # then z is blank, too
    np.testing.assert_allclose(frames["position_mm"][:, 0], POSITION_MM[there:, 0], atol=1e-5)


@pytest.mark.parametrize("sign", [" ", "\t", ","])
@pytest.mark.parametrize("quote", ['"', ""])
def test_row_numbers_without_a_name_move_no_column(tmp_path, sign, quote):
    """As ``write.table`` of R writes them."""
    names = [f"{quote}{name}{quote}" for name in ("t", "Fx", "Fy", "Fz")]
    rows = [
        sign.join([f"{quote}{number}{quote}", *(f"{v:.6f}" for v in row)])
        for number, row in enumerate(np.column_stack([TIME_S, FORCE_N]), start=1)
    ]
    (tmp_path / "a.txt").write_text("\n".join([sign.join(names), *rows]))
    proposed = propose(tmp_path / "a.txt").options
    frames = import_recording(tmp_path / "a.txt", proposed)[0].frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-6)


VICON = """Trajectories
1000
,,pen:tip,,,cap:top,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm
"""
MOTIVE = """Format Version,1.23,Take Name,One,Length Units,Millimeters

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,Name,pen,pen,pen,pen,pen,pen,pen
,ID,1,1,1,1,1,1,1
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z
"""
QUALISYS = """NO_OF_FRAMES\t300
TIME_STAMP\t2026-01-01, 10:00:00.000\t123.4
MARKER_NAMES\ttip
Frame\tTime\ttip X\ttip Y\ttip Z
"""
LABVIEW = """LabVIEW Measurement
Separator\tTab
***End_of_Header***

Samples\t300\t300\t300
Time\t10:30:00.1\t10:30:00.1\t10:30:00.1
Delta_X\t0.001\t0.001\t0.001
***End_of_Header***
Time\tX\tY\tZ\tComment
"""


@pytest.mark.parametrize(
    ("above", "sign", "columns"),
    [
        (VICON, ",", ["n", "0", "x", "y", "z", "0", "0", "0"]),
        (MOTIVE, ",", ["n", "t", "0", "0", "0", "1", "x", "y", "z"]),
        (QUALISYS, "\t", ["n", "t", "x", "y", "z"]),
        (LABVIEW, "\t", ["t", "x", "y", "z", ""]),
    ],
    ids=["vicon", "motive", "qualisys", "labview"],
)
def test_the_names_of_measuring_programs_are_found(tmp_path, above, sign, columns):
    values = {"n": np.arange(ROWS), "t": TIME_S, **dict(zip("xyz", POSITION_MM.T, strict=True))}
    rows = [
        sign.join(f"{values[c][r]:g}" if c in values else c for c in columns) for r in range(ROWS)
    ]
    below = ["", "Devices", "2000", "Frame,Sub Frame,Fx", ",,N", "1,0,7", "1,1,7"]
    lines = [*rows, *(below if above is VICON else [])]
    path = tmp_path / ("a.lvm" if above is LABVIEW else "a.txt")
    path.write_text(above + "\n".join(lines))
    if above is VICON:
        mapped = {f"position_{axis}": f"pen:tip.{axis.upper()}" for axis in "xyz"}
        options = ImportOptions(mapped, rate_hz=1000)
    else:
        options = propose(path).options
    session, report = import_recording(path, options)
    np.testing.assert_allclose(session.frames["position_mm"], POSITION_MM, atol=1e-3)
    assert any("another table" in text for text in report.warnings) == (above is VICON)


@settings(max_examples=10)
@given(share=st.floats(0.4, 0.95))
def test_a_packed_text_that_is_cut_off_is_read_as_far_as_it_goes(share):
    with TemporaryDirectory() as folder:
        path = table_of(Path(folder, "a.csv"), TIME_S)
        packed = gzip.compress(path.read_bytes())
        (path.parent / "a.csv.gz").write_bytes(packed[: int(share * len(packed))])
        options = ImportOptions({"time": "t", "force": "Fz"})
        session, report = import_recording(path.parent / "a.csv.gz", options)
    count = len(session.frames)
    assert 0.5 * share * ROWS < count < ROWS
    np.testing.assert_allclose(session.frames["force_n"][:, 2], FORCE_N[:count, 2], rtol=1e-6)
    assert "cut off" in " ".join(report.warnings)


@given(share=st.floats(0.4, 0.95), zeros=st.integers(1, 3_000_000), end=st.sampled_from(["", "1"]))
@settings(max_examples=10)
def test_text_is_read_to_the_zero_bytes_at_its_end(share, zeros, end):
    with TemporaryDirectory() as folder:
        path = table_of(Path(folder, "a.csv"), TIME_S)
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))] + bytes(zeros) + end.encode())
        options = ImportOptions({"time": "t", "force": "Fz"})
        if end:
            with pytest.raises(InputError, match="not text in columns, it holds zero bytes"):
                import_recording(path, options)
            return
        session, report = import_recording(path, options)
    count = len(session.frames)
    assert 0.9 * share * ROWS < count < 1.1 * share * ROWS
    np.testing.assert_allclose(session.frames["force_n"][:, 2], FORCE_N[:count, 2], rtol=1e-6)
    assert "ends in zero bytes" in " ".join(report.warnings)


@pytest.mark.parametrize("rows", [1, 40])
@pytest.mark.parametrize("kind", ["npz", "h5", "mat", "csv"])
def test_rows_that_were_never_filled_are_left_out(tmp_path, kind, rows):
    path = tmp_path / f"a.{kind}"
    columns = {"t": TIME_S + 0.001, "force": FORCE_N}
    larger = {n: np.concatenate([c, np.zeros((rows, *c.shape[1:]))]) for n, c in columns.items()}
    if kind == "csv":
        cells = np.column_stack([larger["t"], larger["force"]])
        np.savetxt(path, cells, delimiter=",", header="t,force[0],force[1],force[2]", comments="")
    else:
        {"npz": lambda p, c: np.savez(p, **c), "h5": hdf5_of, "mat": scipy.io.savemat}[kind](
            path, larger
        )
    session, report = import_recording(path, ImportOptions({"time": "t", "force": "force"}))
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N, rtol=1e-6)
    assert f"t: the last {rows} rows hold only zeros and were left out" in report.warnings


@settings(max_examples=40, deadline=None)
@given(
    between=st.sampled_from([": ", ":", "=", " = "]),
    behind=st.sampled_from([" ", ", ", ",", "\t", "  "]),
    unit=st.sampled_from([" mN", "mN", ""]),
    each=st.booleans(),
    other=st.sampled_from(["", "Calibrating ...", "sensor: ready", "F_z: 12"]),
)
def test_lines_that_name_their_values_are_rows(between, behind, unit, each, other):
    scale, lines = 1e3 if unit else 1.0, []
    for number, (at, force) in enumerate(zip(TIME_S, FORCE_N, strict=True)):
        lines += [other] if other and number in (0, 7, 200) else []
        units = [unit if each else "", unit if each else "", unit]
        cells = [
            f"F{axis}{between}{scale * value:.6f}{own}"
            for axis, value, own in zip("xyz", force, units, strict=True)
        ]
        lines.append(behind.join([f"t_us{between}{1e6 * at:.0f}", *cells]))
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.txt")
        path.write_text("\n".join(lines) + "\n")
        proposed = propose(path)
        frames = import_recording(path, proposed.options)[0].frames
    assert list(proposed.names) == ["t_us", "Fx", "Fy", "Fz"]
    np.testing.assert_allclose(frames["force_n"], FORCE_N, atol=1e-6)


def test_sparse_matrices_and_time_series_of_matlab_are_columns(tmp_path):
    path = tmp_path / "a.mat"
    waves = {"Time": TIME_S[:, None], "Data": ACCELERATION_M_S2.T[:, None, :]}
    scipy.io.savemat(path, {"t": TIME_S, "force": scipy.sparse.csc_matrix(FORCE_N), "acc": waves})
    session = import_recording(path, propose(path).options)[0]
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N, rtol=1e-6)
    np.testing.assert_allclose(session.frames["acceleration_m_s2"], ACCELERATION_M_S2, rtol=1e-6)


@pytest.mark.parametrize("form", ["characters", "cells"])
def test_times_of_matlab_may_be_texts(tmp_path, form):
    texts = [f"10:30:{time_s:06.3f}" for time_s in TIME_S]
    times = np.array(texts, dtype=object if form == "cells" else None)
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"time": times, "force": FORCE_N, "unit": "N", "axes": ["x", "y", "z"]})
    frames = import_recording(path, propose(path).options)[0].frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("kind", ["chunks", "none", "link", "joined", "whole"])
def test_values_of_hdf5_that_were_never_written_are_told(tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(tmp_path / "part.h5", "w") as file:
        file["force"] = FORCE_N
    whole = h5py.VirtualLayout(FORCE_N.shape, "f8")
    whole[:] = h5py.VirtualSource("part.h5", "force", FORCE_N.shape)
    with h5py.File(path, "w") as file:
        file["t"], file["acc"] = TIME_S, ACCELERATION_M_S2
        if kind in ("chunks", "none"):
            chunks = (50, 3) if kind == "chunks" else None
            force = file.create_dataset("force", FORCE_N.shape, "f8", chunks=chunks)
            force[: 120 if kind == "chunks" else 0] = 1
        elif kind == "link":
            file["force"] = h5py.ExternalLink("gone.h5", "/force")
        else:
            file.create_virtual_dataset("force", whole)
    if kind == "joined":
        (tmp_path / "part.h5").unlink()
        with pytest.raises(InputError, match=r"put together of other files; there is no part\.h5"):
            import_session(path, columns={"time": "t", "force": "force"})
        return
    session, report = import_recording(path, propose(path).options)
    said = {
        "chunks": ["force: 3 of its 6 parts were never written; they hold fill values"],
        "none": ["force: 1 of its 1 parts were never written; they hold fill values"],
        "link": ["force is a link to /force in gone.h5, which is not there"],
        "whole": [],
    }[kind]
    assert [each for each in report.warnings if "never written" in each or "link" in each] == said
    if kind == "whole":
        np.testing.assert_allclose(session.frames["force_n"], FORCE_N, rtol=1e-6)


@pytest.mark.parametrize("end", ["", ";"])
@pytest.mark.parametrize("below", ["", "ms;mN"])
def test_a_header_that_is_repeated_begins_no_other_table(tmp_path, below, end):
    header = [line + end for line in ("t;Fz", below) if line]
    lines = [
        f"{1e3 * t:.0f};{1e3 * z:.6f}{end}" for t, z in zip(TIME_S, FORCE_N[:, 2], strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join([*header, *lines[:99], *header, *lines[99:]]))
    units = {} if below else {"time": "ms", "force": "mN"}
    columns = {"time": "t", "force": "Fz"}
    frames = import_session(tmp_path / "a.csv", columns=columns, units=units).frames
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
