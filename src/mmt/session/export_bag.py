"""Export a session as a ROS 2 bag: a folder with an MCAP file of standard messages.

Units are those of REP 103: metres, newtons, metres per second squared. Millimetres are divided by
1000 in double precision, so that metres times 1000, rounded to single precision, are the frame's
millimetres to the bit: both roundings together are off by less than 2**-51 of the value, half a
step of single precision is no less than 2**-25 of it.
"""

import heapq
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import FIELD_OF_CHANNEL, Channel
from mmt.session.data import JsonObject, RecordedSession, to_json
from mmt.session.folders import replacing_folder


class Topic(NamedTuple):
    """A topic of a bag that mmt writes."""

    name: str
    kind: str
    """Type of its messages."""
    field: str
    """Where the value is in a message."""
    frame_id: str = ""
    """Of the header, where the message has one."""


CHANNEL_TOPICS: Final[dict[Channel, Topic]] = {
    "position": Topic(
        "/mmt/position", "geometry_msgs/msg/PointStamped", "point", frame_id="mmt_surface"
    ),
    "force": Topic(
        "/mmt/force", "geometry_msgs/msg/WrenchStamped", "wrench.force", frame_id="mmt_tool"
    ),
    "acceleration": Topic(
        "/mmt/acceleration", "sensor_msgs/msg/Imu", "linear_acceleration", frame_id="mmt_tool"
    ),
}
"""The topics of the channels. The frame ``mmt_tool`` has the axes of ``mmt_surface``."""

SEQUENCE: Final = Topic("/mmt/sequence", "std_msgs/msg/UInt32", "data")
"""Numbers of the frames; a header of ROS 2 has none."""
EVENTS: Final = Topic("/mmt/events", "std_msgs/msg/String", "data")
"""Events, a JSON object each."""
SCENE: Final = Topic("/mmt/scene", "std_msgs/msg/String", "data")
"""The resolved scene, one JSON object at the beginning."""
LOG: Final = Topic("/mmt/log", "rcl_interfaces/msg/Log", "msg")
"""The sentence of each event, for log viewers."""

_BAG_SUFFIXES: Final = {".yaml", ".mcap", ".db3"}
_METADATA_VERSION: Final = 8
_FRAMES_PER_BLOCK: Final = 4096

_Written = tuple[int, Topic, Any]
"""UTC (ns), topic and message."""


