"""Propose options for importing a recording, from the names of its columns."""

import re
import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.core.units import DATE, unit_factor, unit_in_name
from mmt.session.importing.checks import ImportReport, unit_by_gravity, unit_by_speed
from mmt.session.importing.column_names import (
    NUMBER,
    VALUES,
    axis_of,
    is_commanded,
    last_part,
    of_file,
    of_one_trial,
    target_of,
    target_of_column,
)
from mmt.session.importing.columns import SourceColumns, Wanted, wanted_names
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions, quantity_of
from mmt.session.importing.reading_child import read_limited
from mmt.session.importing.recording import (
    check_kinds,
    import_columns,
    is_timed,
    read_columns,
)

_LAST: Final = ("date", "duration")
"""Names that are those of the time only if no other is."""
_SECONDS: Final = re.compile(r"(^|[._\s])s(ecs?|econds)?$")
_RATE: Final = re.compile(
    r"(^|[._])(fs|f_?s(amp(le|ling)?)?|(samp(le|ling)_?)?(rate|freq(uency)?))(_?hz)?$"
)
"""Matches the name of the rows a second."""
_OF_ROS: Final = re.compile(r"(pose[./]position|translation)[./][xyz]$")
_OF_ROBOTS: Final = (
    ("position", "actual_TCP_pose", 0, "m"),  # RTDE of Universal Robots
    ("force", "actual_TCP_force", 0, "N"),
    ("acceleration", "actual_tool_accelerometer", 0, "m/s2"),
    ("position", "O_T_EE", 12, "m"),  # libfranka: a matrix, column by column
    ("force", "O_F_ext_hat_K", 0, "N"),
    *(("force", name, 0, "N") for name in ("wrench", "ft", "force_torque")),
)
"""Channel, name, first element and unit of what robots and their sensors call by one name."""
_PARTS: Final = (6, 7)
"""Columns of an array in which a vector comes first."""
_MOSTLY: Final = 0.5
_TIME_UNITS: Final = (
    ("d", 6e-7, 2e4, np.inf),  # since 1900 (Excel), the year 0 (MATLAB) or 4713 BC
    ("s", 0.05, -np.inf, 7e10),
    ("ms", 50.0, -np.inf, 7e13),
    ("us", 50e3, -np.inf, 7e16),
    ("100ns", 500e3, 1e17, 1e18),  # since the year 1 (.NET) or 1601 (Windows)
    ("ns", 50e6, -np.inf, np.inf),
)
"""Units of times: the largest step if rows come at 20 Hz or faster, and bounds of the first time.

No time is 7e10 s, 2200 years, after its epoch; that of dates in days is after 1954 in Excel."""


@dataclass(frozen=True)
class Proposal:
    """Proposed options for importing a recording."""

    names: Sequence[str]
    """Names of all columns of the file."""
    options: ImportOptions
    """The given options, completed from the names."""
    lacking: tuple[str, ...]
    """Targets for which no column was found: "time" or channels."""
    columns: SourceColumns
    """The columns that the options use."""

    def weighed(self, report: ImportReport) -> "Proposal":
        """Return the proposal with units that the report suggests, if nothing else tells them.

        Acceleration gets the one in which its mean is gravity. Positions named as in ROS, which
        uses m by its REP 103, get m if the speed is then that of a hand.
        """
        means = [each.mean for each in report.channels if each.channel == "acceleration"]
        found = {"acceleration": unit_by_gravity(float(np.linalg.norm(means)))}
        if any(_OF_ROS.search(self.options.columns.get(f"position_{axis}", "")) for axis in "xyz"):
            found["position"] = unit_by_speed(report.speed_mm_s or 0.0)
        units = {name: unit for name, unit in found.items() if unit and name not in report.told}
        return replace(self, options=replace(self.options, units={**units, **self.options.units}))

    def command(self, path: Path) -> str:
        """Return the command that imports the file with these options."""
        target = path.with_suffix(".mcap").name
        if path.suffix.lower() == ".mcap":
            target = f"{path.stem}-imported.mcap"
        parts = ["mmt", "session", "import", str(path), target]
        return shlex.join([*parts, *self.options.arguments()])


