"""Findings of an experiment: plain values for tables, plots, reports and JSON."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal, Self

from mmt.evaluation.reports.document import Block, ReportTable
from mmt.session.data import json_value

Cell = str | float | int | bool | None
"""One value of a record."""

Side = Literal["at least", "at most", "about"]


@dataclass(frozen=True)
class Spread:
    """A median with its lower and upper quartile; all three are equal for an exact figure."""

    median: float
    low: float
    high: float

    @classmethod
    def exact(cls, value: float) -> Self:
        """Return a figure that has no scatter."""
        return cls(value, value, value)

    def times(self, factor: float) -> "Spread":
        """Return the spread times a factor, as for another unit."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True)
class Point:
    """One setting of a method's knob, and its place in a panel."""

    knob: float
    x: Spread
    y: Spread


@dataclass(frozen=True)
class Curve:
    """One method, with its points in the order of the knob.

    ``failures`` says why a setting of the knob has no point.
    """

    method: str
    points: tuple[Point, ...]
    failures: Mapping[str, str] = field(default_factory=dict)

    @property
    def over_knob(self) -> bool:
        """Whether x is the knob itself, and not a time."""
        return all(point.x.median == point.knob for point in self.points)


class Curves:
    """Builder of curves, in the order in which their methods are first named."""

    def __init__(self) -> None:
        self._points: dict[str, list[Point]] = {}
        self._failures: dict[str, dict[str, str]] = {}

    def add(self, method: str, knob: float, x: Spread | float, y: Spread | float) -> None:
        """Add a point to a method's curve; a value that is not finite becomes a failure."""
        first, second = _spread(x), _spread(y)
        if not (math.isfinite(first.median) and math.isfinite(second.median)):
            self.fail(method, knob, "not finite")
            return
        self._points.setdefault(method, []).append(Point(knob, first, second))

    def fail(self, method: str, knob: float, reason: str) -> None:
        """Note why a setting of the knob has no point."""
        self._points.setdefault(method, [])
        self._failures.setdefault(method, {})[f"{knob:g}"] = reason

    def build(self) -> tuple[Curve, ...]:
        """Return the curves."""
        return tuple(
            Curve(method, tuple(points), self._failures.get(method, {}))
            for method, points in self._points.items()
        )


@dataclass(frozen=True)
class Axis:
    """One axis of a panel; the label includes the unit, `short` is for tables."""

    label: str
    short: str
    logarithmic: bool = True


@dataclass(frozen=True)
class Panel:
    """A work-precision plot and table: a curve for each method, along which its knob varies."""

    name: str
    title: str
    knob: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]

    def points(self, method: str) -> tuple[Point, ...]:
        """Return a method's points, empty if it was not measured."""
        return next((curve.points for curve in self.curves if curve.method == method), ())

    def x_ratios(self, slower: str, faster: str) -> dict[float, float]:
        """Return one method's median x over another's, by the knobs that both have."""
        below = {point.knob: point.x.median for point in self.points(faster)}
        return {
            point.knob: point.x.median / below[point.knob]
            for point in self.points(slower)
            if point.knob in below
        }


@dataclass(frozen=True)
class FindingsTable:
    """A table of rows with the same keys."""

    name: str
    title: str
    rows: tuple[Mapping[str, Cell], ...]


@dataclass(frozen=True)
class Target:
    """A measured figure and its target; the figure is None if it could not be measured.

    ``tolerance`` is the distance from the bound that the side ``"about"`` allows; ``reason`` says
    why the target is missed, if it is.
    """

    what: str
    measured: float | None
    side: Side
    bound: float
    tolerance: float = 0.0
    reason: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is met, None if nothing was measured."""
        if self.measured is None:
            return None
        if self.side == "about":
            return abs(self.measured - self.bound) <= self.tolerance
        if self.side == "at least":
            return self.measured >= self.bound
        return self.measured <= self.bound


@dataclass(frozen=True)
class SkippedMethod:
    """A method that was not measured, the reason, and a remedy."""

    name: str
    reason: str
    remedy: str


@dataclass(frozen=True)
class Findings:
    """Everything that one experiment found.

    Attributes
    ----------
    title, about
        Heading, and sentences that say what was measured, how an error is defined, and what it
        is measured against.
    sentences
        Results in words.
    tables
        Results for terminal and report.
    panels, records
        Work-precision plots with their tables, and tables of plain values.
    targets, left_out
        Targets of the figures, and methods that were not measured.
    figures
        Single figures by their names in JSON.
    blocks
        Returns the content of a report in place of `tables`, such as pictures; called only if a
        report is written.
    definitions
        Meaning of the figures, for the report.
    settings
        Further tables after the definitions in a report.
    data
        All results for JSON; None for the content of panels, records, targets and figures.
    failures
        A sentence for each requirement that failed; with any, the exit code of the command is 1.
    name
        Name of the experiment, which the harness fills in.
    """

    title: str
    about: str = ""
    sentences: Sequence[str] = ()
    tables: Sequence[ReportTable] = ()
    panels: tuple[Panel, ...] = ()
    records: tuple[FindingsTable, ...] = ()
    targets: tuple[Target, ...] = ()
    left_out: tuple[SkippedMethod, ...] = ()
    figures: Mapping[str, float | int | None] = field(default_factory=dict)
    blocks: Callable[[], Sequence[Block]] | None = None
    definitions: Mapping[str, str] = field(default_factory=dict)
    settings: Sequence[ReportTable] = ()
    data: Mapping[str, Any] | None = None
    failures: Sequence[str] = ()
    name: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the findings as a dictionary for JSON; numbers that are not finite become None."""
        targets = [{**asdict(target), "met": target.met} for target in self.targets]
        content: dict[str, Any] = {
            "name": self.name,
            "title": self.title,
            "about": self.about,
            "panels": [asdict(panel) for panel in self.panels],
            "records": [asdict(records) for records in self.records],
            "targets": targets,
            "left_out": [asdict(out) for out in self.left_out],
            "figures": dict(self.figures),
        }
        if self.data is not None:
            content = {**self.data, **({"judged": targets} if targets else {})}
        if self.definitions:
            content["definitions"] = self.definitions
        plain: dict[str, Any] = json_value(content)
        return plain


TIME_US: Final = Axis("time (µs)", "µs")
MICROSECONDS: Final = 1e6


def _spread(value: Spread | float) -> Spread:
    return value if isinstance(value, Spread) else Spread.exact(float(value))