def write_bag(path: Path, session: RecordedSession) -> None:
    """Write frames, scene and events; another bag of this name is replaced.

    Stamps are UTC: the session's date and the follower's time. A session that does not know when
    it began begins now.

    Raises
    ------
    InputError
        rosbags is not installed, or the name is that of a folder with something else in it, or
        see `mmt.session.export_session`.
    MmtError
        Writing failed.
    """
    require("rosbags")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    _require_replaceable(path)
    with replacing_folder(path) as folder:
        writer = Writer(folder, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for stamp_ns, topic, message in _messages(session, _Types(store.types)):
                if topic.name not in connections:
                    connections[topic.name] = writer.add_connection(
                        topic.name, topic.kind, typestore=store
                    )
                data = store.serialize_cdr(message, topic.kind)
                writer.write(connections[topic.name], stamp_ns, data)


class _Types:
    """Makes messages of a type store's types."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self.of = types
        self.make: dict[Channel, Callable[[Any, Any], Any]] = {
            "position": self.point,
            "force": self.wrench,
            "acceleration": self.imu,
        }
        self._vector = types["geometry_msgs/msg/Vector3"]
        self._zero = self._vector(0.0, 0.0, 0.0)
        self._level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        self._unknown, self._absent = np.zeros(9), np.array([-1.0] + 8 * [0.0])

    def stamp(self, time_ns: int) -> Any:
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        return self.of["builtin_interfaces/msg/Time"](seconds, nanoseconds)

    def header(self, time_ns: int, frame_id: str) -> Any:
        return self.of["std_msgs/msg/Header"](self.stamp(time_ns), frame_id)

    def point(self, header: Any, position_m: list[float]) -> Any:
        point = self.of["geometry_msgs/msg/Point"](*position_m)
        return self.of["geometry_msgs/msg/PointStamped"](header, point)

    def wrench(self, header: Any, force_n: list[float]) -> Any:
        wrench = self.of["geometry_msgs/msg/Wrench"](self._vector(*force_n), self._zero)
        return self.of["geometry_msgs/msg/WrenchStamped"](header, wrench)

    def imu(self, header: Any, acceleration_m_s2: list[float]) -> Any:
        # -1 as the first of a covariance: that quantity was not measured (sensor_msgs/Imu)
        turned, turning = (self._level, self._absent), (self._zero, self._absent)
        moved = (self._vector(*acceleration_m_s2), self._unknown)
        return self.of["sensor_msgs/msg/Imu"](header, *turned, *turning, *moved)

    def log(self, stamp_ns: int, sentence: str) -> Any:
        kind = self.of["rcl_interfaces/msg/Log"]
        return kind(self.stamp(stamp_ns), kind.INFO, "mmt", sentence, "", "", 0)


def _messages(session: RecordedSession, types: _Types) -> Iterator[_Written]:
    """Yield the session's messages by time."""
    began_ns = session.began_utc_ns or time.time_ns()
    text = types.of["std_msgs/msg/String"]
    if session.scene is not None:
        yield began_ns, SCENE, text(to_json(dict(session.scene)))
    yield from heapq.merge(
        _frames(session, types, began_ns),
        _events(session, types, began_ns),
        key=lambda written: written[0],
    )


def _frames(session: RecordedSession, types: _Types, began_ns: int) -> Iterator[_Written]:
    """Yield the messages of the frames; numbers of Python take ten times the room, so in blocks."""
    frames = session.frames
    since_ns = began_ns - int(frames["time_ns"][0]) if len(frames) else 0
    for first in range(0, len(frames), _FRAMES_PER_BLOCK):
        block = frames[first : first + _FRAMES_PER_BLOCK]
        yield from _block(block, session.channels, since_ns, types)


def _block(
    frames: RecordArray, channels: Iterable[Channel], since_ns: int, types: _Types
) -> Iterator[_Written]:
    made = []
    for channel in channels:
        vectors = frames[FIELD_OF_CHANNEL[channel]].astype(np.float64)
        values = (vectors / 1e3 if channel == "position" else vectors).tolist()
        made.append((CHANNEL_TOPICS[channel], types.make[channel], values))
    number = types.of["std_msgs/msg/UInt32"]
    for row, (time_ns, sequence) in enumerate(frames[["time_ns", "sequence"]].tolist()):
        stamp_ns = time_ns + since_ns
        yield stamp_ns, SEQUENCE, number(sequence)
        for topic, make, values in made:
            yield stamp_ns, topic, make(types.header(stamp_ns, topic.frame_id), values[row])


def _events(session: RecordedSession, types: _Types, began_ns: int) -> Iterator[_Written]:
    text = types.of["std_msgs/msg/String"]
    for event in session.events:
        stamp_ns = began_ns + _time_ns(event)
        yield stamp_ns, EVENTS, text(to_json(dict(event)))
        sentence = event.get("event")
        if isinstance(sentence, str) and sentence:
            yield stamp_ns, LOG, types.log(stamp_ns, sentence)


def _time_ns(event: JsonObject) -> int:
    """Return an event's session time, 0 where it has none."""
    time_s = event.get("time_s")
    known = isinstance(time_s, int | float) and math.isfinite(time_s)
    return round(time_s * 1e9) if known and time_s is not None else 0


def _require_replaceable(path: Path) -> None:
    """Refuse what is there already unless it is a bag and nothing else."""
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"cannot write {path}: a ROS 2 bag is a folder, and this is a file")
    files = list(path.iterdir())
    is_bag = any(file.name == "metadata.yaml" for file in files)
    if not is_bag or any(file.is_dir() or file.suffix not in _BAG_SUFFIXES for file in files):
        raise InputError(
            f"cannot write {path}: this folder holds other things than a ROS 2 bag; choose "
            "another name"
        )
