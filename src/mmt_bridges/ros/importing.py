"""ROS 2 bags (folders, ``.db3``, ``.mcap``) and ROS 1 bags: fields as ``topic.field``.

What `mmt_bridges.ros.export_bag` has written has the names of an exported session as well.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError, brief
from mmt.core.extras import require
from mmt.core.frames import FIELD_OF_CHANNEL
from mmt.session.data import JsonObject
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import ImportOptions
from mmt_bridges.ros.messages import CHANNEL_TOPICS, EVENTS, SCENE, SEQUENCE

_UNITS: Final = {"position": "m", "translation": "m", "point": "m"}
"""The last part of a name whose values ROS gives in metres (REP 103); else it uses SI."""

_STANDARD_NAMES: Final = {
    f"{SEQUENCE.name}.{SEQUENCE.field}": "sequence",
    **{
        f"{topic.name}.{topic.field}": FIELD_OF_CHANNEL[channel]
        for channel, topic in CHANNEL_TOPICS.items()
    },
}
"""The fields that mmt has written, and what they are called in an exported session."""

_EARLIEST_DATE_NS: Final = 946_684_800_000_000_000
"""The year 2000: earlier stamps are those of a simulation, which begins at zero."""


def read_bag(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> Columns:
    """Read the wanted fields of a bag's messages, each with the times of its topic.

    Fields with x, y and z, such as ``/sensor.wrench.force``, are arrays (n, 3); numbers are
    (n,). Times are those of the messages' headers, or of their receipt where these are zero.
    A bag of mmt has its scene and events, and its fields under their standard names too.

    Raises
    ------
    InputError
        rosbags is not installed, or the file is missing or not a bag.
    """
    origin = f"import {path}"
    require("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if not path.exists():
        raise InputError(f"{origin}: No such file or directory")
    store = get_typestore(Stores.LATEST)
    try:
        with AnyReader([path], default_typestore=store) as reader:
            return _read(origin, reader, wanted)
    except Exception as error:  # damage reaches every part of the library
        said = f"this is not a ROS bag that can be read: {brief(error)}"
        if path.suffix.lower() == ".mcap":
            said += "; a session of mmt is one as it is, without import"
        raise InputError(f"{origin}: {said}") from error


def _read(origin: str, reader: Any, wanted: Callable[[str], bool]) -> Columns:
    values: dict[str, list[Any]] = {}
    stamps: dict[str, list[int]] = {}
    names: set[str] = set()
    units: dict[str, str] = {}
    texts: dict[str, list[JsonObject]] = {SCENE.name: [], EVENTS.name: []}
    for connection, received_ns, data in reader.messages():
        message = reader.deserialize(data, connection.msgtype)
        if connection.topic in texts and connection.msgtype == EVENTS.kind:
            texts[connection.topic].append(_json_object(message.data))
        stamp_ns = _stamp_ns(message) or received_ns
        for field, value in _numbers(connection.topic, message):
            for name in filter(None, (field, _STANDARD_NAMES.get(field))):
                names.add(name)
                if wanted(name):
                    values.setdefault(name, []).append(value)
                    stamps.setdefault(name, []).append(stamp_ns)
                    units[name] = _UNITS.get(field.rsplit(".")[-1], "")
    origin_ns = min((column[0] for column in stamps.values()), default=0)
    return Columns(
        origin=origin,
        values={name: np.array(column, dtype=np.float64) for name, column in values.items()},
        names=sorted(names),
        units={name: unit for name, unit in units.items() if unit},
        times={name: (np.array(column) - origin_ns) / 1e9 for name, column in stamps.items()},
        scene=next(iter(texts[SCENE.name]), None),
        events=texts[EVENTS.name],
        began_utc_ns=origin_ns if origin_ns >= _EARLIEST_DATE_NS else None,
    )


def _json_object(text: str) -> JsonObject:
    value = json.loads(text)
    if not isinstance(value, dict):
        message = "a scene or an event is not a JSON object"
        raise TypeError(message)
    return value


def _stamp_ns(message: Any) -> int:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _numbers(name: str, message: Any) -> Iterator[tuple[str, Any]]:
    """Yield each number and each vector of a message with its dotted name."""
    if all(hasattr(message, axis) for axis in "xyz") and not hasattr(message, "w"):
        yield name, (message.x, message.y, message.z)
    elif is_dataclass(message):
        for field in fields(message):
            if field.name != "header" and not field.name.startswith("_"):
                yield from _numbers(f"{name}.{field.name}", getattr(message, field.name))
    elif isinstance(message, int | float):
        yield name, message
