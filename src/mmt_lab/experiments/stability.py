"""Stiff and extreme cases of the numerics and of the services' parts: whether each held.

The terminal shows a line for each family and the cases that did not hold; the report shows all
cases. A family of cases is a module of `mmt_lab.stability.families` with a `FAMILY`; the module is
imported when the family runs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from operator import attrgetter
from typing import Any, Final

from mmt.core.errors import InputError
from mmt.evaluation.reports.document import Block, Heading, ReportTable
from mmt.evaluation.reports.report import environment
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import counting
from mmt_lab.stability.families import (
    CaseRow,
    Families,
    Family,
    broken,
    family_names,
    load_family,
    run_case,
)

SHOWS: Final = "whether the numerics hold where they are stiff and extreme"
TAKES: Final = "3 min"


def run(families: Families = None) -> Findings:
    """Run the stiff and extreme cases, a row each, and say whether each held."""
    return findings_of(run_families(load_families(families or [])))


def findings_of(rows: Sequence[CaseRow]) -> Findings:
    """Return the rows of a run as findings."""
    return Findings(
        "Numerical stability",
        tables=[overview(rows)],
        blocks=lambda: report_blocks(rows),
        data=summary(rows),
        failures=[
            f"{row.family}: {row.what}: expected {row.expected}; got {row.got}"
            for row in broken(rows)
        ],
    )


def load_families(names: Sequence[str] = ()) -> dict[str, Family]:
    """Return the named families, or all if none is named, in alphabetical order."""
    every = family_names()
    unknown = [name for name in names if name not in every]
    if unknown:
        raise InputError(f"stability {unknown[0]}: allowed are {', '.join(every)}")
    return {name: load_family(name) for name in every if name in names or not names}


def run_families(chosen: Mapping[str, Family]) -> list[CaseRow]:
    """Run all cases of some families, given by name, beside a progress bar."""
    cases = [(name, case) for name, family in chosen.items() for case in family.cases()]
    rows: list[CaseRow] = []
    with counting("cases", len(cases)) as show:
        for name, case in cases:
            rows.append(run_case(name, case))
            show(len(rows))
    return rows


def by_family(rows: Iterable[CaseRow]) -> dict[str, list[CaseRow]]:
    """Return the rows of each family, in the order in which the families ran."""
    return {name: list(found) for name, found in groupby(rows, key=attrgetter("family"))}


def overview(rows: Sequence[CaseRow]) -> ReportTable:
    """Return a line for each family, and the sentence that sums a run up."""
    cells = []
    for name, found in by_family(rows).items():
        failed, seconds = len(broken(found)), sum(row.seconds for row in found)
        held = str(len(found) - failed) if failed else "all"
        cells.append((load_family(name).title, str(len(found)), held, f"{seconds:.1f}"))
    failed, seconds = len(broken(rows)), sum(row.seconds for row in rows)
    held = f"{failed} did not hold" if failed else "all held"
    verdict = f"{len(rows)} cases, {held} ({seconds:.0f} s)"
    return ReportTable(("family", "cases", "held", "seconds"), cells, caption=verdict)


def summary(rows: Sequence[CaseRow]) -> dict[str, Any]:
    """Return the run as a dictionary for JSON."""
    return {
        "held": not broken(rows),
        "cases": len(rows),
        "not_held": [row.what for row in broken(rows)],
        "seconds": round(sum(row.seconds for row in rows), 1),
        "rows": [asdict(row) | {"seconds": round(row.seconds, 3)} for row in rows],
        "environment": environment(),
    }


def report_blocks(rows: Sequence[CaseRow]) -> list[Block]:
    """Return a line for each family, then the pictures and the table of each."""
    blocks: list[Block] = [overview(rows)]
    for name, found in by_family(rows).items():
        family = load_family(name)
        blocks.append(Heading(family.title))
        if family.pictures is not None:
            blocks += family.pictures([row.figures for row in found])
        cells = [(row.what, row.expected, row.got, "yes" if row.held else "NO") for row in found]
        blocks.append(ReportTable(("case", "expected", "got", "held"), cells))
    return blocks
