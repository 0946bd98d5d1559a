"""ROS bags (folders, ``.db3``, ``.mcap``, ``.bag``) and MCAP files: fields as ``topic.field``.

Bags that `mmt_bridges.ros.export_bag` has written also have the names of an exported session.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.untrusted import json_object
from mmt.core.frames import FIELD_OF_CHANNEL, axes_of
from mmt.session.data import JsonObject, axis_columns
from mmt.session.importing.column_names import gives_unit, names_of, tells_apart
from mmt.session.importing.columns import SourceColumns, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import seconds_of
from mmt_bridges.ros.bag_files import decoded_messages
from mmt_bridges.ros.clocks import SourceStamps, choose_clock
from mmt_bridges.ros.messages import CHANNEL_TOPICS, EVENTS, SCENE, SEQUENCE
from mmt_bridges.ros.storage import StoredMessage

_METRES: Final = {"position", "translation", "point"}
"""Last parts of the names of vectors that ROS gives in metres (REP 103)."""

_STANDARD_NAMES: Final = {
    f"{SEQUENCE.name}.{SEQUENCE.field}": "sequence",
    **{
        f"{topic.name}.{topic.field}": FIELD_OF_CHANNEL[channel]
        for channel, topic in CHANNEL_TOPICS.items()
    },
    **{
        f"{CHANNEL_TOPICS['orientation'].name}.{CHANNEL_TOPICS['orientation'].field}.{axis}": name
        for axis, name in zip(axes_of("orientation"), axis_columns("orientation"), strict=True)
    },
}
"""Names in an exported session, by the fields that mmt writes."""

_NUMBER: Final = (bool, int, float, np.number, np.bool_)
_EARLIEST_DATE_NS: Final = 946_684_800_000_000_000
"""The year 2000: earlier stamps are those of a simulation, which begins at zero."""
_LONGEST_LIST: Final = 256
_MOST_SOURCES: Final = 16
"""Most sources of one topic whose columns can be asked for by number."""


def read_bag(path: Path, wanted: Callable[[str], bool], options: ImportOptions) -> SourceColumns:
    """Read the wanted fields of the messages, each with the times of its topic.

    Fields with x, y and z, such as ``/sensor.wrench.force``, are arrays (n, 3), lists of k numbers
    are (n, k) and numbers (n,). Values that the message names, such as the joints of a
    ``JointState``, are ``/joint_states.position.JOINT``. If a topic has several publishers or
    frames of reference, each is a source of its own, ``/imu@FRAME``. All times are by one clock,
    see `mmt_bridges.ros.clocks.choose_clock`. A bag of mmt also has its scene and events, and its
    fields have their standard names, too.

    Raises
    ------
    InputError
        rosbags is not installed, or the file is missing or not a bag.
    """
    require("rosbags")
    if not path.exists():
        raise InputError("No such file or directory")
    notes: list[str] = []
    gathered = _Gathered(wanted)
    with reading("a ROS bag that can be read"):
        for stored, message in decoded_messages(path, notes):
            gathered.add(stored, message)
    if not gathered.names and notes:
        raise InputError(f"this is not a ROS bag that can be read: {notes[0]}")
    return gathered.columns(options, notes)


class _Source(SourceStamps):
    """The messages of one publisher in one frame of reference."""

    def __init__(self, topic: str, frame: str) -> None:
        super().__init__(topic)
        self.frame = frame
        self.labels: list[str] = []
        self.texts: dict[str, dict[int, str]] = {}
        self.values: dict[str, list[Any]] = {}
        self.rows: dict[str, list[int]] = {}
        self.names: set[str] = set()
        self.in_metres: set[str] = set()
        self.keeps: dict[str, bool] = {}

    def tells_apart(self) -> bool:
        """Return whether a field tells sensors apart whose messages share the topic."""
        numbers = (n for field, n in self.values.items() if tells_apart(field, by_number=True))
        texts = (of_row.values() for of_row in self.texts.values())
        return any(len(set(map(repr, each))) > 1 for each in (*numbers, *texts))


class _Gathered:
    """The values read from the messages, by source."""

    def __init__(self, wanted: Callable[[str], bool]) -> None:
        self._wanted = wanted
        self._sources: dict[tuple[str, int | str, str], _Source] = {}
        self._texts: dict[str, list[JsonObject]] = {SCENE.name: [], EVENTS.name: []}

    @property
    def names(self) -> bool:
        """Whether any field was found."""
        return any(source.names for source in self._sources.values())

    def add(self, stored: StoredMessage, message: Any) -> None:
        """Add the wanted fields of a message."""
        topic = stored.topic
        if topic in self._texts and stored.kind == EVENTS.kind:
            self._texts[topic].append(json_object(message.data, "a scene or an event"))
        members = _members(message)
        header = _members(members.get("header"))
        frame = str(header.get("frame_id", members.get("frame_id", "")) or "")
        key = (topic, stored.source, frame)
        source = self._sources.get(key) or self._sources.setdefault(key, _Source(topic, frame))
        row = source.stamp(stored.received_ns, _stamp_ns(header) or _stamp_ns(members))
        labels = _labels_in(members)
        source.labels = source.labels or labels
        for field, value in _numbers("", message):
            if isinstance(value, str):
                if (tells_apart(field) or gives_unit(field)) and self._keeps(source, field):
                    source.texts.setdefault(field, {})[row] = value
                continue
            relabelled = labels != source.labels and field.count(".") == 1
            if relabelled and isinstance(value, np.ndarray) and len(value) == len(labels):
                if sorted(labels) != sorted(source.labels):
                    continue  # each label has its own field
                value = value[[labels.index(label) for label in source.labels]]  # noqa: PLW2901
            source.names.add(field)
            if type(value) is tuple and field.split(".")[-1] in _METRES and stored.in_si_units:
                source.in_metres.add(field)
            if self._keeps(source, field):
                source.values.setdefault(field, []).append(value)
                source.rows.setdefault(field, []).append(row)

    def _keeps(self, source: _Source, field: str) -> bool:
        """Whether a field is wanted, by any of the names that its source may get."""
        if field not in source.keeps:
            labels = ("", f"@{source.frame}", *(f"@{n}" for n in range(1, _MOST_SOURCES)))
            names = [f"{source.topic}{label}{field}" for label in labels]
            names += filter(None, [_STANDARD_NAMES.get(source.topic + field)])
            source.keeps[field] = any(map(self._wanted, names))
        return source.keeps[field]

    def columns(self, options: ImportOptions, notes: list[str]) -> SourceColumns:
        """Return the columns, with their times by one clock."""
        labels, of_several = _labels(list(self._sources.values()))
        notes += of_several
        used = [source for source in self._sources.values() if source.values]
        receipt, remarks = choose_clock(used, options.stamps)
        starts_ns = (int(source.times_ns(receipt=receipt).min()) for source in used)
        origin_ns = min(starts_ns, default=0)
        values, times, names = {}, {}, set()
        units, texts = dict[str, str](), dict[str, npt.NDArray[np.str_]]()
        for source in self._sources.values():
            label = labels[source]
            received_ns = source.times_ns(receipt=True)
            time_s = (source.times_ns(receipt=receipt) - origin_ns) / 1e9
            order = np.argsort(received_ns, kind="stable")  # files may be in any
            ordered_s = time_s[order]
            told = source.tells_apart()
            for field, of_row in source.texts.items():
                texts[label + field] = np.array([of_row.get(row, "") for row in order.tolist()])
                times[label + field] = ordered_s
            for field in sorted(source.names):
                standard = _STANDARD_NAMES.get(label + field)
                for name in filter(None, (f"{label}{field}", standard)):
                    names.add(name)
                    column = source.values.get(field)
                    if column is None or not self._wanted(name):
                        continue
                    if len({np.shape(value) for value in column}) > 1:
                        notes.append(f"{name} has lists of several lengths and was left out")
                        break
                    rows, of_rows = np.array(source.rows[field]), np.array(column, dtype=np.float64)
                    if told and len(rows) < len(order):  # as in a table, with blanks
                        blank = np.full((len(order), *of_rows.shape[1:]), np.nan)
                        blank[rows] = of_rows
                        rows, of_rows = np.arange(len(order)), blank
                    whole = len(rows) == len(order)
                    own = order if whole else np.argsort(received_ns[rows], kind="stable")
                    values[name] = of_rows[own]
                    times[name] = ordered_s if whole else time_s[rows[own]]
                    units |= {name: "m"} if field in source.in_metres else {}
        return SourceColumns(
            values=values,
            names=sorted(names),
            units=units,
            times=times,
            labels=texts,
            scene=next(iter(self._texts[SCENE.name]), None),
            events=self._texts[EVENTS.name],
            notes=[*notes, *remarks],
            began_utc_ns=origin_ns if origin_ns >= _EARLIEST_DATE_NS else None,
        )


def _labels(sources: list[_Source]) -> tuple[dict[_Source, str], list[str]]:
    """Return each source's name, and a note for each topic that has several.

    The name is the topic, with the source's frame or number if the topic has several.
    """
    labels, notes = dict[_Source, str](), list[str]()
    for topic in dict.fromkeys(source.topic for source in sources):
        same = [each for each in sources if each.topic == topic]
        frames = [each.frame for each in same]
        apart = len(set(frames)) == len(same) and "" not in frames
        told = frames if apart else map(str, range(1, len(same) + 1))
        names = [f"{topic}@{each}" for each in told] if len(same) > 1 else [topic]
        labels |= zip(same, names, strict=True)
        if len(same) > 1:
            several = f"{topic} has {len(same)} sources, none was taken for another"
            notes.append(f"{several}: {', '.join(names)}")
    return labels, notes


def _members(message: Any) -> Mapping[str, Any]:
    """Return the members of a message by name; none if the value is not a message."""
    if isinstance(message, dict):
        return message
    return {name: getattr(message, name) for name in _names_in(message.__class__)}


@lru_cache
def _names_in(kind: type) -> list[str]:
    """Return the names of a type's members; cached, as a bag has few types and many messages."""
    found = fields(kind) if is_dataclass(kind) else ()
    return [field.name for field in found if not field.name.startswith("_")]


