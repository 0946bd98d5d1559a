"""The process that publishes on topics of ROS 2, by rclpy.

It is a child of the leader, so that rclpy does not delay the leader's ticks. The leader sends the
settings of `Publisher`, then ``{"frames": bytes}``, ``{"event": [UTC in ns, JSON]}`` and
``{"model": bytes}``. The process answers None when the topics exist, and a sentence if it fails.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, Final

import numpy as np
from rosbags.typesys import Stores, get_typestore

from mmt.core.errors import short_message
from mmt.core.frames import Channel, frame_dtype
from mmt.core.running.child_process import Parent
from mmt.core.running.process import lower_priority
from mmt_bridges.ros.messages import (
    CHANNEL_TOPICS,
    EVENTS,
    LOG,
    MODEL,
    SCENE,
    SEQUENCE,
    Message,
    Messages,
    Topic,
)

_KEPT_FRAMES: Final = 1000
"""Frames that can be sent again to a subscriber that has lost some: one second."""
_KEPT: Final[dict[Topic, int]] = {EVENTS: 100, LOG: 100, SCENE: 1, MODEL: 1}
"""How many of the last messages are kept for later subscribers, by topic."""
_LINGER_S: Final = 0.5
"""How long a subscriber may take to confirm the last messages of a topic."""


class Publisher:
    """A node with a publisher for each topic.

    Parameters
    ----------
    namespace
        First part of the topics' names.
    channels
        Channels of the frames.
    scene
        The resolved scene as JSON, which is published at once.
    samples_per_frame
        Samples of acceleration in a frame.
    """

    def __init__(
        self, namespace: str, channels: Iterable[Channel], scene: str, samples_per_frame: int
    ) -> None:
        self._channels = tuple(channels)
        self._dtype = frame_dtype(self._channels, samples_per_frame)
        acceleration = CHANNEL_TOPICS["acceleration"]
        self._kept = _KEPT | {acceleration: _KEPT_FRAMES * samples_per_frame}
        self._store = get_typestore(Stores.LATEST)
        self._messages = Messages(self._store.types)
        import rclpy  # here: the rclpy of another Python fails, which is reported
        from rclpy.signals import SignalHandlerOptions

        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(
            "leader", namespace=namespace, enable_rosout=False, start_parameter_services=False
        )
        framed = [SEQUENCE, *(CHANNEL_TOPICS[channel] for channel in self._channels)]
        self._publishers = {topic: self._publisher(topic) for topic in (*framed, *_KEPT)}
        self._publish(SCENE, self._messages.text(scene))

    def publish(self, message: Mapping[str, Any]) -> None:
        """Publish the content of a message from the leader."""
        for _, topic, made in self._made(message):
            self._publish(topic, made)

    def close(self) -> None:
        """Wait until subscribers have received everything, at most `_LINGER_S` for each topic."""
        import rclpy
        from rclpy.duration import Duration

        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=_LINGER_S))
        self._node.destroy_node()
        rclpy.shutdown()

    def _made(self, message: Mapping[str, Any]) -> Iterator[Message]:
        if "frames" in message:
            frames = np.frombuffer(message["frames"], self._dtype)
            yield from self._messages.frames(frames, self._channels, since_ns=0)
        elif "event" in message:
            time_ns, text = message["event"]
            yield from self._messages.event(time_ns, json.loads(text))
        else:
            yield 0, MODEL, self._messages.octets(message["model"])

    def _publish(self, topic: Topic, message: Any) -> None:
        self._publishers[topic].publish(bytes(self._store.serialize_cdr(message, topic.kind)))

    def _publisher(self, topic: Topic) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        package, part, kind = topic.kind.split("/")
        late = DurabilityPolicy.TRANSIENT_LOCAL if topic in _KEPT else DurabilityPolicy.VOLATILE
        return self._node.create_publisher(
            getattr(import_module(f"{package}.{part}"), kind),
            topic.name.removeprefix("/mmt/"),
            QoSProfile(depth=self._kept.get(topic, _KEPT_FRAMES), durability=late),
        )


def main() -> None:
    """Publish until the leader has gone; tell it when the topics exist, or the problem."""
    leader = Parent()
    lower_priority()  # so that subscribers do not delay the leader's ticks
    try:
        publisher = Publisher(**leader.receive())
        leader.send(None)
        for message in leader:
            publisher.publish(message)
        publisher.close()
    except Exception as error:  # noqa: BLE001 - the leader tells it
        leader.send(short_message(error) or type(error).__name__)


if __name__ == "__main__":
    main()
