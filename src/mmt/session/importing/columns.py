"""The columns of a recording as they stand in its file."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError, brief
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.session.data import JsonObject, axis_columns
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.samples import ROW_NUMBER

MESSAGE_PARTS: Final = {
    "position": ("position", "translation", "point"),
    "force": ("force",),
    "acceleration": ("linear_acceleration", "linear", "vector"),
}
"""Names that a vector has within a ROS message, by quantity."""

BEGAN: Final = "began_utc_ns"
"""Under which exported sessions hold the date of their first frame."""
OF_THE_SESSION: Final = ("scene_json", "annotations", "events_json", BEGAN)
"""What files of arrays hold of an exported session beside its frames."""

SHOWN_COLUMNS = 12
_SHOWN_CHARACTERS = 60

STANDARD_NAMES: Final[Mapping[str, str]] = {
    "time": "time_s",
    **{f"{channel}_time": f"{channel}_time_s" for channel in CHANNELS},
    **{str(channel): name for channel, name in FIELD_OF_CHANNEL.items()},
    **{
        f"{channel}_{axis}": name
        for channel in CHANNELS
        for axis, name in zip("xyz", axis_columns(channel), strict=True)
    },
}
"""The column that a target takes where it is not mapped."""


@dataclass(frozen=True, eq=False)
class SourceColumns:
    """What a file holds, unchanged."""

    origin: str
    """The file, for errors."""
    values: Mapping[str, FloatArray]
    """Columns (n,) and arrays (n, k) by name."""
    names: Sequence[str] = ()
    """Every name in the file, also of what was not read."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states, by column."""
    times: Mapping[str, FloatArray] = field(default_factory=dict)
    """Times (n,) in s of columns that have them from the file itself, as ROS messages have."""
    row_name: Callable[[int], str] = ROW_NUMBER.format
    scene: JsonObject | None = None
    annotations: bytes = b""
    events: Sequence[JsonObject] = ()
    frames: RecordArray | None = None
    """The frames (n,) themselves, where the file is a session that mmt wrote."""
    notes: Sequence[str] = ()
    """What a person should know of how the file was read."""
    began_utc_ns: int | None = None
    """UTC since 1970 of the earliest of `times`, or of an exported session's first frame; None
    where the file has no dates."""
    episode: int | None = None
    """Number of the episode that was read, None if it is no data set with episodes."""


@contextmanager
def reading(
    origin: str, kind: str, damage: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Explain what hinders reading a file: it is missing, or not of its kind.

    Parameters
    ----------
    origin, kind
        The file, and what it should be, for errors.
    damage
        What a reader raises of other files; of a foreign library anything.

    Raises
    ------
    InputError
        In place of `damage` and OSError.
    """
    try:
        yield
    except InputError as error:
        said = str(error)
        raise InputError(said if said.startswith(origin) else f"{origin}: {said}") from error
    except damage as error:
        reason = getattr(error, "strerror", None) if isinstance(error, OSError) else None
        raise InputError(f"{origin}: {reason or f'this is not {kind}: {brief(error)}'}") from error
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error


def wanted_names(options: ImportOptions) -> Callable[[str], bool]:
    """Return a function that says whether a column of a name is to be read."""
    names = {"sequence", BEGAN, *STANDARD_NAMES.values(), *options.mapped_names()}
    return lambda name: (
        name in names
        or any(name[: place.start()] in names for place in re.finditer(r"[.\[(]", name))
    )


def distinct(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return names of which no two are alike, and what was done: columns of one name are numbered.

    A column without a name is called by its place.
    """
    counts = Counter(filter(None, names))
    taken, numbers, found = set(counts), dict.fromkeys(counts, 0), []
    for place, name in enumerate(names, start=1):
        new = name or str(place)
        while counts[name] > 1 and new in taken:
            numbers[name] += 1
            new = f"{name}.{numbers[name]}"
        taken.add(new)
        found.append(new)
    doubled = {name: count for name, count in counts.items() if count > 1}
    said = [
        f"{count} columns are called {name}: {name}.1 and so on" for name, count in doubled.items()
    ]
    return found, [*said[:SHOWN_COLUMNS]]


def listed(names: Sequence[str]) -> str:
    """Name columns in a text that stays short however many there are, and however long."""
    shown = ", ".join(name[:_SHOWN_CHARACTERS] for name in names[:SHOWN_COLUMNS])
    if len(names) <= SHOWN_COLUMNS:
        return f"the columns are {shown or 'none'}"
    return f"the first of {len(names)} columns are {shown}"


def parsed_scene(text: str | bytes | None, name: str, origin: str) -> JsonObject | None:
    """Return the scene of an exported session out of its JSON, None where it has none.

    Raises
    ------
    InputError
        It is not a JSON object; the message has the name under which the file holds it.
    """
    scene = _parsed(text, name, origin)
    if scene is None:
        return None
    if not isinstance(scene, dict):
        raise InputError(f"{origin}: {name} is not a JSON object")
    return scene


def parsed_events(text: str | bytes | None, name: str, origin: str) -> Sequence[JsonObject]:
    """Return the events of an exported session out of their JSON.

    Raises
    ------
    InputError
        They are not a list of JSON objects; the message has the name as of `parsed_scene`.
    """
    events = _parsed(text, name, origin)
    if events is None:
        return ()
    if not isinstance(events, list) or not all(isinstance(event, dict) for event in events):
        raise InputError(f"{origin}: {name} is not a list of JSON objects")
    return events


def parsed_date(value: Any, origin: str) -> int | None:
    """Return the date of an exported session (ns of UTC since 1970), None where it has none.

    Raises
    ------
    InputError
        It is not a number of a date.
    """
    found = np.ravel([] if value is None else value)
    try:
        return int(np.int64(int(found[0]))) if len(found) else None
    except (ValueError, OverflowError) as error:
        raise InputError(f"{origin}: {BEGAN} is not a number of nanoseconds") from error


def _parsed(text: str | bytes | None, name: str, origin: str) -> Any:
    try:
        return None if text is None else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{origin}: {name} is not valid JSON: {error}") from error