def propose(path: str | Path, options: ImportOptions | None = None) -> Proposal:
    """Propose options for importing a recording; given options take precedence.

    Raises
    ------
    InputError
        The file is missing, of an unknown kind or not valid.
    """
    path, options = Path(path), options or ImportOptions()
    check_kinds([path], options)
    read, options, columns = read_limited(path, options, _read, path, options)
    names, mapped = read.names, options.columns
    units = {**_robots_units(columns, options), **_time_unit(columns, options)}
    options = replace(options, units={**options.units, **units})
    standard = {*names, *_with_vectors(names)}
    found = set(mapped) | {target for target, name in STANDARD_NAMES.items() if name in standard}
    lacking = [] if is_timed(read, options) else ["time"]
    if "speed" in found:
        found.add("position")
    lacking += [channel for channel in CHANNELS if not {channel, f"{channel}_x"} & found]
    return Proposal(names, options, tuple(lacking), columns)


def try_proposal(
    path: Path, proposal: Proposal
) -> tuple[Proposal, ImportReport | None, InputError | None]:
    """Try to import a file as proposed; return the proposal, and a report or the error.

    If only blanks prevent the import, the returned proposal leaves out their rows.
    """
    options = proposal.options
    refused = None
    for blanks in dict.fromkeys((options.blanks_as_gaps, True)):
        tried = replace(proposal, options=replace(options, blanks_as_gaps=blanks))
        try:
            report = import_columns([proposal.columns], [path], tried.options)[1]
        except InputError as error:
            refused = refused or error
            continue
        return tried.weighed(report), report, None
    return proposal, None, refused


def _read(
    path: Path, options: ImportOptions, flat: Collection[str] = ()
) -> tuple[SourceColumns, ImportOptions, SourceColumns]:
    """Return the columns without values, the completed options, and the columns they use.

    Columns that are known to be `flat` are no vectors, whatever their names.
    """
    asked, read = options, read_columns(path, Wanted(), options)
    names, trials = of_one_trial(read.names)
    suggested = _suggested(names, read.units, path.stem, flat)
    guessed = _guess(names, suggested)
    guessed |= {} if "time_fraction" in guessed else _finer_time(path, suggested, options)
    times = _own_times(read, guessed) or _times_beside(names, guessed)
    given, columns = options.columns, {**guessed, **times, **options.columns}
    options = replace(options, columns=columns)
    if not is_timed(read, options) and (dates := _dated(path, read.names, options)):
        columns["time"] = dates
        options = replace(options, columns=columns)
    if not is_timed(read, options):
        options = replace(options, rate_hz=_told_rate_hz(path, read.names, options))
    found = read_columns(path, wanted_names(options), options)
    vectors = {name.removesuffix("[0]") for name in guessed.values()} - {*guessed.values()}
    if not flat and (
        flat := [name for name in vectors if np.ndim(found.values.get(name, [[]])) < 2]
    ):
        return _read(path, asked, flat)
    position = guessed.get("position", "")
    if position in found.values and found.values[position].ndim == 1 and "position" not in given:
        straight = {"position_x": position, "position_y": "0", "position_z": "0"}
        others = {target: name for target, name in columns.items() if target != "position"}
        options = replace(options, columns=others | straight)
    options, parts = _in_parts(found, options, given)
    numbered = _numbered_axes([name for name in read.names if name in columns.values()])
    axes = [f"{name} is proposed as {target}" for target, name in numbered.items()]
    x = guessed.get("position_x", "")
    if x.lower() == "x" and x not in read.units and "position_x" not in given:
        axes.append(f"{x}, ... is proposed as position, though nothing says that it is one")
    notes = (
        *trials,
        *axes,
        *parts,
        *found.notes,
        *_of_several(suggested, {**guessed, **dict.fromkeys(given, "")}),
    )
    return read, options, replace(found, notes=notes)


