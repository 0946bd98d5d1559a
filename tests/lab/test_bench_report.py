"""The clockwork of the bench, and its tables and reports from a result made by hand."""

import math
import sys
import time

from mmt_lab.bench import measuring, peers
from mmt_lab.bench.measuring import interleave
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
from mmt_lab.harness.report import panel_table, records_table, tables_of, targets_table

ROWS = (
    {"case": "tone", "stable": True, "error": 0.25, "x": None},
    {"case": "tone", "stable": False, "error": 2.5, "x": None},
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
        records=(FindingsTable("stiff", "Stiff", ROWS),),
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
    assert records_table(result.records[0]).rows == [
        ("tone", "yes", "0.25", "-"),
        ("", "no", "2.5", "-"),
    ]
    assert targets_table([result]).rows == [
        ("faster", "burg", "20", "at least 4", "yes"),
        ("slower", "burg", "7", "at most 5", "no"),
        ("unknown", "burg", "-", "at most 5", "not measured"),
    ]
    assert tables_of(result)[-1].rows == [("librosa", "cannot be imported", "pip install librosa")]


def test_over_its_own_setting_a_panel_has_one_column_less():
    curves = Curves()
    curves.add("mmt", 8, 8, 1e-16)
    curves.fail("mmt", 16, "raises: no")
    over_knob = Panel("p", "By order", "order", Axis("order", "order"), ERROR, curves.build())
    table = panel_table(over_knob)
    assert table.columns == ("method", "order", "error")
    assert table.rows == [("mmt", "8", "1e-16"), ("", "16", "raises: no")]


def test_methods_take_turns_in_an_order_that_moves_on(monkeypatch):
    monkeypatch.setattr(measuring, "LEAST_S", 0.0)
    calls = []
    tasks = {name: lambda name=name: calls.append(name) for name in "abc"}
    interleave(tasks, rounds=3)
    # Two calls each to see how long one takes, then the rounds.
    assert "".join(calls) == "aabbcc" + "abc" + "bca" + "cab"


def test_a_slower_task_takes_longer_and_short_ones_are_repeated():
    calls = []
    times = interleave({"slow": lambda: time.sleep(0.004), "fast": lambda: calls.append(1)}, 3)
    assert times["slow"].median > 0.004
    assert times["fast"].median < times["slow"].median / 4
    assert len(calls) > 30


def test_what_is_not_finite_is_a_failure_and_no_point():
    curves = Curves()
    curves.add("a", 1, 2.0, 3.0)
    curves.add("a", 2, 2.0, math.inf)
    curves.fail("b", 1, "raises")
    first, second = curves.build()
    assert [point.knob for point in first.points] == [1]
    assert first.failures == {"2": "not finite"}
    assert second.points == ()
    assert second.failures == {"1": "raises"}


def test_ratios_are_taken_where_both_have_a_point():
    curves = Curves()
    for knob, time_us in ((1, 10.0), (2, 30.0), (3, 50.0)):
        curves.add("slow", knob, time_us, 1.0)
    for knob, time_us in ((1, 2.0), (2, 5.0)):
        curves.add("fast", knob, time_us, 1.0)
    axis = Axis("x", "x")
    panel = Panel("p", "p", "knob", axis, axis, curves.build())
    assert panel.x_ratios("slow", "fast") == {1: 5.0, 2: 6.0}
    assert panel.x_ratios("none", "fast") == {}
    assert panel.points("none") == ()


def test_a_peer_that_is_not_installed_is_left_out_with_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "librosa", None)
    modules, left_out = peers.find(("librosa", "mpmath"))
    assert list(modules) == ["mpmath"]
    assert left_out[0].name == "librosa"
    assert "pip install librosa" in left_out[0].remedy
