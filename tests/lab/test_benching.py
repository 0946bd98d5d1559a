"""The experiments of the bench: the evaluation, the link, lost packets, and strangers."""

import json
import math
import os
from dataclasses import replace

import numpy as np
import pytest
from command_runs import refusal

from mmt.cli.running.scene_services import DemoRun
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import COMMAND_DTYPE
from mmt_lab.bench import lossy_path
from mmt_lab.bench.command import run_benches
from mmt_lab.bench.link_sides import Side, SideReport, TurnFigures
from mmt_lab.bench.strangers import BYSTANDER, KINDS
from mmt_lab.experiments.bench import evaluate, link, services
from mmt_lab.experiments.bench.link import missing_at_end, ratios, summarise
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
    found = figures["link"]["figures"]
    assert found["up_lost"] == found["down_lost"] == 0
    assert all(math.isfinite(found[f"ratio_{name}"]) for name in ("up_p50", "down_p99"))
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


def measured(**changes):
    usual = {"p50_ms": 1.0, "p99_ms": 2.0, "rate_hz": 1000.0, "cores": 0.1}
    return TurnFigures("ours", **{**usual, "lost": 0, "out_of_order": 0, **changes})


def test_a_disturbed_turn_does_not_move_the_ratios():
    ours = [(measured(p99_ms=3.0, cores=0.2), measured(p50_ms=1.25))] * 4
    bare = [(measured(), measured())] * 4
    disturbed = (measured(p50_ms=90.0, p99_ms=90.0, cores=0.9), measured(p99_ms=70.0))
    expected = {"up_p50": 1.0, "up_p99": 1.5, "down_p50": 1.25, "down_p99": 1.0}
    expected |= {"leader_cores": 2.0, "follower_cores": 1.0}
    assert ratios(ours, bare) == pytest.approx(expected)
    assert ratios([*ours, disturbed], [*bare, bare[0]]) == pytest.approx(expected)


def test_what_is_lost_is_summed_and_includes_the_tail():
    turns = [(measured(lost=2), measured()), (measured(out_of_order=1), measured())]
    result = summarise(turns, missing_up=3, missing_down=1)
    up, down = result["up"], result["down"]
    assert (up.lost, up.out_of_order) == (5, 1)
    assert (down.lost, down.out_of_order) == (1, 0)
    assert missing_at_end(SideReport([], 10, -1), SideReport([], 0, 7)) == 2


def test_a_side_counts_gaps_and_disorder():
    sender, receiver = Side(COMMAND_DTYPE), Side(COMMAND_DTYPE)
    records = [sender.next_record() for _ in range(8)]
    receiver.record_block(np.concatenate(records[:2]), 0)
    for number in (4, 3, 7):
        receiver.record(records[number].tobytes())
    assert (receiver.sent, receiver.lost, receiver.out_of_order) == (0, 2 + 2, 1)
    assert (sender.sent, sender.lost, sender.out_of_order) == (8, 0, 0)
    assert receiver.latency.count == 5


@pytest.mark.parametrize("duration_s", [0.0, -1.0, math.nan])
def test_the_duration_must_be_positive(duration_s):
    with pytest.raises(InputError, match="must be positive"):
        link.bench_link(duration_s)


def test_a_duration_without_an_end_is_refused():
    with pytest.raises(InputError, match="--duration inf: must be a finite number"):
        command.run("link", duration=math.inf)


def test_loss_stalls_what_is_sent_again(monkeypatch):
    monkeypatch.setattr(lossy_path, "LOSSES", (0.03,))
    found = lossy_path.measure_losses(1.5)
    rows = {records.name: dict(records.rows[0]) for records in found.records}
    assert {"retransmitted", "datagrams"} <= set(rows)
    assert ("tcp" in rows) != bool(found.left_out)
    assert os.geteuid() == 0 or found.left_out
    for row in rows.values():
        for what in ("frames", "commands"):
            p50, p99, largest = (row[f"{what} {name} (ms)"] for name in ("p50", "p99", "max"))
            assert lossy_path.DELAY_MS < p50 <= p99 <= largest
    assert rows["retransmitted"]["frames max (ms)"] > 3 * lossy_path.DELAY_MS


def test_a_stranger_who_makes_more_than_twice_the_ticks_late_is_seen(monkeypatch):
    shares = {BYSTANDER: 0.01, "maps": 0.021}
    ran = []

    async def beside(kind, _):
        ran.append(kind)
        return DemoRun(leader={"ticks": {"late_share_1ms": shares.get(kind, 0.02)}})

    monkeypatch.setattr(services, "_beside", beside)
    found = services.run(duration=10.0, strangers=True)
    assert ran == ["alone", BYSTANDER, *KINDS] * 2
    assert found.figures["maps"] == pytest.approx(0.021)
    missed = [target.what for target in found.targets if not target.met]
    assert missed == [KINDS["maps"]]


def test_two_ways_at_once_are_refused():
    with pytest.raises(InputError, match="not both"):
        services.run(realtime=True, strangers=True)