def _in_parts(
    found: SourceColumns, options: ImportOptions, given: Mapping[str, str]
) -> tuple[ImportOptions, list[str]]:
    """Map the first three columns of arrays with more, as of poses or wrenches; also return notes.

    Poses go on with a rotation, wrenches with the torque, and most records of IMUs with rates. All
    may begin with the time, as Simulink and QUARC write them.
    """
    columns, notes = dict(options.columns), []
    for channel in CHANNELS:
        name = columns.get(channel) or columns.get(f"{channel}_x", "").removesuffix("[0]")
        values = found.values.get(name, np.zeros(0))
        timed = values.ndim == 2 and len(values) > 1 and bool(np.all(np.diff(values[:, 0]) > 0))
        timed = timed and "time" not in columns
        width = values.shape[1] - timed if values.ndim == 2 else 0
        if {channel, f"{channel}_x"} & given.keys():
            continue
        if width == 3 and not timed and columns.get(f"{channel}_x") == name:  # x, a vector
            columns = {target: c for target, c in columns.items() if target[:-2] != channel}
            columns[channel] = name
        if not (width in _PARTS or (timed and width == 3)):
            continue
        columns.pop(channel, None)
        columns |= {f"{channel}_{a}": f"{name}[{n}]" for n, a in enumerate("xyz", int(timed))}
        columns |= {f"{channel}_time": f"{name}[0]"} if timed else {}
        first = "the time and the next" if timed else "the first"
        notes.append(f"{channel}: {first} three of the {values.shape[1]} columns of {name}")
    return replace(options, columns=columns), notes


def _suggested(
    names: Sequence[str], units: Mapping[str, str], stem: str, flat: Collection[str]
) -> dict[str, list[str]]:
    """Return the columns that names and units suggest for each target, the likeliest first."""
    vectors = [name for name in names if name not in flat]
    suggested = {target: [name] for target, name in _of_robots(vectors).items()}
    suggested |= {target: [name] for target, name in _numbered_axes(names).items()}
    found = list(filter(None, map(axis_of, names)))
    owners = {match[0 if match[2] in "wW" else 1] for match in found}  # a quaternion is no position
    owners = {owner for owner in owners if not is_commanded(owner)} or owners
    last = sorted(
        _with_vectors(names), key=lambda name: name.lower() in _LAST or is_commanded(name)
    )
    for name in last:
        unit = units.get(name, "")
        target = target_of_column(name if unit else of_file(name, stem), unit, owners)
        if target and STANDARD_NAMES.get(target) not in names:
            suggested.setdefault(target, []).append(name)
    return suggested


def _numbered_axes(names: Sequence[str]) -> dict[str, str]:
    """Return the axes of channels whose columns are told apart by three numbers, as ``acc 0``."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"[ _]?\d$", "", name), []).append(name)
    return {
        f"{channel}_{axis}": name
        for base, group in groups.items()
        if (channel := target_of(base)) in CHANNELS and len(group) == 3 and base not in group
        for axis, name in zip("xyz", sorted(group), strict=True)
    }


def _of_several(
    suggested: Mapping[str, Sequence[str]], columns: Mapping[str, str]
) -> Iterator[str]:
    """Yield a note for each channel whose column is one of several that would do."""
    for channel in CHANNELS:
        for target in (channel, *(f"{channel}_{axis}" for axis in "xyz")):
            taken, names = columns.get(target, ""), suggested.get(target, [])
            alike = [name for name in names if NUMBER.sub("", name) != NUMBER.sub("", taken)]
            if taken in names and alike:
                others = alike[0] + (f" or {len(alike) - 1} more" if len(alike) > 1 else "")
                yield f"{target} is proposed as {taken}; by the name it may also be {others}"
                break


def _guess(names: Sequence[str], suggested: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Guess the columns by target; the first of several is taken."""
    columns = {target: several[0] for target, several in suggested.items()}
    if "time_fraction" in columns and not _SECONDS.search(columns.get("time", "").lower()):
        fraction = columns.pop("time_fraction")
        columns.setdefault("time", fraction)
    for channel in CHANNELS:  # a sensor of one or two axes
        axes = {f"{channel}_{axis}" for axis in "xyz"}
        if STANDARD_NAMES[channel] in names:
            columns = {target: name for target, name in columns.items() if target not in axes}
        if axes & set(columns):
            columns.pop(channel, None)
            constant = "0.0" if "0" in names else "0"
            standard = {axis for axis in axes if STANDARD_NAMES[axis] in names}
            columns |= dict.fromkeys(sorted(axes - standard - set(columns)), constant)
    quaternion = {f"orientation_{axis}" for axis in "wxyz"}
    if not quaternion <= set(columns):
        columns = {target: name for target, name in columns.items() if target not in quaternion}
    if any(name.startswith("position") for name in (*columns, *names)):
        columns.pop("speed", None)
    return columns


