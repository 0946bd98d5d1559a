"""What an experiment has found: plain values for tables, plots, reports and JSON."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal, Self

import numpy as np

from mmt.evaluation.document import Block, ReportTable

Cell = str | float | int | bool | None
"""One value of a record."""

Side = Literal["at least", "at most", "about"]


@dataclass(frozen=True)
class Spread:
    """A median with its lower and upper quartile; all three are one where it is exact."""

    median: float
    low: float
    high: float

    @classmethod
    def exact(cls, value: float) -> Self:
        """Return a figure that has no scatter."""
        return cls(value, value, value)

    def times(self, factor: float) -> "Spread":
        """Return the same in another unit."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)

    @property
    def relative(self) -> float:
        """Half the distance of the quartiles over the median; 0 where that is 0."""
        return 0.5 * (self.high - self.low) / self.median if self.median else 0.0


@dataclass(frozen=True)
class Point:
    """One setting of a method's knob, and where it stands in a panel."""

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
        """Whether the knob itself stands along x, and not a time."""
        return all(point.x.median == point.knob for point in self.points)


class Curves:
    """Curves in the making, in the order in which their methods are first named."""

    def __init__(self) -> None:
        self._points: dict[str, list[Point]] = {}
        self._failures: dict[str, dict[str, str]] = {}

    def add(self, method: str, knob: float, x: Spread | float, y: Spread | float) -> None:
        """Put a point on a method's curve; what is not finite becomes a failure."""
        first, second = _spread(x), _spread(y)
        if not (math.isfinite(first.median) and math.isfinite(second.median)):
            self.fail(method, knob, "not finite")
            return
        self._points.setdefault(method, []).append(Point(knob, first, second))

    def fail(self, method: str, knob: float, reason: str) -> None:
        """Say why a setting of the knob has no point."""
        self._points.setdefault(method, [])
        self._failures.setdefault(method, {})[f"{knob:g}"] = reason

    def done(self) -> tuple[Curve, ...]:
        """Return the curves."""
        return tuple(
            Curve(method, tuple(points), self._failures.get(method, {}))
            for method, points in self._points.items()
        )


@dataclass(frozen=True)
class Axis:
    """What stands along one side of a panel; the label carries the unit, `short` is for tables."""

    label: str
    short: str
    logarithmic: bool = True


@dataclass(frozen=True)
class Panel:
    """A work-precision plot and table: every method a curve, its knob along it."""

    name: str
    title: str
    knob: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]

    def points(self, method: str) -> tuple[Point, ...]:
        """Return a method's points, none where it was not measured."""
        return next((curve.points for curve in self.curves if curve.method == method), ())

    def x_ratios(self, slower: str, faster: str) -> dict[float, float]:
        """Return, by the knob, one method's median x over another's, where both have one."""
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
    """A figure of this run and what it is to be; None if it could not be measured.

    ``tolerance`` is how far it may be from the bound that it is to be about; ``reason`` says why
    it is missed, if it is.
    """

    what: str
    measured: float | None
    side: Side
    bound: float
    tolerance: float = 0.0
    reason: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it holds, None where nothing was measured."""
        if self.measured is None:
            return None
        if self.side == "about":
            return abs(self.measured - self.bound) <= self.tolerance
        if self.side == "at least":
            return self.measured >= self.bound
        return self.measured <= self.bound


@dataclass(frozen=True)
class SkippedMethod:
    """A method that was not measured, why, and what would change that."""

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
        What came out, in words.
    tables
        What came out, for terminal and report.
    panels, records
        Work-precision plots with their tables, and tables of plain values.
    targets, left_out
        What the figures are to be, and what was not measured.
    figures
        Single figures, by a name for programs.
    blocks
        Returns what a report says in place of `tables`, such as pictures; called only where a
        report is written.
    definitions
        What the figures mean, for the report.
    settings
        Further tables that stand behind the definitions in a report.
    data
        Everything for a program; None for what panels, records, targets and figures hold.
    failures
        What was not as it must be, a sentence each; with any, the command ends with exit code 1.
    name
        The experiment, which the harness fills in.
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
        """Return the findings for a program; a number that is not finite becomes None."""
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
        return {key: _plain(value) for key, value in content.items()}


TIME_US: Final = Axis("time (µs)", "µs")
MICROSECONDS: Final = 1e6


def _spread(value: Spread | float) -> Spread:
    return value if isinstance(value, Spread) else Spread.exact(float(value))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
