"""Propose how a recording is to be imported, from the names of its columns."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.frames import CHANNELS
from mmt.session.importing.checks import ImportReport, unit_by_gravity
from mmt.session.importing.columns import (
    MESSAGE_PARTS,
    STANDARD_NAMES,
    wanted_names,
)
from mmt.session.importing.options import UNITS, ImportOptions
from mmt.session.importing.recording import read_columns

_WORDS: Final = {
    "position": "p|pos|position|tip|tcp|pen|stylus|tool",
    "force": "f|force|forces|load",
    "acceleration": "a|acc|accel|acceleration|accelerometer|imu|vibration",
}
_TIME: Final = re.compile(
    r"^(t|times?|timestamps?|stamps?|clock|secs?|seconds|zeit|temps|tiempo|tempo)$"
)
_TIME_STEPS: Final = (("s", 0.05), ("ms", 50.0), ("us", 50e3), ("ns", 50e6))
"""The steps up to which times are taken to be in a unit: rows come 20 times a second or faster."""


@dataclass(frozen=True)
class Proposal:
    """How a recording may be imported."""

    names: Sequence[str]
    """Every column of the file."""
    options: ImportOptions
    """What the names say of them."""
    lacking: tuple[str, ...]
    """Targets for which no column was found: "time" or channels."""

    def weighed(self, report: ImportReport) -> "Proposal":
        """Return it with the unit of acceleration that a report of it asks about by gravity."""
        means = [each.mean for each in report.channels if each.channel == "acceleration"]
        unit = unit_by_gravity(float(np.linalg.norm(means)))
        if unit is None or "acceleration" in self.options.units:
            return self
        units = {**self.options.units, "acceleration": unit}
        return replace(self, options=replace(self.options, units=units))

    def command(self, path: Path) -> str:
        """Return the command that imports the file by these options."""
        parts = ["mmt", "session", "import", str(path), path.with_suffix(".mcap").name]
        for option, pairs in (("--map", self.options.columns), ("--unit", self.options.units)):
            for name, value in pairs.items():
                parts += [option, f"{name}={value}"]
        return shlex.join(parts)


def propose(path: str | Path) -> Proposal:
    """Look at the columns of a recording and propose what they are.

    Raises
    ------
    InputError
        The file is missing, of another kind or not valid.
    """
    path = Path(path)
    read = read_columns(path, lambda _: False)
    names = read.names
    columns, units = _guess(names)
    if "time" in columns or STANDARD_NAMES["time"] in names:
        units = _with_time_unit(path, ImportOptions(columns, units))
    found = set(columns) | {target for target, name in STANDARD_NAMES.items() if name in names}
    of_messages = bool(columns) and any(text.startswith("/") for text in columns.values())
    has_times = "time" in found or of_messages or bool(read.times)
    lacking = [] if has_times else ["time"]
    lacking += [channel for channel in CHANNELS if not {channel, f"{channel}_x"} & found]
    return Proposal(names, ImportOptions(columns, units), tuple(lacking))


def _guess(names: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the columns by target and the units by quantity that names tell."""
    columns: dict[str, str] = {}
    units: dict[str, str] = {}
    standard = set(STANDARD_NAMES.values())
    for name in names:
        found = None if name in standard else _target(name)
        if found is None or found[0] in columns or STANDARD_NAMES[found[0]] in names:
            continue
        target, quantity, unit = found
        columns[target] = name
        if unit:
            units.setdefault(quantity, unit)
    for channel in CHANNELS:  # a sensor of one or two axes
        axes = {f"{channel}_{axis}" for axis in "xyz"}
        if axes & set(columns):
            columns |= dict.fromkeys(sorted(axes - set(columns)), "0")
    return columns, units


def _target(name: str) -> tuple[str, str, str] | None:
    """Return target, quantity and unit that a name stands for, None for an unknown one."""
    if name.startswith("/"):  # a topic
        last = name.rsplit(".", 1)[-1]
        quantity = next((q for q, parts in MESSAGE_PARTS.items() if last in parts), None)
        return (quantity, quantity, "") if quantity else None
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name.rsplit(".", 1)[-1])
    words = re.findall(r"[a-z]+[0-9]?", spaced.lower())
    if not words:
        return None
    for end in range(len(words), max(0, len(words) - 3), -1):  # the last words may be a unit
        joined, behind = "".join(words[:end]), "".join(words[end:])
        unit = _unit("time", behind)
        if _TIME.match(joined) and unit is not None:
            return "time", "time", unit
        for quantity, pattern in _WORDS.items():
            optional = "?" if quantity == "position" else ""
            unit = _unit(quantity, behind)
            if unit is None:
                continue
            if found := re.fullmatch(rf"(?:{pattern}){optional}([xyz])", joined):
                return f"{quantity}_{found.group(1)}", quantity, unit
            of_a_structure = "." in name
            if (len(joined) > 1 or of_a_structure) and re.fullmatch(pattern, joined):
                return quantity, quantity, unit
    return None


def _unit(quantity: str, word: str) -> str | None:
    """Return the unit that a word in a name stands for, "" for no word, None for another word."""
    if not word:
        return ""
    return next(
        (unit for unit in UNITS[quantity] if re.sub(r"[^a-z0-9]", "", unit.lower()) == word), None
    )


def _with_time_unit(path: Path, options: ImportOptions) -> dict[str, str]:
    """Return the units, with that of time where its steps tell it and its name does not."""
    columns = read_columns(path, wanted_names(options))
    name = options.columns.get("time", STANDARD_NAMES["time"])
    time = columns.values[name]
    if "time" in options.units or name in columns.units or time.ndim != 1 or len(time) < 2:
        return dict(options.units)
    step = (float(time[-1]) - float(time[0])) / (len(time) - 1)
    unit = next((unit for unit, largest in _TIME_STEPS if step <= largest), "s")
    if unit == "s" or not np.isfinite(step):
        return dict(options.units)
    return {**options.units, "time": unit}
