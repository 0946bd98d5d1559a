"""The table's machinery: rows, families, JSON, report, exit codes."""

import json
import math

import numpy as np
import pytest
from command_runs import run, run_json

from mmt.core.errors import InputError
from mmt_lab.experiments import stability
from mmt_lab.experiments.stability import (
    by_family,
    family_table,
    findings_of,
    load_families,
    overview,
    summary,
)
from mmt_lab.harness.report import write_report
from mmt_lab.stability.families import (
    CaseResult,
    Extreme,
    Family,
    broken,
    contact,
    family_names,
    model,
    run_case,
)


def row(*, held=True, **figures):
    case = Extreme("a thing is done", "it holds", lambda: CaseResult("it did", held, figures))
    return run_case("model", case)


def fault():
    message = "no luck"
    raise ArithmeticError(message)


def test_a_case_that_raises_has_not_held():
    found = run_case("ar", Extreme("divide", "a number", fault))
    assert not found.held
    assert found.got == "raised ArithmeticError: no luck"
    assert broken([row(), found]) == [found]


def test_a_row_can_be_read_by_a_program():
    figures = {"none": math.inf, "some": np.float64(2.5), "many": [np.int64(3), math.nan]}
    rows = [row(held=np.bool_(True), **figures)]
    (found,) = json.loads(json.dumps(findings_of(rows).as_dict()))["rows"]
    assert found["held"] is True
    assert found["figures"] == {"none": None, "some": 2.5, "many": [3, None]}


@pytest.mark.parametrize("name", family_names())
def test_every_family_has_cases_that_say_what_they_expect(name):
    cases = load_families([name])[name].cases()
    assert len(cases) >= 5
    assert all(case.what and case.expected for case in cases)
    assert len({case.what for case in cases}) == len(cases)


def test_families_are_found_by_name_and_unknown_ones_are_refused():
    assert list(load_families(["model", "ar"])) == ["ar", "model"]
    assert list(load_families()) == family_names()
    with pytest.raises(InputError, match="allowed are anisotropic, ar, contact"):
        load_families(["ar", "texture"])


def test_a_report_holds_every_row_and_both_pictures(tmp_path):
    cases = {
        "contact": [contact.cases(stiffnesses=(1e4,), map_points=4)[-1]],
        "model": [Extreme("bad", "good", lambda: CaseResult("worse", held=False))],
    }
    rows = [run_case(name, case) for name, some in cases.items() for case in some]
    page = write_report(tmp_path / "report", findings_of(rows))
    text = page.read_text(encoding="utf-8")
    assert "data:image/png" in text
    assert "worse" in (tmp_path / "report" / "report.md").read_text(encoding="utf-8")
    assert (tmp_path / "report" / "figures" / "contact.png").stat().st_size > 1000
    found = json.loads((tmp_path / "report" / "summary.json").read_text(encoding="utf-8"))
    assert found["held"] is False
    assert found["not_held"] == ["bad"]
    assert "1 did not hold" in overview(rows).caption
    assert list(by_family(rows)) == ["contact", "model"]
    assert family_table(rows[:1]).rows[0][-1] == "yes"
    assert summary(rows[:1])["held"] is True


def test_the_command_prints_families_and_says_by_its_code_whether_all_held(tmp_path, monkeypatch):
    few = model.cases(many=50, queries=10)[:3]
    monkeypatch.setattr(stability, "load_family", lambda _: Family("Few models", lambda: few))
    figures, result = run_json(tmp_path, "stability", "model")
    assert "Few models" in result.output
    assert figures["cases"] == 3
    few.append(Extreme("a broken thing", "holds", lambda: CaseResult("does not", held=False)))
    result = run("stability", "model", "--report", tmp_path / "report")
    assert result.exit_code == 1
    assert "a broken thing" in result.output
    assert (tmp_path / "report" / "report.html").exists()
