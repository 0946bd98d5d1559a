"""``mmt stability``: run families of cases, and say for each whether it held.

A family is a module of `mmt_lab.stability.families` with a `FAMILY`; it is imported when it is
asked for.
"""

import importlib
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table as RichTable

from mmt.cli.common import messages, output, print_error, write_json
from mmt.core.errors import InputError
from mmt.evaluation.document import Block, Heading, Paragraph, Table
from mmt.evaluation.report import environment
from mmt.evaluation.report_files import write_report_files
from mmt_lab.stability import families
from mmt_lab.stability.cases import Family, Row, broken, run_case

COLUMNS: Final = ("case", "expected", "got", "held")
TITLE: Final = "Numerical stability"


def family_names() -> list[str]:
    """Return the names of all families, in alphabetical order, without importing them."""
    return sorted(module.name for module in pkgutil.iter_modules(families.__path__))


def load_families(names: Sequence[str] = ()) -> dict[str, Family]:
    """Return the named families, all of them where none is named, by name in order.

    Raises
    ------
    InputError
        There is no family of such a name.
    """
    every = family_names()
    unknown = [name for name in names if name not in every]
    if unknown:
        raise InputError(f"stability {unknown[0]}: allowed are {', '.join(every)}")
    return {name: _load(name) for name in every if name in names or not names}


def _load(name: str) -> Family:
    found: Family = importlib.import_module(f"{families.__name__}.{name}").FAMILY
    return found


def run_stability(names: list[str], *, json_file: Path | None, report_to: Path | None) -> bool:
    """Run the named families of cases, print and write what came out; say if all held.

    Raises
    ------
    InputError
        There is no family of such a name, or a file cannot be written.
    """
    rows = run_families(load_families(names))
    for family in by_family(rows).values():
        output.print(_terminal_table(family_table(family)))
    write_json(json_file, summary(rows))
    if report_to is not None:
        page = write_stability_report(report_to, rows)
        messages.print(f"report: {page}", highlight=False)
    messages.print(verdict(rows), highlight=False)
    for row in broken(rows):
        print_error(f"{row.family}: {row.what}: expected {row.expected}; got {row.got}")
    return not broken(rows)


def run_families(chosen: dict[str, Family]) -> list[Row]:
    """Run all cases of some families, given by name, beside a progress bar."""
    cases = [(name, case) for name, family in chosen.items() for case in family.cases()]
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    rows: list[Row] = []
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("stability", total=len(cases))
        for name, case in cases:
            progress.update(task, description=f"{name}: {case.what}"[:60])
            rows.append(run_case(name, case))
            progress.advance(task)
    return rows


def by_family(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each family, in the order in which the families ran."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.family, []).append(row)
    return found


def family_table(rows: Sequence[Row]) -> Table:
    """Return the rows of one family as text."""
    cells = [(row.what, row.expected, row.got, "yes" if row.held else "NO") for row in rows]
    return Table(COLUMNS, cells, caption=_load(rows[0].family).title)


def verdict(rows: Sequence[Row]) -> str:
    """Return the sentence that sums a run up."""
    failed, seconds = len(broken(rows)), sum(row.seconds for row in rows)
    held = "all held" if not failed else f"{failed} did not hold"
    return f"{len(rows)} cases, {held} ({seconds:.0f} s)"


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the run for a program."""
    return {
        "held": not broken(rows),
        "cases": len(rows),
        "not_held": [row.what for row in broken(rows)],
        "seconds": round(sum(row.seconds for row in rows), 1),
        "rows": [row.as_dict() for row in rows],
        "environment": environment(),
    }


def write_stability_report(directory: Path, rows: Sequence[Row]) -> Path:
    """Write ``report.md``, ``report.html``, ``summary.json`` and the figures; return the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    blocks: list[Block] = [Heading(TITLE, 1), Paragraph(verdict(rows))]
    for name, found in by_family(rows).items():
        family, table = _load(name), family_table(found)
        blocks.append(Heading(family.title))
        if family.pictures is not None:
            blocks += family.pictures([row.figures for row in found])
        blocks.append(Table(COLUMNS, table.rows))
    blocks += [Heading("Made with"), Table(("part", "version"), list(environment().items()))]
    return write_report_files(directory, TITLE, blocks, "summary.json", summary(rows))


def _terminal_table(content: Table) -> RichTable:
    """Return a family's rows for the terminal; long texts are folded."""
    table = RichTable(title=content.caption, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in content.columns[:-1]:
        table.add_column(name, ratio=1, overflow="fold")
    table.add_column(content.columns[-1], no_wrap=True)
    for row in content.rows:
        table.add_row(*row, style=None if row[-1] == "yes" else "red")
    return table
