"""The clockwork of the bench: turns, spreads, targets, peers that are missing."""

import json
import math
import sys
import time

import numpy as np

from mmt_lab.bench import peers
from mmt_lab.bench.measuring import interleave, spread
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


def test_methods_take_turns_in_an_order_that_moves_on():
    calls = []
    tasks = {name: lambda name=name: calls.append(name) for name in "abc"}
    interleave(tasks, rounds=3, least_s=0.0)
    # Two calls each to see how long one takes, then the rounds.
    assert "".join(calls) == "aabbcc" + "abc" + "bca" + "cab"


def test_a_slower_task_takes_longer_and_short_ones_are_repeated():
    calls = []
    times = interleave(
        {"slow": lambda: time.sleep(0.004), "fast": lambda: calls.append(1)}, 3, least_s=0.001
    )
    assert times["slow"].median > 0.004
    assert times["fast"].median < times["slow"].median / 4
    assert len(calls) > 30


def test_spread_is_median_and_quartiles():
    assert spread(np.array([5.0, 1.0, 2.0, 4.0, 3.0])) == Spread(3.0, 2.0, 4.0)
    assert Spread(4.0, 3.0, 5.0).relative == 0.25
    assert Spread(4.0, 3.0, 5.0).times(2.0) == Spread(8.0, 6.0, 10.0)
    assert Spread.exact(0.0).relative == 0.0


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


def test_a_result_is_plain_json():
    result = Findings(
        "S",
        "about",
        records=(FindingsTable("r", "R", ({"a": math.nan, "b": True},)),),
        targets=(Target("t", 2.0, "at least", 1.0),),
        left_out=(SkippedMethod("x", "not here", "pip install x"),),
        figures={"k": 1},
    )
    content = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert content["targets"][0]["met"] is True
    assert content["records"][0]["rows"] == [{"a": None, "b": True}]
    assert content["figures"] == {"k": 1}


def test_a_peer_that_is_not_installed_is_left_out_with_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "librosa", None)
    modules, left_out = peers.find(("librosa", "mpmath"))
    assert list(modules) == ["mpmath"]
    assert left_out[0].name == "librosa"
    assert "pip install librosa" in left_out[0].remedy
