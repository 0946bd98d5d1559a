"""Names of columns, their units and the data beside them, whatever file holds them."""

import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.importing import columns
from mmt.session.importing.options import ImportOptions


@settings(max_examples=50)
@given(st.lists(st.sampled_from(["", "F", "F.1", "F.2", "x", "3", "4"]), max_size=9))
def test_each_name_stands_once_and_keeps_its_beginning(names):
    found, notes = columns.distinct(names)
    assert len(set(found)) == len(found) == len(names)
    for place, (name, new) in enumerate(zip(names, found, strict=True), start=1):
        numbered = "" if name and names.count(name) == 1 else r"(\.\d+)?"
        assert re.fullmatch(re.escape(name or str(place)) + numbered, new)
    doubled = [name for name in dict.fromkeys(names) if name and names.count(name) > 1]
    told = [f"{names.count(n)} columns are called {n}: {n}.1 and so on" for n in doubled]
    assert notes == told


def test_a_list_of_names_is_bounded():
    names = [letter * 99 for letter in "abcdefghijklm"]
    assert len(columns.distinct(names * 2)[1]) == 12
    shown = ", ".join(name[:60] for name in names[:12])
    assert columns.listed(names) == f"the first of 13 columns are {shown}"
    assert columns.listed(names[:12]) == f"the columns are {shown}"
    assert columns.listed([]) == "the columns are none"


def test_a_column_is_wanted_if_it_is_part_of_what_is_mapped():
    wanted = columns.Wanted({"a", "b.c"})
    names = ("a", "a.x", "a[0]", "a(1)", "b.c.d", "ab", "b", "b.cd", "")
    assert [*map(wanted, names)] == 5 * [True] + 4 * [False]
    mapped = columns.wanted_names(ImportOptions({"force": "-F[2]*3"}))
    assert mapped >= {"F", "sequence", "began_utc_ns", "time_s", "force_x_n", "-F[2]*3"}


def test_the_unit_is_among_the_attributes():
    attributes = {"name": "x", b"UNIT": np.array(["N", "N", "mN"]), "unit": "mm"}
    assert columns.told_unit(attributes) == "N, mN"
    assert columns.told_unit({"Units": [b"mm"], "name": "x"}) == "mm"
    assert columns.told_unit({"name": "x"}) == ""


@pytest.mark.parametrize(
    ("damage", "error", "text"),
    [
        (Exception, InputError("import a.csv: empty"), "empty"),
        (Exception, InputError("empty"), "empty"),
        (Exception, ValueError("bad"), "this is not a table: bad"),
        *((damage, OSError(2, "No such file"), "No such file") for damage in (Exception, KeyError)),
        (Exception, OSError("bad"), "this is not a table: bad"),
        (KeyError, OSError("bad"), "bad"),
    ],
)
def test_what_goes_wrong_in_a_reader_names_the_file(damage, error, text):
    with (
        pytest.raises(InputError) as caught,
        columns.named("import a.csv"),
        columns.reading("a table", (damage,)),
    ):
        raise error
    assert str(caught.value) == f"import a.csv: {text}"


FORMS = (str, str.encode, lambda text: np.array([text]), lambda text: np.array(text.encode(), "O"))


@settings(max_examples=30)
@given(st.sampled_from(FORMS), st.text(max_size=3), st.binary(), st.integers(-(2**63), 2**63 - 1))
def test_what_stands_beside_the_columns_comes_back(form, name, truth, began):
    scene = {name: began}
    stored = {"scene_json": form(json.dumps(scene)), "events_json": form(json.dumps([scene] * 2))}
    for annotations in (truth, np.frombuffer(truth, "u1")):
        stored |= {"annotations": annotations, "began_utc_ns": np.array([began])}
        found = columns.beside_columns(stored)
        assert [*found.values()] == [scene, [scene] * 2, truth, began]
    nothing = {"scene": None, "events": [], "annotations": b"", "began_utc_ns": None}
    assert columns.beside_columns({"events_json": None}) == nothing


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [
        ("scene_json", ("[]", "1"), "scene is not a JSON object"),
        ("scene_json", ("{", b"\xff", "[" * 100_000), "scene is not valid JSON: "),
        ("events_json", ("{}", "[1]", "[{}, 1]"), "events is not a list of JSON objects"),
        ("events_json", ("",), "events is not valid JSON: "),
        ("began_utc_ns", ("now", 2**63, [-(2**63) - 1], np.nan), "began_utc_ns is not a number of"),
    ],
)
def test_what_cannot_stand_beside_the_columns_is_refused_by_name(name, values, reason):
    for value in values:
        with pytest.raises(InputError, match=f"^{reason}"):
            columns.beside_columns({name: value})
