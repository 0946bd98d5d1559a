"""Every kind of file, written with any names, units, order and holes, is read as it was meant."""

import gzip
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import scipy.io.wavfile
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_files import (
    FIELDS,
    TELLING,
    WRITERS,
    force,
    lines,
    motion,
    vibration,
    write_columns,
)
from unit_samples import FOREIGN, UNITS

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording
from mmt_bridges.labview import read_tdms

pytestmark = pytest.mark.usefixtures("read_here")

ROWS = 300
TIME_S = np.arange(ROWS) / 1000
POSITION_MM, FORCE_N, ACCELERATION_M_S2 = (made(TIME_S) for made in (motion, force, vibration))
CHANNELS = {"position": POSITION_MM, "force": FORCE_N, "acceleration": ACCELERATION_M_S2}
TRUTH = {
    "time": TIME_S,
    **{f"{c}_{axis}": v[:, place] for c, v in CHANNELS.items() for place, axis in enumerate("xyz")},
}
"""By target."""
FORCES = {"time": "t", **{f"force_{axis}": f"F{axis}" for axis in "xyz"}}
ONE = {"time": "t", "force": "Fz"}

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
    for channel, values in CHANNELS.items():
        np.testing.assert_allclose(frames[FIELDS[channel]], values, rtol=rtol, atol=1e-4)


def text(columns, header, sep, comma, above):
    rows = [*above, *(sep.join(row) for row in header)]
    for row in np.column_stack(columns).tolist():
        cells = (f"{value:.12g}" for value in row)
        rows.append(sep.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return "\n".join(rows) + "\n"


def forces_along_z(path, rows=slice(None)):
    return lines(path, "t,Fz", zip(TIME_S[rows], FORCE_N[rows, 2], strict=True))


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


@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind != "csv"])
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
        names = write_columns(path, columns, {name_of(t): unit for t, unit in units.items()})
        check(import_session(path, columns={t: names[name_of(t)] for t in TRUTH}).frames)


@pytest.mark.parametrize("target", ["time", "position_y", "force_z", "acceleration_x"])
def test_a_unit_of_something_else_is_refused_by_name_or_scaled(tmp_path, target):
    own = {"time": "s", "position": "mm", "force": "N", "acceleration": "m/s2"}
    unit = FOREIGN[target.split("_")[0]]
    units = {t: own[t.split("_")[0]] for t in TRUTH} | {target: unit}
    columns = [values / (2.5 if t == target else 1) for t, values in TRUTH.items()]
    header = [[f"{name_of(t)} ({units[t]})" for t in TRUTH]]
    path, mapped = tmp_path / "a.csv", {t: name_of(t) for t in TRUTH}
    path.write_text(text(columns, header, ",", comma=False, above=[]))
    with pytest.raises(InputError, match=rf"{target} is mapped to .* in '{unit}' by the file"):
        import_session(path, columns=mapped)
    for said in {}, {target: own[target.split("_")[0]]}:
        scaled = {**mapped, target: f"{mapped[target]}*2.5"}
        check(import_session(path, columns=scaled, units=said).frames)


def test_objects_and_lists_of_json_are_columns(tmp_path):
    rows = [
        {"t": t, "tip": {"p": ps, "f": [{"n": z}]}, "a": a if a[0] > 0 else None}
        for t, ps, z, a in zip(
            *(c.tolist() for c in (TIME_S, POSITION_MM, FORCE_N[:, 2], ACCELERATION_M_S2)),
            strict=True,
        )
    ]
    each = list(map(json.dumps, rows))
    each[5] = each[5].replace('"a"', '"a": NaN, "a"')
    columns = {"time": "t", "position": "tip.p", "force": "tip.f.0.n"}
    forms = [
        ("a.ndjson", "\n".join(each)),
        ("a.json", f"[{','.join(each)}]"),
        ("b.json", f'{{"about": {{"rate": [1000]}}, "rows": [{",".join(each)}]}}'),
    ]
    for name, content in forms:
        (tmp_path / name).write_text(content)
        frames = import_session(tmp_path / name, columns=columns).frames
        np.testing.assert_allclose(frames["position_mm"], POSITION_MM, rtol=1e-6)
        np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
        assert propose(tmp_path / name).names == ["t", "tip.p", "tip.f.0.n", "a", "a.1", "a.2"]
    (tmp_path / "a.jsonl").write_text("\n".join(each)[:-9])
    session, report = import_recording(tmp_path / "a.jsonl", ImportOptions(columns))
    assert len(session.frames) == ROWS - 1
    assert any("last line is cut off" in warning for warning in report.warnings)


