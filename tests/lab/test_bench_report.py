"""Tables and reports of the bench, from a result made by hand."""

import json
import re

from rich.console import Console

from mmt.evaluation.reports.document import ReportTable, as_rich
from mmt_lab.bench.command import write_bench_report
from mmt_lab.harness.findings import (
    Axis,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    SkippedMethod,
    Spread,
    Target,
)
from mmt_lab.harness.report import (
    panel_table,
    records_table,
    tables_of,
    targets_table,
)

TIME, ERROR = Axis("time (µs)", "µs"), Axis("error", "error")


def made_panel():
    curves = Curves()
    curves.add("mmt", 8, Spread(2.0, 1.9, 2.1), 1e-16)
    curves.add("mmt", 16, Spread.exact(4.0), 0.0)
    curves.add("peer", 8, Spread.exact(40.0), 1e-9)
    curves.fail("peer", 16, "raises: no")
    return Panel("p", "By order", "order", TIME, ERROR, curves.build())


def made_result():
    return Findings(
        "Burg's method",
        "What was measured.",
        panels=(made_panel(),),
        records=(
            FindingsTable(
                "stiff", "Stiff", ({"case": "tone", "stable": True, "error": 0.25, "x": None},)
            ),
        ),
        targets=(
            Target("faster", 20.0, "at least", 4.0),
            Target("slower", 7.0, "at most", 5.0),
            Target("unknown", None, "at most", 5.0),
        ),
        left_out=(SkippedMethod("librosa", "cannot be imported", "pip install librosa"),),
        name="burg",
    )


def test_a_panel_has_a_row_for_each_setting():
    assert panel_table(made_panel()).rows == [
        ("mmt", "8", "2 ±5 %", "1e-16"),
        ("", "16", "4", "0"),
        ("peer", "8", "40", "1e-09"),
        ("", "16", "-", "raises: no"),
    ]


def test_records_and_targets_are_said_in_words():
    result = made_result()
    assert records_table(result.records[0]).rows == [("tone", "yes", "0.25", "-")]
    assert targets_table([result]).rows == [
        ("faster", "burg", "20", "at least 4", "yes"),
        ("slower", "burg", "7", "at most 5", "no"),
        ("unknown", "burg", "-", "at most 5", "not measured"),
    ]
    assert tables_of(result)[-1].rows == [("librosa", "cannot be imported", "pip install librosa")]


def test_a_report_is_one_page_with_its_plots_inside(tmp_path):
    page = write_bench_report(tmp_path / "out", [made_result()], {"processor": "a machine"})
    html = page.read_text(encoding="utf-8")
    assert "data:image/png;base64," in html
    assert not re.search(r"(src|href)=\"http", html)
    assert "a machine" in html
    markdown = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "![" in markdown
    assert (tmp_path / "out" / "figures" / "burg.png").exists()
    figures = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))
    assert figures["burg"]["panels"][0]["curves"][1]["failures"] == {"16": "raises: no"}
    assert figures["machine"] == {"processor": "a machine"}


def test_what_is_said_once_is_not_repeated():
    curves = Curves()
    curves.add("mmt", 8, 8, 1e-16)
    curves.fail("mmt", 16, "raises: no")
    over_knob = Panel("p", "By order", "order", Axis("order", "order"), ERROR, curves.build())
    table = panel_table(over_knob)
    assert table.columns == ("method", "order", "error")
    assert table.rows == [("mmt", "8", "1e-16"), ("", "16", "raises: no")]

    rows = ({"case": "tone", "n": 1}, {"case": "tone", "n": 2}, {"case": "step", "n": 1})
    assert records_table(FindingsTable("r", "R", rows)).rows == [
        ("tone", "1"),
        ("", "2"),
        ("step", "1"),
    ]


def test_a_table_in_eighty_columns_loses_no_number_and_no_word():
    words = "a method of a rather long name that no peer would ever have"
    table = ReportTable(
        ("method", "order", "remark"),
        [(words, str(number), f"{words} {number}") for number in (8, 123456789)],
    )
    console = Console(width=80)
    with console.capture() as capture:
        console.print(as_rich(table))
    lines = capture.get().splitlines()
    assert max(map(len, lines)) <= 80
    for word in [*words.split(), "123456789"]:
        assert sum(line.split().count(word) for line in lines) >= 2
