"""A stability run as tables, JSON and a report in one folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from mmt.evaluation.document import Block, Heading, Paragraph, Picture, Table
from mmt.evaluation.report import environment
from mmt.evaluation.report_files import picture, write_report_files
from mmt_lab.harness.cases import Row, broken
from mmt_lab.stability.families import FAMILIES

COLUMNS: Final = ("case", "expected", "got", "held")
TITLE: Final = "Numerical stability"


def family_table(rows: Sequence[Row]) -> Table:
    """Return the rows of one family as text."""
    cells = [(row.what, row.expected, row.got, "yes" if row.held else "NO") for row in rows]
    return Table(COLUMNS, cells, caption=FAMILIES[rows[0].family].title)


def by_family(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each family that ran, in the order of the families."""
    return {
        name: [row for row in rows if row.family == name]
        for name in FAMILIES
        if any(row.family == name for row in rows)
    }


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
    """Write ``report.md``, ``report.html``, ``summary.json`` and the figures.

    Returns
    -------
    Path
        Of ``report.html``.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    blocks: list[Block] = [Heading(TITLE, 1), Paragraph(verdict(rows))]
    for name, family in by_family(rows).items():
        blocks.append(Heading(FAMILIES[name].title))
        blocks += _pictures(name, family)
        blocks.append(Table(COLUMNS, family_table(family).rows))
    blocks += [Heading("Made with"), Table(("part", "version"), list(environment().items()))]
    return write_report_files(directory, TITLE, blocks, "summary.json", summary(rows))


def _pictures(name: str, rows: Sequence[Row]) -> list[Picture]:
    if name == "contact":
        return [_contact(found) for found in _with(rows, "growth", "limit_s")]
    if name == "loop":
        return [_loop(found, rows) for found in _with(rows, "grows")]
    return []


def _with(rows: Sequence[Row], *names: str) -> list[Mapping[str, Any]]:
    return [row.figures for row in rows if all(name in row.figures for name in names)]


def _contact(figures: Mapping[str, Any]) -> Picture:
    from mmt_lab.stability.families.contact import MAP_MASS_KG, MAP_RATIO
    from mmt_lab.stability.maps import contact_map

    return picture(
        "contact",
        f"Impacts of {1e3 * MAP_MASS_KG:g} g at 0.5 m/s on walls with {MAP_RATIO:g} of critical "
        "damping: by how much the energy grows above what was there before. Dashed: where "
        "sustained contact becomes unstable.",
        contact_map(figures),
    )


def _loop(figures: Mapping[str, Any], rows: Sequence[Row]) -> Picture:
    from mmt_lab.stability.maps import loop_map

    return picture(
        "loop",
        "Force feedback over a delay, a light grip on the handle: where a small disturbance of "
        "steady contact dies out and where it grows, beside linear theory (shaded).",
        loop_map(figures, _with(rows, "wall_n_mm", "measured_ms")),
    )