def test_arrays_of_json_count_more_than_a_shorter_list_of_objects(tmp_path):
    content = {"t": TIME_S.tolist(), "f": FORCE_N.tolist(), "sensors": [{"name": "a"}] * 3}
    (tmp_path / "a.json").write_text(json.dumps(content))
    frames = import_session(tmp_path / "a.json", columns={"time": "t", "force": "f"}).frames
    np.testing.assert_allclose(frames["force_n"], FORCE_N, rtol=1e-6)


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
        writer.write_segment([wave("arm", "a", np.sin(0.1 * np.arange(2 * ROWS)), 2000, 70)])
        writer.write_segment([nptdms.ChannelObject("arm", "note", ["a", "b"])])
    with nptdms.TdmsWriter(tmp_path / "b.tdms") as writer:
        writer.write_segment([wave("arm", "z", FORCE_N[:, 2], 1000, 50)])
    columns = {"acceleration": "ni.z", "force": "arm.z"}
    session = import_session(tmp_path / "a.tdms", columns=columns)
    began_ns = (begin + np.timedelta64(50, "ms")).astype("M8[ns]").astype(int)
    assert session.began_utc_ns == began_ns
    alone = import_session(tmp_path / "a.tdms", columns={"acceleration": "arm.a"})
    assert alone.began_utc_ns == began_ns + 20_000_000
    columns_of_two = {"acceleration": "a.tdms:ni.z", "force": "b.tdms:z"}
    of_two = import_session([tmp_path / "a.tdms", tmp_path / "b.tdms"], columns=columns_of_two)
    assert of_two.began_utc_ns == began_ns
    np.testing.assert_array_equal(of_two.frames, session.frames)
    force = session.frames["force_n"][:, 2]
    np.testing.assert_allclose(force, FORCE_N[: len(force), 2], rtol=1e-6)
    assert propose(tmp_path / "a.tdms").names == ["ni.z", "arm.z", "arm.a", "arm.note"]
    (tmp_path / "a.tdms").write_bytes(b"TDSm" + bytes(24) + b"x" * 40)
    with pytest.raises(InputError, match="not a TDMS file"):
        import_session(tmp_path / "a.tdms", columns=columns)


