import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.core.errors import InputError, MmtError
from mmt_lab.cli import benching
from mmt_lab.cli.benching import run_benches
from mmt_lab.harness.findings import Findings, Target


def test_an_unknown_stage_is_explained() -> None:
    with pytest.raises(InputError, match=r"allowed are burg, lines, .*, link, services, evaluate"):
        run_benches(["speed"], 1.0)


def test_the_evaluation_is_measured() -> None:
    _, figures = run_benches(["evaluate"], 1.0)
    found = figures["evaluate"]["figures"]
    assert found["median_s"] > 0
    assert found["times_real_time"] == pytest.approx(18.0 / found["median_s"])
    assert figures["machine"]["processor"]


def test_the_link_is_measured_beside_a_bare_websocket() -> None:
    _, figures = run_benches(["link"], 1.5)
    assert figures["link"]["figures"]["up_lost"] == 0
    assert figures["link"]["figures"]["ratio_up_p50"] > 0
    assert figures["link"]["targets"][0]["met"] is True


def test_targets_are_printed_beside_what_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    result = Findings("B", "About.", targets=(Target("ratio", 5.0, "at least", 4.0),))
    monkeypatch.setattr(benching, "run_stage", lambda name: result)
    results, _ = run_benches(["burg", "burg"], 1.0)
    assert results == [replace(result, name="burg")]
    printed = capsys.readouterr().out
    assert "ratio" in printed
    assert "at least 4" in printed


def test_a_stage_without_its_reference_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Findings:
        raise ModuleNotFoundError("No module named 'mpmath'", name="mpmath")

    monkeypatch.setattr(benching, "run_stage", missing)
    results, figures = run_benches(["burg"], 1.0)
    assert results[0].left_out[0].name == "mpmath"
    assert "mmt-haptics[bench]" in figures["burg"]["left_out"][0]["remedy"]


def test_a_stage_that_fails_leaves_the_others_their_figures(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(name: str) -> Findings:
        if name == "burg":
            raise MmtError("a process gave nothing")
        return Findings("Lines", "About.")

    monkeypatch.setattr(benching, "run_stage", run)
    report, figures = str(tmp_path / "report"), tmp_path / "figures.json"
    arguments = ["bench", "burg", "lines", "--report", report, "--json", str(figures)]
    ended = CliRunner().invoke(app, arguments)
    assert isinstance(ended.exception, MmtError)
    assert str(ended.exception) == "not measured: burg"
    assert "Lines" in (tmp_path / "report" / "report.html").read_text()
    written = json.loads(figures.read_text())
    assert written["failed"] == {"burg": "a process gave nothing"}
    assert written["lines"]["title"] == "Lines"
