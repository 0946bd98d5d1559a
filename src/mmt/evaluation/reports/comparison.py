"""Two reports side by side: which figures and settings differ, and by how much."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import InputError, naming
from mmt.core.files.untrusted import json_object
from mmt.core.output.tables import label
from mmt.evaluation.reports.document import ReportTable
from mmt.evaluation.reports.headlines import Headline, headline_table, headlines
from mmt.evaluation.reports.report_files import FIGURES

COLUMNS: Final = ("figure", "A", "B", "B - A", "B / A")
DATA_NAMES: Final = ("summary.json", "bench.json")
"""Data files of reports: of a run, evaluation or stability measurement, and of a bench."""

_NAMES: Final = ("session", "surface", "name", "method", "case", "title", "part", "knob", "time_s")
"""Keys that may tell the items of a list apart; the first that does is used."""
_WITHIN: Final = " / "
_SETTINGS: Final = ("scene", "settings", "environment", "machine")
"""Tables of settings and environments, not of results."""
_LARGEST: Final = 10
"""Largest number of figures that are listed if there are no headlines."""
_LARGEST_BYTES: Final = 1 << 28


@dataclass(frozen=True)
class Difference:
    """One figure or setting.

    ``section`` and ``name`` say which it is; ``left`` and ``right`` are None if a report does
    not have it. ``part`` is the outermost table around it that only one report has, empty if
    both have all.
    """

    section: str
    name: str
    left: object
    right: object
    part: str = ""

    @property
    def is_setting(self) -> bool:
        """Whether this is a setting, not a result."""
        return any(name in _SETTINGS for name in self.section.split(_WITHIN))

    @property
    def size(self) -> float:
        """Logarithm of the factor by which they differ; infinite if these are no numbers."""
        if not (_is_number(self.left) and _is_number(self.right)):
            return math.inf
        left, right = float(self.left), float(self.right)  # type: ignore[arg-type]
        if left * right <= 0.0 or not math.isfinite(left * right):
            return math.inf if left != right else 0.0
        return abs(math.log(right / left))

    @property
    def row(self) -> tuple[str, ...]:
        """Return `COLUMNS`."""
        texts = label(self.name), _text(self.left), _text(self.right)
        if not (_is_number(self.left) and _is_number(self.right)):
            return (*texts, "", "")
        left, right = float(self.left), float(self.right)  # type: ignore[arg-type]
        ratio = f"{right / left:.4g}" if left != 0.0 and math.isfinite(right / left) else ""
        return (*texts, f"{right - left:+.4g}", ratio)


@dataclass(frozen=True)
class Comparison:
    """Figures of two reports side by side.

    ``differences`` in the order of the first report, ``equal`` how many figures are the same,
    ``pictures`` the names of the PNG files that one or both have. ``headlines`` are those of runs
    and evaluations, ``steps`` the scores of each report if both are of one session.
    """

    left: Path
    right: Path
    differences: tuple[Difference, ...]
    equal: int
    pictures: tuple[str, ...]
    headlines: tuple[Headline, ...] = ()
    steps: tuple[Sequence[Mapping[str, Any]], ...] = ()

    @property
    def sections(self) -> dict[str, list[Difference]]:
        """Return the differences of results that both have, by section."""
        sections: dict[str, list[Difference]] = {}
        for difference in self.differences:
            if not difference.part and not difference.is_setting:
                sections.setdefault(difference.section, []).append(difference)
        return sections

    @property
    def answers(self) -> list[ReportTable]:
        """Return the tables to read first: headlines, or largest differences, and settings."""
        found = [d for each in self.sections.values() for d in each]
        found.sort(key=lambda difference: difference.size, reverse=True)
        largest = [(d.section, *d.row) for d in found[:_LARGEST]]
        tables = [headline_table(self.headlines)] if self.headlines else []
        if largest and not tables:
            tables.append(ReportTable(("in", *COLUMNS), largest, "What differs most"))
        settings = [
            (d.section, *d.row[:3]) for d in self.differences if d.is_setting and not d.part
        ]
        if settings:
            tables.append(ReportTable(("in", "setting", "A", "B"), settings, "Settings"))
        return tables

    @property
    def missing_parts(self) -> list[str]:
        """Return a sentence for each report that has parts which the other lacks."""
        parts: dict[str, list[str]] = {"A": [], "B": []}
        for each in self.differences:
            if each.part:
                parts["A" if each.right is None else "B"].append(each.part)
        return [
            f"Only {letter} has {', '.join(dict.fromkeys(lone))}: {len(lone)} figures and settings."
            for letter, lone in parts.items()
            if lone
        ]

    @property
    def verdict(self) -> str:
        """Return how much is equal, as a sentence."""
        return f"{len(self.differences)} figures and settings differ, {self.equal} are equal."

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        first = [
            {"figure": h.title, "a": h.left, "b": h.right, "b_is": h.verdict}
            for h in self.headlines
        ]
        differences = [
            {"section": d.section, "name": d.name, "a": d.left, "b": d.right}
            for d in self.differences
        ]
        return {
            "a": str(self.left),
            "b": str(self.right),
            "headlines": first,
            "equal": self.equal,
            "differences": differences,
        }


def compare_reports(left: Path, right: Path) -> Comparison:
    """Compare the reports in two folders.

    Parameters
    ----------
    left, right
        Folders that `write_report_files` has filled, of the same kind.

    Raises
    ------
    InputError
        A folder holds no report of mmt, or they are of different kinds.
    """
    one, other = _load(left), _load(right)
    if one[0] != other[0]:
        raise InputError(
            f"{left} holds {one[0]}, {right} holds {other[0]}: reports of one kind can be compared"
        )
    first, second = dict(figures(one[1])), dict(figures(other[1]))
    both = [*first, *(key for key in second if key not in first)]
    tables = [
        {table for section, _ in each for table in _enclosing_tables(section)}
        for each in (first, second)
    ]
    common = set.intersection(*tables)

    def lone(section: str) -> str:
        return next((table for table in _enclosing_tables(section) if table not in common), "")

    differences = tuple(
        Difference(*key, first.get(key), second.get(key), lone(key[0]))
        for key in both
        if not _same(first.get(key), second.get(key))
    )
    names = tuple(sorted(_figure_names(left) | _figure_names(right)))
    try:
        first_lines = tuple(headlines(one[1], other[1]))
        steps = tuple(_steps_of_single_session(data) for _, data in (one, other))
    except (AttributeError, TypeError, ValueError) as error:  # the file is another program's
        both_files = f"{left / one[0]} or {right / one[0]}"
        raise InputError(f"report {both_files}: it is none of mmt's: {error}") from error
    equal = len(both) - len(differences)
    steps = steps if all(steps) else ()
    return Comparison(left, right, differences, equal, names, first_lines, steps)


def figures(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str], object]]:
    """Yield ((section, name), value) of every single value, in order.

    The section is the path to the innermost table that holds the value. A single session of an
    evaluation is listed once, not at the top level as well, and without its name: two sessions are
    compared whatever their files are called.
    """
    sessions = data.get("sessions")
    if isinstance(sessions, list) and len(sessions) == 1 and isinstance(sessions[0], Mapping):
        others = {k: v for k, v in data.items() if k not in sessions[0] or k in ("scene", "run")}
        del others["sessions"]
        data = {"session": sessions[0], **others}
    yield from _walk(data, ())


def _steps_of_single_session(data: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the scores over time of a single session, none if there are several."""
    sessions = data.get("sessions") or []
    steps = sessions[0].get("steps") or [] if len(sessions) == 1 else []
    return [{**step} for step in steps]