@pytest.mark.parametrize("unfinished", [False, True])
@pytest.mark.parametrize("every_segment_has_its_own_start", [False, True])
def test_acquisitions_that_are_appended_to_a_tdms_keep_their_pauses(
    tmp_path, every_segment_has_its_own_start, unfinished
):
    nptdms = pytest.importorskip("nptdms")
    day = np.datetime64("2026-01-31T23:59:58")
    begins_s, at_s = (0.0, 4.0, 4.9, 9.0), np.arange(900) / 1000

    def wave(name, times_s, rate_hz, begin_s):
        begin_s = times_s[0] if every_segment_has_its_own_start else begin_s
        begin = day + np.timedelta64(round(begin_s * 1e6), "us")
        about = {"wf_increment": 1 / rate_hz, "wf_start_time": begin}
        return nptdms.ChannelObject("ni", name, times_s, about)

    z_s = [begin_s + at_s for begin_s in begins_s]
    a_s = [begin_s + 0.03 + np.arange(1800) / 2000 for begin_s in begins_s[1:]]
    for place, begin_s in enumerate(begins_s):
        with nptdms.TdmsWriter(tmp_path / "a.tdms", "a" if place else "w") as writer:
            for part in np.array_split(begin_s + at_s, 3):
                writer.write_segment([wave("z", part, 1000, begin_s)])
            if place:
                writer.write_segment([wave("a", a_s[place - 1], 2000, begin_s + 0.03)])
    written = (tmp_path / "a.tdms").read_bytes()
    if unfinished:  # as LabVIEW leaves it when it crashes
        last = written.rindex(b"TDSm")
        written = written[: last + 12] + b"\xff" * 8 + written[last + 20 :]
    (tmp_path / "b.tdms").write_bytes(written)
    source = read_tdms(tmp_path / "b.tdms", lambda name: True, ImportOptions())
    np.testing.assert_allclose(source.times["z"], np.concatenate(z_s), atol=1e-6)
    np.testing.assert_allclose(source.times["a"], np.concatenate(a_s), atol=1e-6)
    began_s = (np.datetime64(source.began_utc_ns, "ns") - day) / np.timedelta64(1, "s")
    assert began_s == pytest.approx(begins_s[0])


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
    columns = {"t": TIME_S, "x": FORCE_N[:, 0], "y": FORCE_N[:, 1], "touches": TIME_S > 0.1}
    write_columns(tmp_path / "f.xlsx", columns)
    rows = ((f"{t:.9g}", f"{z:.9g}") for t, z in zip(TIME_S, ACCELERATION_M_S2[:, 2], strict=True))
    path = lines(tmp_path / "a.csv", "t;a", rows, ";")
    path.write_text(path.read_text().replace(".", ","))
    mapped = {"force_x": "f.xlsx:x", "force_y": "f.xlsx:y", "force_z": "f.xlsx:touches"}
    mapped |= {"acceleration": "a.csv:a"}
    mapped |= {"force_time": "f.xlsx:t", "acceleration_time": "a.csv:t"}
    frames = import_session([tmp_path / "f.xlsx", path], columns=mapped, decimal=",").frames
    expected = np.column_stack([FORCE_N[:, :2], TIME_S > 0.1])
    np.testing.assert_allclose(frames["force_n"], expected, atol=1e-6)
    z = frames["acceleration_m_s2"][:, 2]
    np.testing.assert_allclose(z, ACCELERATION_M_S2[:, 2], rtol=1e-6)


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


@pytest.mark.parametrize("names", ["t,Fz", "Frame,X", "note,left"])
def test_a_second_table_of_as_many_columns_is_left_out(tmp_path, names):
    path = forces_along_z(tmp_path / "a.csv")
    later = [f"{when:.3f},7" for when in TIME_S + 1]
    path.write_text(path.read_text() + "\n".join([names, "s,N", *later]))
    session, report = import_recording(path, ImportOptions(ONE))
    goes_on = names == "t,Fz"
    assert (session.frames["force_n"][-1, 2] == 7) == goes_on
    said = f"another table begins above line {ROWS + 4}: it was left out, as all below"
    assert any(each.startswith(said) for each in report.warnings) != goes_on
    if not goes_on:
        columns = dict(zip(ONE, names.split(","), strict=True))
        below, _ = import_recording(path, ImportOptions(columns, header=ROWS + 2))
        assert set(below.frames["force_n"][:, 2]) == {7}


@pytest.mark.parametrize(
    ("heads", "names"),
    [
        ("V(force),V(acc)", ["V(force)", "V(acc)"]),
        ("Force (raw) [N],Force (filtered) [N]", ["Force (raw)", "Force (filtered)"]),
        ("Force (N),Force (raw)", ["Force", "Force (raw)"]),
        ("Force (N),Force (mN)", ["Force.1", "Force.2"]),
        ("Force (raw),az (raw)", ["Force", "az"]),
        ("Force (raw),Force (raw)", ["Force.1", "Force.2"]),
    ],
)
def test_names_keep_the_words_in_brackets_that_alone_tell_them_apart(tmp_path, heads, names):
    path = lines(tmp_path / "a.csv", f"t,{heads}", ((t, 1.0, 2.0) for t in TIME_S))
    assert list(propose(path).names) == ["t", *names]
    if "N" not in heads:
        with pytest.raises(InputError, match=r"is in '(force|raw)' by the file"):
            import_session(path, columns={"time": "t", "force": names[0]})


