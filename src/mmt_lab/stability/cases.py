"""Cases of the stability table: what is done, what is expected, and what came out."""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mmt.evaluation.document import Picture

Figures = Mapping[str, Any]
"""The numbers behind an outcome, by name, for programs and plots."""


@dataclass(frozen=True)
class Outcome:
    """What a case gave.

    Attributes
    ----------
    got
        What came out, in a few words.
    held
        Whether that is what was expected.
    figures
        The numbers behind it.
    """

    got: str
    held: bool
    figures: Figures = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A case to run: ``what`` is done and what is ``expected``, each in a few words."""

    what: str
    expected: str
    run: Callable[[], Outcome]


@dataclass(frozen=True)
class Family:
    """Cases of one kind.

    Attributes
    ----------
    title
        Heading of their table.
    cases
        Returns all cases.
    pictures
        Draws what a report shows above the table, from the figures of all rows; None for nothing.
    """

    title: str
    cases: Callable[[], Sequence[Case]]
    pictures: Callable[[Sequence[Figures]], Sequence[Picture]] | None = None


@dataclass(frozen=True)
class Row:
    """One row of the table."""

    family: str
    what: str
    expected: str
    got: str
    held: bool
    seconds: float
    figures: Figures

    def as_dict(self) -> dict[str, Any]:
        """Return the row for a program."""
        return {
            "family": self.family,
            "what": self.what,
            "expected": self.expected,
            "got": self.got,
            "held": self.held,
            "seconds": round(self.seconds, 3),
            "figures": _for_json(self.figures),
        }


def _for_json(value: Any) -> Any:
    """Return a figure with None for what is not finite, which JSON cannot write."""
    if isinstance(value, Mapping):
        return {name: _for_json(item) for name, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_for_json(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def run_case(family: str, case: Case) -> Row:
    """Run one case of a family; a case that raises did not hold."""
    started = time.perf_counter()
    try:
        outcome = case.run()
    except Exception as error:  # noqa: BLE001 - the table says so
        outcome = Outcome(f"raised {type(error).__name__}: {error}", held=False)
    return Row(
        family=family,
        what=case.what,
        expected=case.expected,
        got=outcome.got,
        held=bool(outcome.held),
        seconds=time.perf_counter() - started,
        figures=outcome.figures,
    )


def broken(rows: Iterable[Row]) -> list[Row]:
    """Return the rows that did not hold."""
    return [row for row in rows if not row.held]