def _of_robots(names: Sequence[str]) -> dict[str, str]:
    """Return the columns by target of names in `_OF_ROBOTS`, which may be part of something."""
    columns: dict[str, str] = {}
    whole = {last_part(base).lower(): base for base in map(_array_of, names)}
    for channel, called, first, _ in _OF_ROBOTS:
        base = whole.get(called.lower(), called)
        found: dict[str, str] = {}
        for number, axis in enumerate("xyz", first):
            element = f"{base}[{number}]"
            forms = [element, f"{base}_{number}", f"{base}({number})", f"{base}.{number}"]
            name = next((form for form in forms if form in names), element)
            if name in names or base in names:
                found[f"{channel}_{axis}"] = name
        columns |= found if len(found) == 3 else {}
    return columns


def _array_of(name: str) -> str:
    """Return the name of an element's array, or the name itself if it is none of an element."""
    return re.sub(r"[\[(]\d+[\])]$|[_.]\d+$", "", name)


def _robots_units(columns: SourceColumns, options: ImportOptions) -> dict[str, str]:
    """Return the units of columns in `_OF_ROBOTS` that neither file nor options state."""
    units: dict[str, str] = {}
    for channel, called, _, unit in _OF_ROBOTS:
        name = options.columns.get(f"{channel}_x", "")
        base = _array_of(name)
        told = {name, base} & columns.units.keys() or channel in options.units
        same = last_part(base).lower() == called.lower()  # fields of ROS 2 are in lower case
        units |= {channel: unit} if same and not told else {}
    return units


def _own_times(read: SourceColumns, columns: Mapping[str, str]) -> dict[str, str]:
    """Return the time of each channel, if several of one name stand before columns."""
    own, last = {}, ""
    for name in read.names:
        base = NUMBER.sub("", name)
        of_time = target_of(base) == "time" or unit_factor("time", read.units.get(name, ""))
        last = name if base != name and of_time else last
        own[name] = last
    if len({*own.values(), ""}) < 3:
        return {}
    times = {quantity_of(target): own[name] for target, name in columns.items() if own.get(name)}
    times.setdefault("position", times.get("speed", ""))
    return {f"{channel}_time": times[channel] for channel in CHANNELS if times.get(channel)}


def _finer_time(
    path: Path, suggested: Mapping[str, Sequence[str]], options: ImportOptions
) -> dict[str, str]:
    """Return the first of several times that most rows do not share with the row before."""
    names = suggested.get("time", ())
    with suppress(InputError):
        read = read_columns(path, Wanted(names), options).values if len(names) > 1 else {}
        for name in filter(read.__contains__, names):
            if np.mean(np.diff(read[name], axis=0) != 0) > _MOSTLY:
                return {"time": name}
    return {}