def test_a_table_without_plain_numbers_is_refused_with_its_first_cell(tmp_path):
    path = lines(tmp_path / "a.csv", "t,Fz", [("0.000 sx", "1.5 Nx"), ("0.001 sx", "1.5 Nx")])
    told = "no line holds numbers alone; the first, line 2, begins with '0.000 sx'"
    with pytest.raises(InputError, match=told):
        import_session(path, columns=ONE)


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
        with pytest.raises(InputError, match=r"force_z=a.npz:a: its other axes are of f.npz"):
            import_session(paths, columns={"force_x": "f.npz:F", "force_z": "a.npz:a"})


def test_a_rate_is_that_of_the_files_without_times(tmp_path):
    slow_s, fast_s = np.arange(0, 2, 1 / 240), np.arange(0, 2, 1 / 7000)
    np.savez(tmp_path / "p.npz", t=slow_s, p=motion(slow_s))
    np.savez(tmp_path / "f.npz", F=force(fast_s))
    columns = {"position": "p.npz:p", "position_time": "p.npz:t", "force": "f.npz:F"}
    paths = [tmp_path / "p.npz", tmp_path / "f.npz"]
    frames = import_session(paths, columns=columns, rate_hz=7000.0).frames
    for channel, made in {"position": motion, "force": force}.items():
        np.testing.assert_allclose(
            frames[FIELDS[channel]], made(frames["sequence"] / 1000), atol=1e-3
        )
    del columns["position_time"]  # of none with times, it is that of all
    alike = import_session(paths, columns=columns, rate_hz=240.0).frames
    np.testing.assert_allclose(alike["position_mm"], motion(alike["sequence"] / 1000), atol=1e-3)


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


@given(
    order=st.permutations(["t", "fx", "fy", "fz", "ax", "ay", "az", "x", "y", "z", "note"]),
    unit=st.sampled_from(["", " [m]", "_um", " (inch)"]),
    holes=st.booleans(),
)
@settings(max_examples=15)
def test_what_is_proposed_runs(order, unit, holes):
    named = ["t", *(f"{q}{axis}" for q in ("", "f", "a") for axis in "xyz")]
    columns = dict(zip(named, TRUTH.values(), strict=True)) | {"note": TIME_S}
    scale = {"": 1.0, " [m]": 1e3, "_um": 1e-3, " (inch)": 25.4}[unit]
    header = [name + unit if name in ("x", "y", "z") else name for name in order]
    rows = [[columns[n][r] / (scale if n in ("x", "y", "z") else 1.0) for n in order]
            for r in range(ROWS)]  # fmt: skip
    if holes:
        rows[199][order.index("fx")] = "NA"
    with TemporaryDirectory() as folder:
        path = lines(Path(folder) / "a.csv", ",".join(header), rows)
        proposal, report, error = try_proposal(path, propose(path))
        assert report is not None, error
        session = import_recording(path, proposal.options)[0]
        assert len(session.frames) == ROWS
        position_mm = session.frames["position_mm"][:100]
        np.testing.assert_allclose(position_mm, POSITION_MM[:100], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("cut", [1, 7, 12])
def test_a_last_line_that_is_cut_off_costs_itself_alone(tmp_path, cut):
    whole = lines(tmp_path / "a.csv", "t,Fx,Fy,Fz", np.column_stack([TIME_S, FORCE_N])).read_text()
    last = whole.splitlines()[-1]
    (tmp_path / "a.csv").write_text(whole[: whole.rindex(last)] + last[:cut])
    session, report = import_recording(tmp_path / "a.csv", ImportOptions(FORCES))
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N[:-1], rtol=1e-6)
    assert "the last line, 301, is cut off" in report.warnings[0]


@settings(max_examples=20)
@given(st.floats(1e-3, 1e-2), st.floats(-1, 1), st.sets(st.integers(1, ROWS - 2), max_size=5))
def test_packed_numbers_are_unpacked_behind_any_link(scale, offset, holes):
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.h5")
        h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
        with h5py.File(path, "w") as file:
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


@settings(max_examples=20)
@given(st.lists(st.integers(0, ROWS - 1), min_size=1, max_size=2 * ROWS))
def test_rows_that_were_written_twice_count_once(again):
    rows = np.sort([*range(ROWS), *again])
    with TemporaryDirectory() as folder:
        path = forces_along_z(Path(folder, "a.csv"), rows)
        session, report = import_recording(path, ImportOptions(ONE))
    np.testing.assert_allclose(session.frames["force_n"][:, 2], FORCE_N[:, 2], rtol=1e-6)
    assert f"{len(again)} rows were written twice" in " ".join(report.warnings)