def _stamp_ns(members: Mapping[str, Any]) -> int:
    """Return the stamp among the members of a header or of a message; 0 if there is none."""
    told = members.get("stamp", members.get("timestamp"))
    told = seconds_of(told) if isinstance(told, str) else told
    if isinstance(told, int | float):  # in JSON, in any unit
        dates_ns = (told * unit for unit in (1_000_000_000, 1_000_000, 1000, 1))
        return next((int(ns) for ns in dates_ns if _EARLIEST_DATE_NS <= ns < 1 << 63), 0)
    stamp = _members(told)
    parts = (stamp.get(name) for name in ("nanosec", "nsec", "nanos"))
    rest = next((p for p in parts if p is not None), 0)
    try:
        ns = int(stamp.get("sec", stamp.get("seconds", 0))) * 1_000_000_000 + int(rest)
    except (ValueError, TypeError, OverflowError):  # no number, or none that is finite
        return 0
    return ns if 0 <= ns < 1 << 63 else 0


def _numbers(name: str, message: Any) -> Iterator[tuple[str, Any]]:
    """Yield each number, text, list of numbers and vector of a message with its dotted name."""
    members = _members(message)
    if members:
        if set("xyz") <= members.keys() and "w" not in members:
            vector = tuple(members[axis] for axis in "xyz")
            if all(isinstance(each, _NUMBER) for each in vector):
                yield name, vector
                if len(members) == len(vector):
                    return
                members = {each: value for each, value in members.items() if each not in {*"xyz"}}
        labels = _labels_in(members)
        for each, value in members.items():
            if each in {"header", "stamp", "timestamp"} and not isinstance(value, _NUMBER):
                continue
            yield from _numbers(f"{name}.{each}", value)
            if labels and np.ndim(value) == 1 and len(value) == len(labels):
                for label, one in zip(labels, value, strict=True):
                    yield from _numbers(f"{name}.{each}.{label}", one)
    elif isinstance(message, _NUMBER):
        yield name, float(message)
    elif isinstance(message, str):
        yield name, message
    elif isinstance(message, np.ndarray | list) and 0 < len(message) <= _LONGEST_LIST:
        yield from _of_list(name, message)


def _of_list(name: str, values: Any) -> Iterator[tuple[str, Any]]:
    if all(isinstance(each, _NUMBER) for each in values):
        yield name, np.asarray(values, dtype=np.float64)
    elif all(members := list(map(_members, values))):
        # publishers of /tf share the topic, each with a list of its own frames
        for label, each in zip(names_of(members), values, strict=True):
            yield from _numbers(f"{name}.{label}", each)


def _labels_in(members: Mapping[str, Any]) -> list[str]:
    """Return the names that a message gives to the elements of its lists; [] if not one to each."""
    labels: Any = members.get("name")
    given = isinstance(labels, list) and all(label and isinstance(label, str) for label in labels)
    return list(labels) if given and len({*labels}) == len(labels) else []