def _figure_names(folder: Path) -> set[str]:
    """Return the figures that a report shows; its folder may have those of an earlier one."""
    names = {path.name for path in (folder / FIGURES).glob("*.png")}
    try:
        text = (folder / "report.md").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return names
    return {name for name in names if f"({FIGURES}/{name})" in text}


def _load(folder: Path) -> tuple[str, Mapping[str, Any]]:
    """Return the name of a report's data file, and the data."""
    for name in DATA_NAMES:
        path = folder / name
        if not path.exists():
            continue
        with naming(f"report {path}"):
            if path.stat().st_size > _LARGEST_BYTES:
                raise InputError("over 256 MiB, which no report is")
            return name, json_object(path.read_bytes(), "it")
    raise InputError(
        f"report {folder}: it holds none of {', '.join(DATA_NAMES)}; give the folder that "
        "--report or a demo's --output has filled"
    )


def _walk(
    content: Mapping[str, Any], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, str], object]]:
    section = _WITHIN.join(path)
    for key, value in content.items():
        name = str(key).replace("_", " ")
        if isinstance(value, Mapping):
            yield from _walk(value, (*path, name))
        elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            for which, item in zip(_labels(value), value, strict=True):
                yield from _walk(item, (*path, f"{name} {which}"))
        elif value != []:  # an empty list of tables has no figures
            yield (section, name), value


def _enclosing_tables(section: str) -> list[str]:
    """Return the tables that a section is in, from the outermost to itself; none of the whole."""
    names = section.split(_WITHIN) if section else []
    return [_WITHIN.join(names[: number + 1]) for number in range(len(names))]


def _labels(items: list[Mapping[str, Any]]) -> list[str]:
    for key in _NAMES:
        labels = [
            _text(item[key]) for item in items if isinstance(item.get(key), str | int | float)
        ]
        if len(set(labels)) == len(items):
            return labels
    return [str(number) for number in range(1, len(items) + 1)]


def _same(left: object, right: object) -> bool:
    if isinstance(left, float) and isinstance(right, float):
        return left == right or (math.isnan(left) and math.isnan(right))
    return left == right


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _text(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return str(value)
