"""The harness of the laboratory: experiments are found, run, printed and reported."""

import json
import math
import sys
import textwrap

import pytest
from command_runs import run
from lab_runs import run_lab

from mmt.core.errors import InputError, MmtError
from mmt.evaluation.reports.document import Paragraph, ReportTable
from mmt_lab import experiments
from mmt_lab.harness.experiment import chosen_textures, listed, load
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.harness.processes import background_processes, map_in_processes, received
from mmt_lab.harness.report import missed_because, targets_table, write_report

MADE_UP = """
    from mmt_lab.harness.experiment import Seeds
    from mmt_lab.harness.findings import Findings, Target

    SHOWS = "how many seeds there are"
    TAKES = "no time"

    def run(seeds: Seeds = 2) -> Findings:
        'Count seeds.'
        return Findings(
            "Seeds",
            "Counted.",
            targets=(Target("seeds", seeds, "at least", 2),),
            failures=["too few"] if seeds < 2 else [],
            data={"seeds": seeds},
        )
"""


@pytest.fixture
def made_up(tmp_path, monkeypatch):
    """One more module in one more folder of the experiments."""
    folder = tmp_path / "more"
    folder.mkdir()
    (folder / "made_up.py").write_text(textwrap.dedent(MADE_UP), encoding="utf-8")
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder)])
    yield "made-up"
    sys.modules.pop("mmt_lab.experiments.made_up", None)


def test_a_new_module_is_listed_and_run_without_any_other_change(made_up, tmp_path):
    listing = run("lab")
    assert made_up in listing.output
    assert "how many seeds there are" in " ".join(listing.output.split())
    report = tmp_path / "report"
    written, output = run_lab(tmp_path, made_up, "--seeds", "3", "--report", str(report))
    assert "Counted." in output
    assert written["seeds"] == 3
    assert written["judged"][0]["met"] is True
    assert "at least 2" in (report / "report.md").read_text(encoding="utf-8")


def test_what_did_not_hold_ends_with_1(made_up, tmp_path):
    assert "too few" in run_lab(tmp_path, made_up, "--seeds", "1", code=1)[1]


@pytest.mark.parametrize("one", list(listed()), ids=lambda one: one.name)
def test_an_experiment_is_what_the_list_says(one):
    try:
        found = sys.modules[load(one.name).__module__]
    except ImportError as error:
        if (error.name or "mmt").partition(".")[0] in {"mmt", "mmt_lab"}:
            raise
        pytest.skip(f"{error.name} is not installed")
    assert (one.shows, one.takes) == (found.SHOWS, found.TAKES)
    assert getattr(found, "GROUP", "lab") == one.group


def test_textures_are_names_between_commas():
    assert chosen_textures("wood, glass") == ["wood", "glass"]
    assert len(chosen_textures(None)) > 10
    with pytest.raises(InputError, match="surface is 'velvet', allowed are"):
        chosen_textures("velvet")


def test_calls_give_the_same_in_processes_and_in_this_one():
    calls = [(base, 2) for base in range(5)]
    here = map_in_processes(pow, calls, what="powers", workers=1)
    assert here == [0, 1, 4, 9, 16]
    assert map_in_processes(pow, calls, what="powers", workers=2) == here


def test_a_report_shows_blocks_in_place_of_tables_and_the_definitions(tmp_path):
    found = Findings(
        "Title",
        tables=[ReportTable(("a",), [("shown in the terminal",)])],
        blocks=lambda: [Paragraph("shown in the report")],
        targets=(Target("speed", None, "at most", 1.0),),
        definitions={"speed": "how fast"},
        data={"x": 1},
    )
    text = write_report(tmp_path, found).read_text(encoding="utf-8")
    assert "shown in the report" in text
    assert "shown in the terminal" not in text
    assert "not measured" in text
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["x"], summary["definitions"]) == (1, {"speed": "how fast"})
    assert "python" in summary["environment"]


@pytest.mark.parametrize(
    ("side", "measured", "met"),
    [
        ("at least", 4.0, True),
        ("at least", 3.9, False),
        ("at most", 4.0, True),
        ("at most", 4.1, False),
        ("about", 3.6, True),
        ("about", 4.4, True),
        ("about", 3.4, False),
        ("about", 4.6, False),
        ("about", math.nan, False),
        ("about", None, None),
    ],
)
def test_a_target_knows_whether_it_is_met_and_says_why_not(side, measured, met):
    target = Target("sum", measured, side, 4.0, tolerance=0.5, reason="another hand")
    assert target.met is met
    found = Findings("Sums", targets=(target, Target("other", 1.0, "at most", 0.0)))
    (row, _) = targets_table([found]).rows
    assert row[3] == f"{side} 4 ± 0.5"
    expected = [] if met else ["not met: sum: another hand"]
    assert missed_because([found]) == expected


def test_targets_with_one_reason_share_a_sentence():
    missed = [Target(name, 0.0, "at least", 1.0, reason="why") for name in ("a", "b")]
    results = [Findings("One", targets=(missed[0],)), Findings("Two", targets=(missed[1],))]
    assert missed_because(results) == ["not met: a, b: why"]


def tell(pipe, kind):
    """Be a process that fails, ends, or is silent until nobody wants it any more."""
    if kind == "fails":
        raise InputError("there is no such device")
    if kind == "is silent":
        pipe.recv()


@pytest.mark.parametrize(
    ("kind", "longest_s", "words"),
    [
        ("fails", 60.0, "there is no such device"),
        ("ends", 60.0, "a process has failed"),
        ("is silent", 0.5, "gave nothing in 0.5 s"),
    ],
)
def test_what_becomes_of_a_process_is_told(kind, longest_s, words):
    with background_processes((tell, kind)) as (pipe,), pytest.raises(MmtError, match=words):
        received(pipe, longest_s)
