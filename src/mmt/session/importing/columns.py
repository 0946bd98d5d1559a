"""The columns of a recording as read from its file."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError, short_message
from mmt.core.files.untrusted import json_object, parsed_json
from mmt.session.data import JsonObject
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions
from mmt.session.importing.samples import ROW_NUMBER

MESSAGE_PARTS: Final = {
    "position": ("position", "translation", "point"),
    "force": ("force",),
    "acceleration": ("linear_acceleration", "accel.linear", "vector"),
}
"""Ends of the names of a vector within a ROS message, by quantity; that of a twist is a speed."""

BEGAN: Final = "began_utc_ns"
"""Name of the date of the first frame in exported sessions."""
OF_THE_SESSION: Final = ("scene_json", "annotations", "events_json", BEGAN)
"""Names of the data beside the frames in an exported session."""

_NAMES_OF_UNITS: Final = ("unit", "units", "unit_string", "ni_unitdescription")
"""Attributes that hold a unit, in lower case; the last two are those of LabVIEW."""

SHOWN_COLUMNS = 12
_SHOWN_CHARACTERS = 60


@dataclass(frozen=True, eq=False)
class SourceColumns:
    """Content of a file, unchanged."""

    values: Mapping[str, FloatArray]
    """Columns (n,) and arrays (n, k) by name."""
    names: Sequence[str] = ()
    """Names of all columns in the file, including those that were not read."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states, by column."""
    times: Mapping[str, FloatArray] = field(default_factory=dict)
    """Times (n,) in s of columns whose times are part of the file format, as in ROS messages."""
    row_name: Callable[[int], str] = ROW_NUMBER.format
    ends_left_out: bool = False
    """Whether the blanks at the end of a column were left out, as of tables."""
    labels: Mapping[str, npt.NDArray[np.str_]] = field(default_factory=dict)
    """Texts (n,) of wanted columns that hold no number."""
    scene: JsonObject | None = None
    annotations: bytes = b""
    events: Sequence[JsonObject] = ()
    frames: RecordArray | None = None
    """The frames (n,) of an exported session, if its format preserves them, else None."""
    notes: Sequence[str] = ()
    """Sentences for the user on how the file was read."""
    began_utc_ns: int | None = None
    """UTC since 1970 of the earliest of `times`, or of an exported session's first frame; None
    if the file has no dates."""
    episode: int | str | None = None
    """The episode or trial that was read, or None if the file has none."""
    origin: str = ""
    """What errors name, if it is not ``import`` and the path."""


def told_unit(attributes: Mapping[Any, Any]) -> str:
    """Return the unit among the attributes of a column, or "" if there is none."""
    for name, value in attributes.items():
        if text_in(name).lower() in _NAMES_OF_UNITS:
            unit = ", ".join(dict.fromkeys(map(text_in, np.ravel(value))))
            if unit:
                return unit
    return ""


@contextmanager
def named(origin: str) -> Iterator[None]:
    """Put the origin, as ``import a.csv``, before an error of the block that names none yet."""
    try:
        yield
    except InputError as error:
        text = str(error)
        named_text = text if text.startswith("import ") else f"{origin}: {text}"
        raise InputError(named_text) from error.__cause__ or error


@contextmanager
def reading(kind: str, damage: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Convert exceptions of the block to errors that name the expected kind of file.

    Parameters
    ----------
    kind
        The expected kind, for messages.
    damage
        Exceptions that the reader raises on a file of another kind; by default any.

    Raises
    ------
    InputError
        Instead of `damage` and OSError.
    """
    caught: tuple[type[Exception], ...] = (*damage, OSError)
    try:
        yield
    except InputError:
        raise
    except caught as error:
        other = (
            f"this is not {kind}: {short_message(error)}" if isinstance(error, damage) else error
        )
        raise InputError(str(getattr(error, "strerror", None) or other)) from error


class Wanted(frozenset[str]):
    """Names of columns to read. Called with a name, it tells whether to read that column."""

    def __call__(self, name: str) -> bool:
        """Return whether a name, or that of which it is a part, is in the set."""
        return name in self or any(name.startswith((f"{n}.", f"{n}[", f"{n}(")) for n in self)


def wanted_names(options: ImportOptions) -> Wanted:
    """Return the names of the columns to read."""
    return Wanted({"sequence", BEGAN, *STANDARD_NAMES.values(), *options.mapped_names()})


def distinct(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Make column names unique by numbering equal ones; return the names, and notes for the user.

    A column without a name gets its number.
    """
    counts, numbers = Counter(filter(None, names)), Counter[str]()
    taken, found = set(counts), []
    for place, name in enumerate(names, start=1):
        base = new = name or str(place)
        while counts[name] != 1 and new in taken:
            numbers[base] += 1
            new = f"{base}.{numbers[base]}"
        taken.add(new)
        found.append(new)
    doubled = {name: count for name, count in counts.items() if count > 1}
    texts = [
        f"{count} columns are called {name}: {name}.1 and so on" for name, count in doubled.items()
    ]
    return found, texts[:SHOWN_COLUMNS]


def listed(names: Sequence[str]) -> str:
    """List column names in a text of bounded length."""
    shown = ", ".join(name[:_SHOWN_CHARACTERS] for name in names[:SHOWN_COLUMNS])
    if len(names) <= SHOWN_COLUMNS:
        return f"the columns are {shown or 'none'}"
    return f"the first of {len(names)} columns are {shown}"


def beside_columns(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Parse the data beside the columns of an exported session, as fields of `SourceColumns`.

    `stored` has values of the file by the names in `OF_THE_SESSION`; any may be missing or None.

    Raises
    ------
    InputError
        The scene is not a JSON object, the events are not a list of such, or see `parsed_date`.
    """
    given = {name: stored[name] for name in OF_THE_SESSION if stored.get(name) is not None}
    truth = given.get("annotations", b"")
    scene = json_object(text_in(given.get("scene_json", "{}")), "scene")
    return {
        "scene": scene if "scene_json" in given else None,
        "events": parsed_events(text_in(given.get("events_json", "[]")), "events"),
        "annotations": truth if isinstance(truth, bytes) else np.asarray(truth).tobytes(),
        "began_utc_ns": parsed_date(given.get(BEGAN)),
    }


def text_in(value: Any) -> str:
    """Return a text that a file holds as text, bytes or an array of one of these."""
    value = value.flat[0] if isinstance(value, np.ndarray) and value.size else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def parsed_events(text: str, name: str) -> Sequence[JsonObject]:
    """Parse the events of an exported session.

    Raises
    ------
    InputError
        The text is not a list of JSON objects; `name` is its name in the file.
    """
    events = parsed_json(text, name)
    if not isinstance(events, list) or not all(isinstance(event, dict) for event in events):
        raise InputError(f"{name} is not a list of JSON objects")
    return events


def parsed_date(value: Any) -> int | None:
    """Return the date of an exported session (UTC in ns since 1970), or None if it has none.

    Raises
    ------
    InputError
        The value is not an integer of 64 bits.
    """
    found = np.ravel([] if value is None else value)
    try:
        return int(np.int64(int(found[0]))) if len(found) else None
    except (ValueError, OverflowError) as error:
        raise InputError(f"{BEGAN} is not a number of nanoseconds") from error
