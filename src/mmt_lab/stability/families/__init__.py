"""Families of the cases of ``mmt stability``: a module each, with a `FAMILY`."""

import dataclasses  # `field` is a family
import importlib
import pkgutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from mmt.evaluation.reports.document import Picture

Figures = Mapping[str, Any]
"""The numbers behind an outcome, by name, for programs and plots."""


@dataclass(frozen=True)
class CaseResult:
    """Result of a case: in a few words, whether it held, and the numbers behind it."""

    got: str
    held: bool
    figures: Figures = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class Extreme:
    """A stiff or extreme case: ``what`` is done and what is ``expected``, in a few words."""

    what: str
    expected: str
    run: Callable[[], CaseResult]


@dataclass(frozen=True)
class Family:
    """Cases of one kind, and the pictures that a report draws from the figures of all rows."""

    title: str
    cases: Callable[[], Sequence[Extreme]]
    pictures: Callable[[Sequence[Figures]], Sequence[Picture]] | None = None


@dataclass(frozen=True)
class CaseRow:
    """One row of the table."""

    family: str
    what: str
    expected: str
    got: str
    held: bool
    seconds: float
    figures: Figures


def run_case(family: str, case: Extreme) -> CaseRow:
    """Run one case of a family; a case that raises did not hold."""
    started = time.perf_counter()
    try:
        outcome = case.run()
    except Exception as error:  # noqa: BLE001 - the table shows it
        outcome = CaseResult(f"raised {type(error).__name__}: {error}", held=False)
    return CaseRow(
        family=family,
        what=case.what,
        expected=case.expected,
        got=outcome.got,
        held=bool(outcome.held),
        seconds=time.perf_counter() - started,
        figures=outcome.figures,
    )


def broken(rows: Iterable[CaseRow]) -> list[CaseRow]:
    """Return the rows that did not hold."""
    return [row for row in rows if not row.held]


def family_names() -> list[str]:
    """Return the names of all families, in alphabetical order, without importing them."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


Families = Annotated[
    list[str] | None,
    typer.Argument(metavar="FAMILY", help=f"{', '.join(family_names())}; all if none is named."),
]
"""The families that are named on the command line."""


def load_family(name: str) -> Family:
    """Import a family by its name."""
    found: Family = importlib.import_module(f"{__name__}.{name}").FAMILY
    return found
