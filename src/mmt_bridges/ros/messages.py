"""The ROS 2 messages of a session, in a bag and live.

Units are those of REP 103: metres, newtons, metres per second squared. Millimetres are divided by
1000 in double precision. Then metres times 1000, rounded to single precision, are the frame's
millimetres to the bit: the two roundings together change the value by less than 2**-51 of it, and
half a step of single precision is at least 2**-25 of it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, Channel, axes_of
from mmt.session.data import FRAME_PERIOD_NS, JsonObject, sample_times, to_json


class Topic(NamedTuple):
    """A topic of a bag that mmt writes."""

    name: str
    kind: str
    """Type of its messages."""
    field: str
    """Field of the message that holds the value."""
    frame_id: str = ""
    """Frame of the header, if the message has one."""


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
    "orientation": Topic(
        "/mmt/orientation",
        "geometry_msgs/msg/QuaternionStamped",
        "quaternion",
        frame_id="mmt_surface",
    ),
}
"""The topics of the channels. The frame ``mmt_tool`` has the axes of ``mmt_surface``."""

SEQUENCE: Final = Topic("/mmt/sequence", "std_msgs/msg/UInt32", "data")
"""Sequence numbers of the frames, for which headers of ROS 2 have no field."""
EVENTS: Final = Topic("/mmt/events", "std_msgs/msg/String", "data")
"""Events, a JSON object each."""
SCENE: Final = Topic("/mmt/scene", "std_msgs/msg/String", "data")
"""The resolved scene, one JSON object at the beginning."""
LOG: Final = Topic("/mmt/log", "rcl_interfaces/msg/Log", "msg")
"""The sentence of each event, for log viewers."""
MODEL: Final = Topic("/mmt/model", "std_msgs/msg/UInt8MultiArray", "data")
"""The texture model as a file; only live, bags have none."""

Message = tuple[int, Topic, Any]
"""UTC (ns), topic and message."""


class Messages:
    """Make messages by the types of a rosbags type store."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._of = types
        self._make: dict[Channel, Callable[[Any, Any], Any]] = {
            "position": self._point,
            "force": self._wrench,
            "acceleration": self._imu,
            "orientation": self._quaternion,
        }
        self._vector = types["geometry_msgs/msg/Vector3"]
        self._zero = self._vector(0.0, 0.0, 0.0)
        self._level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        self._unknown, self._absent = np.zeros(9), np.array([-1.0] + 8 * [0.0])

    def frames(
        self, frames: RecordArray, channels: Iterable[Channel], since_ns: int
    ) -> Iterator[Message]:
        """Yield the messages of frames (n,) by time; a frame's time plus `since_ns` is UTC.

        Each sample of acceleration has a message of its own, with its own stamp.
        """
        made = []
        for channel in channels:
            vectors = frames[FIELD_OF_CHANNEL[channel]].astype(np.float64)
            vectors = vectors.reshape(len(frames), -1, len(axes_of(channel)))
            values = (vectors / 1e3 if channel == "position" else vectors).tolist()
            at_ns = sample_times(frames["time_ns"] + since_ns, vectors.shape[1], FRAME_PERIOD_NS)
            stamps = at_ns.reshape(vectors.shape[:2]).tolist()
            made.append((CHANNEL_TOPICS[channel], self._make[channel], values, stamps))
        number = self._of["std_msgs/msg/UInt32"]
        for row, (time_ns, sequence) in enumerate(frames[["time_ns", "sequence"]].tolist()):
            messages: list[Message] = [(time_ns + since_ns, SEQUENCE, number(sequence))]
            for topic, make, values, stamps in made:
                for stamp_ns, vector in zip(stamps[row], values[row], strict=True):
                    header = self._header(stamp_ns, topic.frame_id)
                    messages.append((stamp_ns, topic, make(header, vector)))
            yield from sorted(messages, key=itemgetter(0))

    def event(self, stamp_ns: int, event: JsonObject) -> Iterator[Message]:
        """Yield the message of an event, and that of its sentence."""
        yield stamp_ns, EVENTS, self.text(to_json(dict(event)))
        sentence = event.get("event")
        if isinstance(sentence, str) and sentence:
            yield stamp_ns, LOG, self._log(stamp_ns, sentence)

    def text(self, text: str) -> Any:
        """Return a message that is a text."""
        return self._of["std_msgs/msg/String"](text)

    def octets(self, octets: bytes) -> Any:
        """Return a message that is an array of bytes."""
        layout = self._of["std_msgs/msg/MultiArrayLayout"]([], 0)
        return self._of["std_msgs/msg/UInt8MultiArray"](layout, np.frombuffer(octets, np.uint8))

    def _stamp(self, time_ns: int) -> Any:
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        return self._of["builtin_interfaces/msg/Time"](seconds, nanoseconds)

    def _header(self, time_ns: int, frame_id: str) -> Any:
        return self._of["std_msgs/msg/Header"](self._stamp(time_ns), frame_id)

    def _point(self, header: Any, position_m: list[float]) -> Any:
        point = self._of["geometry_msgs/msg/Point"](*position_m)
        return self._of["geometry_msgs/msg/PointStamped"](header, point)

    def _wrench(self, header: Any, force_n: list[float]) -> Any:
        wrench = self._of["geometry_msgs/msg/Wrench"](self._vector(*force_n), self._zero)
        return self._of["geometry_msgs/msg/WrenchStamped"](header, wrench)

    def _imu(self, header: Any, acceleration_m_s2: list[float]) -> Any:
        # -1 as the first of a covariance: that quantity was not measured (sensor_msgs/Imu)
        turned, turning = (self._level, self._absent), (self._zero, self._absent)
        moved = (self._vector(*acceleration_m_s2), self._unknown)
        return self._of["sensor_msgs/msg/Imu"](header, *turned, *turning, *moved)

    def _quaternion(self, header: Any, orientation: list[float]) -> Any:
        w, x, y, z = orientation
        quaternion = self._of["geometry_msgs/msg/Quaternion"](x, y, z, w)
        return self._of["geometry_msgs/msg/QuaternionStamped"](header, quaternion)

    def _log(self, stamp_ns: int, sentence: str) -> Any:
        kind = self._of["rcl_interfaces/msg/Log"]
        return kind(self._stamp(stamp_ns), kind.INFO, "mmt", sentence, "", "", 0)