@settings(max_examples=40)
@given(
    kind=st.sampled_from(["no cell", "a cell more", "a comment"]),
    places=st.sets(st.integers(3, ROWS - 2), min_size=1, max_size=3),
    sign=st.sampled_from([",", "\t", " "]),
)
def test_a_damaged_line_costs_itself_alone(kind, places, sign):
    each = [sign.join(f"{v:.6f}" for v in row) for row in np.column_stack([TIME_S, FORCE_N])]
    for place in places:
        cells = each[place].split(sign)
        each[place] = {
            "no cell": sign.join([cells[0], *cells[2:]]),
            "a cell more": sign.join([*cells, "7"]),
            "a comment": f"# {each[place]}",
        }[kind]
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.txt")
        path.write_text("\n".join([sign.join(["t", "Fx", "Fy", "Fz"]), *each]))
        session, report = import_recording(path, ImportOptions(FORCES))
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


@settings(max_examples=10)
@given(share=st.floats(0.4, 0.95))
def test_a_packed_text_that_is_cut_off_is_read_as_far_as_it_goes(share):
    with TemporaryDirectory() as folder:
        path = forces_along_z(Path(folder, "a.csv"))
        packed = gzip.compress(path.read_bytes())
        (path.parent / "a.csv.gz").write_bytes(packed[: int(share * len(packed))])
        session, report = import_recording(path.parent / "a.csv.gz", ImportOptions(ONE))
    count = len(session.frames)
    assert 0.5 * share * ROWS < count < ROWS
    np.testing.assert_allclose(session.frames["force_n"][:, 2], FORCE_N[:count, 2], rtol=1e-6)
    assert "cut off" in " ".join(report.warnings)


@given(share=st.floats(0.4, 0.95), zeros=st.integers(1, 3_000_000), end=st.sampled_from(["", "1"]))
@settings(max_examples=10)
def test_text_is_read_to_the_zero_bytes_at_its_end(share, zeros, end):
    with TemporaryDirectory() as folder:
        path = forces_along_z(Path(folder, "a.csv"))
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))] + bytes(zeros) + end.encode())
        options = ImportOptions(ONE)
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
        names = {"t": "t", "force": "force"}
    else:
        names = write_columns(path, larger)
    options = ImportOptions({"time": names["t"], "force": names["force"]})
    session, report = import_recording(path, options)
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N, rtol=1e-6)
    told = f"{names['t']}: the last {rows} rows hold only zeros and were left out"
    assert told in report.warnings


@settings(max_examples=40, deadline=None)
@given(
    between=st.sampled_from([": ", ":", "=", " = "]),
    behind=st.sampled_from([" ", ", ", ",", "\t", "  "]),
    unit=st.sampled_from([" mN", "mN", ""]),
    each=st.booleans(),
    other=st.sampled_from(["", "Calibrating ...", "sensor: ready", "F_z: 12", "# a sketch"]),
    separator=st.sampled_from([None, "comma", "semicolon", "tab"]),
)
def test_lines_that_name_their_values_are_rows(between, behind, unit, each, other, separator):
    scale, rows = 1e3 if unit else 1.0, []
    for number, (at, forces) in enumerate(zip(TIME_S, FORCE_N, strict=True)):
        rows += [other] if other and number in (0, 7, 200) else []
        units = [unit if each else "", unit if each else "", unit]
        cells = [
            f"F{axis}{between}{scale * value:.6f}{own}"
            for axis, value, own in zip("xyz", forces, units, strict=True)
        ]
        rows.append(behind.join([f"t_us{between}{1e6 * at:.0f}", *cells]))
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.txt")
        path.write_text("\n".join(rows) + "\n")
        proposed = propose(path, ImportOptions(separator=separator))
        session, report = import_recording(path, proposed.options)
    assert list(proposed.names) == ["t_us", "Fx", "Fy", "Fz"]
    np.testing.assert_allclose(session.frames["force_n"], FORCE_N, atol=1e-6)
    assert any(note.startswith("each line names its values") for note in report.warnings)


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
