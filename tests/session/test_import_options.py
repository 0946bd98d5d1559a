"""What an import is told: columns, units and forms, each within its bounds."""

import re
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.options import ImportOptions, Source, assignments, quantity_of

REFUSED = {
    "--map weight=": [{"columns": {"weight": "x"}}],
    r"--unit weight=\.\.\.: ": [{"units": {"weight": "g"}}],
    "--unit force=bar: bar is no known unit of it; known are N, mN": [{"units": {"force": "bar"}}],
    "--unit orientation(_w)?=deg: deg is no known unit of it; known are none": [
        {"units": {name: "deg"}} for name in ("orientation", "orientation_w")
    ],
    "--unit force_time=N": [{"units": {"force_time": "N"}}],
    "--offset b=": [
        {"offsets": {"a": "match", "b": text}} for text in ("1s", "", ".", "1e3", "--1")
    ],
    "--acceleration-rate": [
        {"acceleration_rate_hz": rate} for rate in (0, 500, 1500, 11_000, -1000)
    ],
    "--tool-axes speed: it is force or acceleration": [{"tool_axes": ("force", "speed")}],
    "--stamps keep: it is auto, regular, kept, header, receipt": [{"stamps": "keep"}],
    "--header ": [{"header": line} for line in (0, -1)],
    "--decimal ": [{"decimal": sign} for sign in ("", ";", "..")],
    "--separator ": [{"separator": sign} for sign in ("", "dot", ",,")],
    **{
        name: [{name: value} for value in (0.0, -5.0, float("nan"), float("inf"), 1e9)]
        for name in ("rate_hz", "longest_gap_s", "reading_memory_gb", "reading_time_s")
    },
}


@pytest.mark.parametrize("reason", REFUSED)
def test_options_that_mean_nothing_are_refused(reason):
    for wrong in REFUSED[reason]:
        with pytest.raises(InputError, match=f"^{reason}"):
            ImportOptions(**wrong)


@pytest.mark.parametrize(
    ("given", "texts"),
    [
        (
            {"columns": {"force_x": 0, "force_z": 1.5}},
            {"columns": {"force_x": "0", "force_z": "1.5"}},
        ),
        ({"offsets": {"a.csv": -7.25}}, {"offsets": {"a.csv": "-7.25"}}),
        ({"sheet": 2}, {"sheet": "2"}),
        ({"missing": "-999"}, {"missing": ("-999",)}),
        ({"missing": [-999, "?"]}, {"missing": ("-999", "?")}),
        ({"tool_axes": "force"}, {"tool_axes": ("force",)}),
    ],
)
def test_numbers_and_single_texts_are_what_the_command_is_given(given, texts):
    assert ImportOptions(**given) == ImportOptions(**texts)


def test_the_function_names_every_option_of_the_command():
    told = set(re.findall(r"``(\w+)``", import_session.__doc__))
    assert {each.name for each in fields(ImportOptions)} <= told | {"columns", "units"}


def test_options_at_their_bounds_are_taken_and_said_on_the_command_line():
    assert ImportOptions().arguments() == []
    offsets = {name: name for name in ("match", "1", "-1.", "+.5", "1.25")}
    options = {"columns": {"force": "-F"}, "units": {"force_z": "mN", "time": "ms"}, "rate_hz": 0.5}
    options |= {"longest_gap_s": 1e8, "stamps": "kept", "episode": 0, "header": 1, "sheet": "a b"}
    options |= {"separator": "tab", "decimal": ",", "missing": ("?", "0"), "blanks_as_gaps": True}
    options |= {"acceleration_rate_hz": 10_000, "tool_axes": ("force", "acceleration")}
    options |= {"reading_memory_gb": 4.0, "reading_time_s": 9.0, "offsets": offsets}
    said = "--map force=-F --unit force_z=mN --unit time=ms --rate=0.5 --blanks-as-gaps"
    said += " --longest-gap=100000000.0 --stamps=kept --episode=0 --header=1 --sheet=a_b"
    said += " --separator=tab --decimal=, --missing=? --missing=0 --acceleration-rate=10000"
    said += " --tool-axes=force --tool-axes=acceleration --reading-memory=4.0 --reading-time=9.0"
    assert ImportOptions(**options).arguments() == [
        s.replace("a_b", "a b") for s in said.split(" ")
    ]
    signs = [
        ImportOptions(separator=name).delimiter
        for name in ("comma", "semicolon", "tab", "blank", "|", None)
    ]
    assert signs == [",", ";", "\t", " ", "|", None]
    quantities = [
        *map(quantity_of, ("time", "force_time", "time_fraction", "force", "force_x", "speed"))
    ]
    assert quantities == ["time", "time", "time", "force", "force", "speed"]


@given(
    st.booleans(),
    st.sampled_from(["F", "a.b", "F\n(N)", "a[0", "m*s"]),
    st.none() | st.integers(0, 99),
    st.none() | st.floats(-1e9, 1e9),
)
def test_a_source_is_a_column_its_component_its_sign_and_a_factor(minus, name, component, factor):
    element = name if component is None else f"{name}[{component}]"
    text = "-" * minus + element + ("" if factor is None else f"*{factor!r}")
    options = ImportOptions({"force": text})
    scale = (-1.0 if minus else 1.0) * (1.0 if factor is None else factor)
    assert options.source("force", {}) == Source(name, component, scale)
    assert options.source("force", {element: 0, text: 0}) == Source(text)
    assert options.source("force", {element: 0}) in (Source(element, None, scale), Source(text))
    assert options.source("position", {}) is None
    assert options.mapped_names() == {text, name}


def test_pairs_on_the_command_line_have_one_form():
    assert assignments(["a=b", "c = d=e"], "--map") == {"a": "b", "c": "d=e"}
    for wrong in ["a"], ["=b"], ["a="], ["a=b", "a=c"]:
        with pytest.raises(InputError, match="--map"):
            assignments(wrong, "--map")


def test_no_file_is_said():
    with pytest.raises(InputError, match="there is no file to import"):
        import_session([])
