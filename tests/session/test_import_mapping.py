"""Columns of any name, shape and unit become the channels that they are mapped to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from unit_samples import UNITS

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.session.data import axis_columns
from mmt.session.files import import_session
from mmt.session.importing.columns import SourceColumns
from mmt.session.importing.mapping import to_samples
from mmt.session.importing.options import ImportOptions

TIME_S = np.arange(50) / 1000
VECTORS = np.random.default_rng(1).normal(size=(50, 3))
X, Y, Z = VECTORS.T


def mapped(values, columns=None, *, file=None, times=None, more=None, **options):
    source = SourceColumns(values, tuple(values), file or {}, times or {})
    return to_samples(replace(source, **more or {}), ImportOptions(columns or {}, **options))


@pytest.mark.parametrize("form", ["wrench[{}]", "a(c)[{}]", "/arm/data[{}]", "F({})", "array"])
@settings(max_examples=20)
@given(st.permutations([0, 1, 2]), st.lists(st.sampled_from([1.0, -1.0, 0.25]), min_size=3))
def test_axes_are_elements_of_what_is_a_vector(form, order, factors):
    whole = {form.format(place): VECTORS[:, place] for place in range(3)}
    whole = {"array": VECTORS} if form == "array" else whole
    name = form[:-4] if form != "array" else form
    sound = {"time_s": TIME_S, **whole}
    np.testing.assert_array_equal(mapped(sound, {"force": name}).values["force"], VECTORS)
    columns = {
        f"force_{axis}": f"{name}[{place}]" for axis, place in zip("xyz", order, strict=True)
    }
    columns = {t: f"{n}*{f}" for (t, n), f in zip(columns.items(), factors, strict=False)}
    found = mapped(sound, columns).values["force"]
    np.testing.assert_allclose(found, VECTORS[:, order] * factors[:3])


@settings(max_examples=20)
@given(st.sampled_from([c for c in UNITS if c != "time"]), st.data())
def test_a_unit_is_what_the_options_say_else_the_file_else_the_name(channel, data):
    units = st.sampled_from(sorted(UNITS[channel]))
    name, told, said, of_axis = (data.draw(units) for _ in range(4))
    columns = {f"{channel}_{axis}": f"c [{name}]" for axis in "xyz"}
    values = {"time_s": TIME_S, f"c [{name}]": X}
    for file, given_units, expected in (
        ({}, {}, (name, name)),
        ({f"c [{name}]": told}, {}, (told, told)),
        ({f"c [{name}]": told}, {channel: said}, (said, said)),
        ({}, {channel: said, f"{channel}_z": of_axis}, (said, of_axis)),
    ):
        found = mapped(values, columns, file=file, units=given_units)
        factors = [UNITS[channel][unit] for unit in (expected[0], *expected)]
        np.testing.assert_allclose(found.values[channel], X[:, None] * factors)
        assert found.told == {channel}
        by_name = expected[0] == name and not file and not given_units and factors[0] != 1.0
        assert any(f"c [{name}] in {name}" in note for note in found.notes) == by_name


def test_a_channel_has_its_own_times_those_of_all_or_a_rate():
    both = {
        "time_s": TIME_S,
        "force_time_s": TIME_S + 1,
        "force_n": VECTORS,
        "position_mm": VECTORS,
    }
    found = mapped(both)
    np.testing.assert_array_equal(found.times["position"], TIME_S)
    np.testing.assert_array_equal(found.times["force"], TIME_S + 1)
    assert found.told == frozenset()
    both["time_s"] = np.where(TIME_S > 0.048, np.nan, TIME_S)
    alike = mapped({**both, "force_time_s": both["time_s"].copy()})
    assert alike.times["force"] is alike.times["position"]
    found = mapped({**both, "time_s": TIME_S}, rate_hz=500.0)
    np.testing.assert_array_equal(found.times["force"], np.arange(50) / 500)
    assert any(
        "500 rows a second, as --rate says; time_s, by which all 50 last 0.049 s" in n
        for n in found.notes
    )
    stamped = {"/imu.vector": VECTORS, "/imu.other": VECTORS, "f": VECTORS}
    found = mapped(stamped, {"acceleration": "/imu"}, times={"/imu.vector": TIME_S})
    np.testing.assert_array_equal(found.times["acceleration"], TIME_S)
    parts = {f"imu[{place}]": X for place in range(3)}
    clocks = dict.fromkeys(parts, TIME_S)
    found = mapped(parts, {"acceleration": "imu"}, times=clocks)
    np.testing.assert_array_equal(found.times["acceleration"], TIME_S)
    with pytest.raises(InputError, match="there is no column time_s"):
        mapped(parts, {"acceleration": "imu"}, times={**clocks, "imu[2]": TIME_S + 1})
    found = mapped({"/v": X}, {"speed": "/v"}, times={"/v": TIME_S})
    np.testing.assert_array_equal(found.times["position"], TIME_S)
    ticks = {"sec": np.repeat([7.0, np.nan], 25), "nsec": np.tile(np.arange(25) * 1e7, 2), "f": Z}
    columns = {"time": "sec", "time_fraction": "nsec", "force": "f"}
    found = mapped(ticks, columns)
    np.testing.assert_allclose(found.times["force"], ticks["sec"] + 1e-9 * ticks["nsec"])
    np.testing.assert_array_equal(found.values["force"], np.column_stack([0 * Z, 0 * Z, Z]))
    with pytest.raises(InputError, match="whole seconds, one a row; sec, to"):
        mapped({**ticks, "sec": TIME_S}, columns)


@settings(max_examples=200)
@example(lost=({*range(1, 50, 2)}, set(), {2}), late=[0.0, 0.0, 3e-4], several=1)
@given(
    lost=st.tuples(*(st.sets(st.integers(0, 49), max_size=most) for most in (25, 12, 12))),
    late=st.lists(st.floats(0.0, 4e-4), min_size=3, max_size=3),
    several=st.sampled_from([1, 2]),
)
def test_axes_with_times_of_their_own_are_put_together_by_these(lost, late, several):
    """Each axis is a stream that lacks some rows and is received a little later."""
    values, times, kept = {}, {}, []
    for axis, column, gone, late_s in zip("xyz", VECTORS.T, lost, late, strict=True):
        kept.append([row for row in range(50) if row not in gone])
        values[axis], times[axis] = column[kept[-1]], TIME_S[kept[-1]] + late_s
    if several == 2:  # one of them has twice the rate
        values["z"], times["z"] = np.repeat(Z, 2), np.arange(100) / 2000
        kept[2] = range(50)
    columns = {f"force_{axis}": axis for axis in "xyz"}
    found = mapped(values, columns, times=times)
    whole = [row for row in kept[0] if row in kept[1] and row in kept[2]]
    rows = [kept[0].index(row) for row in whole]
    np.testing.assert_array_equal(found.values["force"][rows], VECTORS[whole])
    np.testing.assert_array_equal(found.times["force"], times["x"])
    others = np.setdiff1d(np.arange(len(kept[0])), rows)
    assert np.isnan(found.values["force"][others]).any(axis=1).all()
    others_differ = several == 2 or any(kept[0] != each for each in kept[1:])
    assert any("has other times than x" in note for note in found.notes) == others_differ


@pytest.mark.parametrize("sequence", [None, np.arange(50) * 2.0])
def test_several_samples_a_row_have_times_and_rows_of_their_own(sequence):
    fast = {f"acceleration_{axis}_m_s2": np.arange(200.0).reshape(50, 4) for axis in "xyz"}
    fast |= {"time_s": 2 * TIME_S} | ({} if sequence is None else {"sequence": sequence})
    found = mapped(fast)
    np.testing.assert_array_equal(found.values["acceleration"][:, 2], np.arange(200.0))
    times_s = found.times["acceleration"]
    np.testing.assert_allclose(times_s[3::4], 2 * TIME_S)
    period_s = 2e-3 if sequence is None else 1e-3
    np.testing.assert_allclose(np.diff(times_s)[::4], period_s / 4)
    assert found.row_name("acceleration", 9) == "row 2, counted from 0"
    assert found.sequence is sequence


def test_speed_stands_for_a_straight_path():
    speed_m_s = 0.1 + 0.05 * np.sin(9 * TIME_S)
    speed_m_s[30] = np.nan
    found = mapped({"t": TIME_S, "v_m_s": speed_m_s}, {"time": "t", "speed": "v_m_s"})
    path_mm = 100 * TIME_S + 50 / 9 * (1 - np.cos(9 * TIME_S))
    position_mm = found.values["position"]
    np.testing.assert_allclose(position_mm[:30, 0], path_mm[:30], atol=1e-5)
    np.testing.assert_array_equal(position_mm[:30, 1:], 0.0)
    assert np.flatnonzero(np.isnan(position_mm[:, 0])).tolist() == [30]
    assert any("position was made of v_m_s" in note for note in found.notes)


SOUND = {"time_s": TIME_S, "f": VECTORS, "x": X, "none": X[:0], "short": X[:9]}


@pytest.mark.parametrize(
    ("values", "columns", "reason"),
    [
        ({}, {}, "it holds none of position_mm.*--map force_z=NAME"),
        ({}, {"force": "G"}, "force is mapped to G, which is not there; the columns are time_s, f"),
        ({}, {"force": "f", "time": "0"}, r"time is mapped to the number 0, .* give --rate HZ"),
        ({}, {"force": "f", "force_time": "no"}, "force_time is mapped to no, which is not"),
        ({}, {"force_x": "f[3]"}, r"component 3 of f, which has shape \(50, 3\)"),
        ({}, {"force_x": "x[0]"}, r"component 0 of x, which has shape \(50,\)"),
        ({}, {"force_x": "f"}, r"for force_x; .* as in --map force_x=f\[0\]"),
        ({}, {"force_x": "x"}, r"force_y is missing \(the column force_y_n\).*force_y=0"),
        (
            {},
            {f"force_{axis}": "1" for axis in "xyz"},
            "force end in different rows: all are const",
        ),
        ({}, {"force_x": "x", "force_y": "short", "force_z": "0"}, "different rows: 9, 50"),
        (
            {},
            {"force_x": "x", "force_y": "none", "force_z": "0"},
            "force_y has no value in any row",
        ),
        ({}, {"position": "x"}, r"position has shape \(50,\), it must have shape \(n, 3\)"),
        ({"force_n": VECTORS[:, :2]}, {}, r"force has shape \(50, 2\)"),
        ({"force_n": VECTORS[:9]}, {}, r"force has 9 rows, its times \(time_s\) 50"),
        ({"time_s": np.array(1.0)}, {"force": "f"}, r"time_s has shape \(\), it must have"),
        (
            {"F.1": X, "F.2": X, "F.x": X},
            {"force": "F"},
            "F stands in 2 columns: which of F.1, F.2",
        ),
        ({"c_V": X}, {"force": "c_V"}, "force is mapped to c_V, which is in 'V' by the file"),
    ],
)
def test_what_cannot_be_mapped_is_refused_by_name(values, columns, reason):
    with pytest.raises(InputError, match=f"{reason}"):
        mapped({**SOUND, **values}, columns)
    if not columns:
        with pytest.raises(InputError, match=r"no column time_s, .*--rate HZ"):
            mapped({"force_n": VECTORS})


def test_why_a_column_holds_no_numbers_is_told():
    texts = np.array(["1", "a text of more than forty characters is cut", "no"])
    known = {"labels": {"f": texts}, "names": ("time_s", "f", "g"), "notes": ("g holds pictures",)}
    for name, reason in (
        ("f", f"f does not hold numbers: '{texts[1][:40]}' is none, nor a date .* for none$"),
        ("g", "force is mapped to g, which holds pictures; the columns are time_s, f, g"),
        ("h", "force is mapped to h, which is not there"),
    ):
        with pytest.raises(InputError, match=reason):
            mapped({"time_s": TIME_S}, {"force": name}, more=known)


def test_ends_that_were_left_out_are_blanks_also_of_an_arrays_elements():
    ends = {"F[0]": X, "F[1]": Y[:40], "F[2]": Z[:45], "time_s": TIME_S}
    axes = {f"force_{axis}": f"F[{place}]" for place, axis in enumerate("xyz")}
    expected = VECTORS.copy()
    expected[40:, 1], expected[45:, 2] = np.nan, np.nan
    for columns in (axes, {"force": "F"}):
        found = mapped(ends, columns, more={"ends_left_out": True})
        np.testing.assert_array_equal(found.values["force"], expected)


def test_parts_of_messages_are_found_by_what_they_are():
    parts = {"/w.a.force": VECTORS, "/w.a.torque": 2 * VECTORS, "/w.x": X, "time_s": TIME_S}
    np.testing.assert_array_equal(mapped(parts, {"force": "/w"}).values["force"], VECTORS)
    alone = mapped({"/i.any": VECTORS, "time_s": TIME_S}, {"acceleration": "/i"})
    np.testing.assert_array_equal(alone.values["acceleration"], VECTORS)
    with pytest.raises(InputError, match="position is mapped to /w, which is not there"):
        mapped(parts, {"position": "/w"})
    columns = {"force_x": "4.0", "force_y": "-1e1", "force_z": "F", "force_time": "/s"}
    found = mapped({**parts, "F.1": X, "/s.time": TIME_S + 3, "/s.n": X}, columns)
    np.testing.assert_array_equal(
        found.values["force"], np.column_stack([0 * X + 4, 0 * X - 10, X])
    )
    np.testing.assert_array_equal(found.times["force"], TIME_S + 3)
    numbered = {"1": TIME_S, "2": X}
    found = mapped(numbered, {"time": "1", "force_x": "0", "force_y": "5.0", "force_z": "2"})
    np.testing.assert_array_equal(found.values["force"], np.column_stack([0 * X, 0 * X + 5, X]))
    with pytest.raises(InputError, match=r"column 5, which is not there.*written 5\.0"):
        mapped(numbered, {"time": "1", "force": "5"})


def test_axes_that_are_mapped_count_more_than_an_array_of_the_standard_name():
    axes = {f"force_{axis}": f"F({place})" for place, axis in enumerate("xyz")}
    values = {f"F({place})": VECTORS[:, place] for place in range(3)}
    values |= {"time_s": TIME_S, "force_n": 0 * VECTORS, "c_V": X}
    file = dict.fromkeys(("F(0)", "F(1)", "F(2)"), "mN")
    for columns in (axes, {"force": "F"}, {**axes, "force": "F"}):
        found = mapped(values, columns, file=file)
        np.testing.assert_allclose(found.values["force"], VECTORS / 1e3)
    scaled = mapped(values, {"force": "c_V*2.5"}).values["force"]
    np.testing.assert_array_equal(scaled[:, 2], 2.5 * X)


def test_times_go_on_where_a_clock_or_a_counter_jumps():
    shifted = {"time_s": TIME_S + 3600 * (TIME_S > 0.02), "force_n": VECTORS}
    found = mapped(shifted, file={"time_s": "date"}, units={"time": "ms"})
    np.testing.assert_allclose(found.times["force"], TIME_S, atol=1e-9)
    assert any("time_s skips an hour" in note for note in found.notes)
    ticks = {"n_ms": (65_516.0 + np.arange(50)) % 65_536, "force_n": VECTORS}
    found = mapped(ticks, {"time": "n_ms"})
    np.testing.assert_allclose(found.times["force"], 65.516 + TIME_S)


TURNS = np.random.default_rng(2).normal(size=(50, 4))
TURNS /= np.linalg.norm(TURNS, axis=1, keepdims=True)


@settings(max_examples=20)
@given(st.permutations(range(4)), st.sampled_from([1.0, 1 + 1e-7, 1.009, 0.991, 1.02, 0.98]))
def test_an_orientation_is_four_components_or_an_array_in_the_order_of_its_name(order, norm):
    expected = TURNS if 1e-6 < abs(norm - 1.0) < 0.01 else TURNS * norm
    rest, turns = {"time_s": TIME_S, "force_n": VECTORS}, TURNS * norm
    axes = {f"/p.turn.{'wxyz'[place]}": turns[:, place] for place in order}
    for values, name in (
        ({"Q_WXYZ": turns}, "Q_WXYZ"),
        ({"q.xyzw": turns[:, [1, 2, 3, 0]], "q": turns}, "q.xyzw"),
        (axes, "/p"),
        ({"orientation": turns}, "orientation"),
    ):
        found = mapped({**rest, **values}, {"orientation": name}).values["orientation"]
        np.testing.assert_allclose(found, expected, atol=1e-12)
        own = mapped({**rest, **values}, {"orientation": name, "orientation_y": "0.5"})
        assert (own.values["orientation"][:, 2] > 0.48).all()
        assert ("orientation" in mapped({**rest, **values}).values) == (name == "orientation")
    for values, reason in (
        ({"q": turns}, "orientation is mapped to q, whose name does not tell its order"),
        ({"q": VECTORS}, r"mapped to q, which is no array of shape \(n, 4\)"),
        ({**axes, "q.a.w": turns, "q.b.w": turns}, "mapped to q, which is no array"),
    ):
        with pytest.raises(InputError, match=f"{reason}"):
            mapped({**rest, **values}, {"orientation": "q"})
    with pytest.raises(InputError, match="orientation_w is missing"):
        mapped({**rest, **axes}, {f"orientation_{axis}": f"/p.turn.{axis}" for axis in "xyz"})


LATE = np.r_[0:10, 20:30, 10:20, 30:50]
TWICE = np.r_[0:30, 20:50]


@pytest.mark.parametrize(
    ("rows", "left"), [(LATE, ""), (TWICE, ", and 10 that were written twice were left out")]
)
def test_rows_are_put_in_the_order_of_their_times_with_their_names(rows, left):
    speed = 100.0 + 50.0 * X
    speed[7] = np.nan
    values = {"t": TIME_S[rows], "f": VECTORS[rows], "v": speed[rows], "other": np.arange(7.0)}
    columns = {"time": "t", "force": "f", "speed": "v"}
    found = mapped(values, columns)
    ordered = mapped({"t": TIME_S, "f": VECTORS, "v": speed}, columns)
    for channel in ("force", "position"):
        np.testing.assert_array_equal(found.times[channel], TIME_S)
        np.testing.assert_array_equal(found.values[channel], ordered.values[channel])
        place = int(np.flatnonzero(rows == 40)[0])
        assert found.row_name(channel, 40) == f"row {place}, counted from 0"
    assert found.notes[0] == f"t falls: the rows were put in the order of their times{left}"
    assert not any("anew" in note for note in found.notes)
    exported = mapped({**values, "sequence": np.arange(len(rows)) * 1.0}, columns)
    assert not any("order" in note for note in exported.notes)


@pytest.mark.parametrize("phase", [0.1, 0.2, 0.5, 0.8])
def test_a_second_run_is_not_put_between_the_rows_of_the_first(phase):
    twice = np.r_[TIME_S, TIME_S + phase * (TIME_S[1] - TIME_S[0])]
    found = mapped({"t": twice, "f": np.r_[VECTORS, 1.0 + VECTORS]}, {"time": "t", "force": "f"})
    assert "t begins anew" in found.notes[0]
    np.testing.assert_array_equal(found.values["force"], np.r_[VECTORS, 1.0 + VECTORS])


def test_one_of_several_runs_is_taken_and_rows_that_were_never_filled_are_left_out():
    runs = {"t": np.tile(TIME_S, 3), "f": np.r_[VECTORS, 1.0 + VECTORS, 2.0 + VECTORS]}
    columns = {"time": "t", "force": "f"}
    for episode in (1, "2", 3):
        found = mapped(runs, columns, episode=episode)
        np.testing.assert_array_equal(found.values["force"], int(episode) - 1.0 + VECTORS)
        assert not any("anew" in note for note in found.notes)
    with pytest.raises(InputError, match="--episode 4: it has no such episode or trial, nor"):
        mapped(runs, columns, episode=4)
    unfilled = {"t": np.r_[TIME_S, np.zeros(3)], "f": np.r_[VECTORS, np.zeros((3, 3))]}
    found = mapped(unfilled, columns)
    np.testing.assert_array_equal(found.values["force"], VECTORS)
    assert found.notes == ("t: the last 3 rows hold only zeros and were left out",)


def test_messages_are_put_in_the_order_of_their_times():
    found = mapped({"/f": VECTORS[LATE]}, {"force": "/f"}, times={"/f": TIME_S[LATE]})
    np.testing.assert_array_equal(found.values["force"], VECTORS)
    assert found.notes == ("/f falls: the rows were put in the order of their times",)


@pytest.mark.parametrize("periods", [(1, 4, 2), (2, 1, 8), (1, 1, 1)])
def test_a_table_with_a_row_for_each_message_holds_channels_of_several_rates(tmp_path, periods):
    """As plotting programs write topics: one column of times, blanks for the other topics."""
    rows, arrays = [], {}
    for place, (field, period) in enumerate(zip(FIELD_OF_CHANNEL.values(), periods, strict=False)):
        time_s = np.round(np.arange(0.0, 2.0, period / 1000) + 1e-4 * place, 6)
        values = np.round(np.random.default_rng(place).standard_normal((len(time_s), 3)), 6)
        arrays |= {field: values, f"{field.split('_')[0]}_time_s": time_s}
        blanks = [""] * 3
        before, after = blanks * place, blanks * (2 - place)
        rows += [(t, *before, *v, *after) for t, v in zip(time_s, values.tolist(), strict=True)]
    np.savez(tmp_path / "apart.npz", **arrays)
    head = ",".join(["time_s", *(n for c in CHANNELS for n in axis_columns(c))])
    lines = [",".join(map(str, row)) for row in sorted(rows, key=lambda row: row[0])]
    (tmp_path / "together.csv").write_text("\n".join([head, *lines]), "utf-8")
    found = import_session(tmp_path / "together.csv", blanks_as_gaps=True)
    np.testing.assert_array_equal(found.frames, import_session(tmp_path / "apart.npz").frames)
