import json
from dataclasses import replace

import pytest
from command_runs import refusal

from mmt.core.errors import MmtError
from mmt_lab.bench.command import run_benches
from mmt_lab.experiments.bench import evaluate
from mmt_lab.harness import command
from mmt_lab.harness.findings import Findings, Target


def test_the_evaluation_is_measured(monkeypatch):
    monkeypatch.setattr(evaluate, "EVALUATIONS", {(6.0, 1): (2, 1.0), (6.0, 2): (1, 1e6)})
    _, figures = run_benches(["evaluate"])
    found = figures["evaluate"]["figures"]
    assert found["median_6_s"] > 0
    assert found["times_real_time_6_s"] == pytest.approx(6.0 / found["median_6_s"])
    assert 0 < found["update_ms_6_s"] <= found["longest_update_ms_6_s"]
    assert found["times_real_time_6_s_2_khz"] == pytest.approx(6.0 / found["median_6_s_2_khz"])
    assert [target["met"] for target in figures["evaluate"]["targets"]] == [True, False]
    assert figures["machine"]["processor"]
    assert {"python", "numpy", "numba", "machine"} <= set(figures["machine"])


def test_the_link_is_measured_beside_a_bare_websocket():
    _, figures = run_benches(["link"], duration=1.5)
    assert figures["link"]["figures"]["up_lost"] == 0
    assert figures["link"]["figures"]["ratio_up_p50"] > 0
    assert figures["link"]["targets"][0]["met"] is True


def test_targets_are_printed_beside_what_is_measured(monkeypatch, capsys):
    result = Findings("B", "About.", targets=(Target("ratio", 5.0, "at least", 4.0),))
    monkeypatch.setattr(command, "load", lambda name: lambda: result)
    results, _ = run_benches(["burg", "burg"])
    assert results == [replace(result, name="burg")]
    printed = capsys.readouterr().out
    assert "ratio" in printed
    assert "at least 4" in printed


def test_a_stage_without_its_reference_is_left_out(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError("No module named 'mpmath'", name="mpmath")

    monkeypatch.setattr(command, "load", missing)
    results, figures = run_benches(["burg"])
    assert results[0].left_out[0].name == "mpmath"
    assert "[bench]" in figures["burg"]["left_out"][0]["remedy"]


def test_a_stage_that_fails_leaves_the_others_their_figures(monkeypatch, tmp_path):
    def fail():
        raise MmtError("a process gave nothing")

    stages = {"burg": fail, "lines": lambda: Findings("Lines", "About.")}
    monkeypatch.setattr(command, "load", stages.__getitem__)
    figures = tmp_path / "figures.json"
    files = ("--report", tmp_path / "report", "--json", figures)
    assert refusal("bench", "burg", "lines", *files, kind=MmtError) == "not measured: burg"
    assert "Lines" in (tmp_path / "report" / "report.html").read_text()
    written = json.loads(figures.read_text())
    assert written["failed"] == {"burg": "a process gave nothing"}
    assert written["lines"]["title"] == "Lines"