def _dated(path: Path, names: Sequence[str], options: ImportOptions) -> str | None:
    """Return the first column, or pandas' index, if it holds dates; else None."""
    first = [name for name in names if name in (names[0], "__index_level_0__")]
    with suppress(InputError):
        units = read_columns(path, Wanted(first), options).units
        return next((name for name in first if units.get(name) == DATE), None)
    return None


def _told_rate_hz(path: Path, names: Sequence[str], options: ImportOptions) -> float | None:
    """Return the rate that a file holds as its only number of such a name, or None."""
    rates = Wanted(name for name in names if _RATE.search(name.lower()))
    found = [0.0]
    with suppress(InputError):  # texts, for instance
        read = read_columns(path, rates, options).values if rates else {}
        found = [value for name in rates & read.keys() for value in np.ravel(read[name]).tolist()]
    return found[0] if len(found) == 1 and 0 < found[0] < np.inf else None


def _times_beside(names: Sequence[str], columns: Mapping[str, str]) -> dict[str, str]:
    """Return times that stand in a channel's group, or are named after its column.

    As ``acc.t`` beside ``acc.data``, and ``acc_t`` or ``t_acc`` beside ``acc`` or ``ax``.
    """
    found: dict[str, str] = {}
    for name in names:
        first, *behind = words = re.split(r"[_ ]", name)
        for word, others in ((first, behind), (words[-1], words[:-1])):
            if target_of(word) == "time" and (channel := target_of("_".join(others))) in CHANNELS:
                found.setdefault(f"{channel}_time", name)
    held = {quantity_of(target).replace("speed", "position") for target in columns}
    found = {target: name for target, name in found.items() if target[:-5] in held}
    for target, name in columns.items():
        channel = quantity_of(target).replace("speed", "position")
        if channel not in CHANNELS or name.startswith("/"):  # messages have their own
            continue
        inner = name if VALUES.search(name) else name.rpartition(".")[0]
        group = f"{VALUES.sub('', inner)}."
        own = re.escape(re.sub(r"[_. ][xyzXYZ]$", "", name))
        beside = re.compile(rf"{own}[_ ](?P<after>.+)|(?P<before>.+)[_ ]{own}")
        for other in names:
            match = beside.fullmatch(other)
            word = (match["after"] or match["before"]) if match else other.removeprefix(group)
            if word != other and target_of(word.strip("_ ")) == "time":
                found.setdefault(f"{channel}_time", other)
    return {target: name for target, name in found.items() if name != columns.get("time")}


def _with_vectors(names: Sequence[str]) -> Iterator[str]:
    """Yield the names, with three elements a[0], a[1], a[2] as the one name a.

    Elements with a standard name are joined whatever their number.
    """
    bases = [re.sub(r"[\[(]\d+[\])]$", "", name) for name in names]
    counts = Counter(base for base, name in zip(bases, names, strict=True) if base != name)
    yield from dict.fromkeys(
        base if counts[base] == 3 or base in STANDARD_NAMES.values() else name
        for base, name in zip(bases, names, strict=True)
    )


def _time_unit(columns: SourceColumns, options: ImportOptions) -> dict[str, str]:
    """Guess the unit of time from its steps, if neither file nor options state it; else {}."""
    mapped = [name for target, name in options.columns.items() if target.endswith("time")]
    name = mapped[0] if mapped else STANDARD_NAMES["time"]
    time = columns.values.get(name, np.zeros(0))
    told = "time" in options.units or name in columns.units or "time_fraction" in options.columns
    named = name != STANDARD_NAMES["time"] and unit_in_name("time", name)
    if told or named or time.ndim != 1 or len(time) < 2:
        return {}
    steps = np.diff(time)
    step = abs(float(np.median(steps) or np.mean(steps)))  # rows in batches share a time
    fitting = (
        unit
        for unit, largest, first, last in _TIME_UNITS
        if 0 < step <= largest and first < time[0] < last
    )
    unit = next(fitting, "s")
    return {} if unit == "s" else {"time": unit}
