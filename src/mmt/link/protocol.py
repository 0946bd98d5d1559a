"""The protocol of the link: event names, the follower's hello, limits, and statistics.

The layout for other clients is documented in ``docs/reference/wire.md``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeVar

import msgpack
import numpy as np

from mmt.core.errors import InputError, printable
from mmt.core.frames import MOST_SAMPLES, Channel, frame_dtype, ordered_channels, samples_per_frame
from mmt.core.running.process import clock_id
from mmt.core.sequence_numbers import SEQUENCES, Range

PROTOCOL_VERSION: Final = 1
SEVERAL_SAMPLES_VERSION: Final = 2
"""Version with several samples of acceleration in a frame, which an earlier leader refuses."""

FRAMES: Final = "frames"
"""Follower to leader: bytes, 1 to 100 frames."""
END: Final = "end"
"""Follower to leader: ``{"reason": str, "frames": int}``, then the follower disconnects."""
COMMANDS: Final = "commands"
"""Leader to follower: bytes, 1 to 100 commands."""
WELCOME: Final = "welcome"
"""Leader to follower, once after it was accepted: ``{"protocol": int, "clock_id": str,
"session_id": str}``."""
STOP: Final = "stop"
"""Leader to follower: ``{"reason": str}``; the follower is to end."""
REJECTED: Final = "rejected"
"""Leader to follower, once a second for each reason: ``{"text": str, "reason": str,
"times": int}``, why the follower's records are rejected."""
CLOCK: Final = "clock"
"""Follower to leader and back: bytes, the time stamps of `mmt.link.clock_exchange`."""
NETWORK: Final = "network"
"""Leader to follower: the scene's table ``[network]`` as it is now."""

EVENT: Final = "event"
"""Follower to leader: str, a sentence about an event at the follower, for the recording."""

MISSING: Final = "missing"
"""Leader to follower: ``[[int, int], ...]``, ranges of sequence numbers that did not arrive."""
BACKFILL: Final = "backfill"
"""Follower to leader: bytes, 1 to 100 of the frames that are missing."""
GONE: Final = "gone"
"""Follower to leader: ``[[int, int], ...]``, missing frames that the follower no longer has."""
SETTLE: Final = "settle"
"""Follower to leader, before its end: ``{"frames": int}``; acknowledged by ``{"missing": ...}``
with the ranges that did not arrive."""

MAX_RECORDS_PER_MESSAGE: Final = 100
"""Most frames or commands in one message."""
MAX_ANNOTATIONS_BYTES: Final = 65_536
MAX_MESSAGE_BYTES: Final = 131_072
"""A longer WebSocket message closes the link."""
MAX_SENTENCE: Final = 1024
"""Most characters of a refusal."""
MAX_TEXT: Final = 256
"""Most characters of a reason, a source's name or a clock's name."""

MAX_RANGES: Final = 256
"""Most ranges in one message."""
MAX_KEPT_FRAMES: Final = 1_000_000
"""Most frames that a follower may claim to buffer."""

SETTLE_S: Final = 3.0
"""How long a follower that is ending may send missing frames."""
PING_INTERVAL_S: Final = 1
PING_TIMEOUT_S: Final = 3
"""A peer that has not answered a ping for this long is lost."""

_LOSSES: Final = {
    "client disconnect": "it disconnected",
    "server disconnect": "it disconnected",
    "transport close": "the connection was closed",
    "transport error": "the connection was closed",
    "ping timeout": "it no longer answers",
}

Value = TypeVar("Value")

CONNECT_PACKET, MSGPACK_EVENT = 0, 2
"""Types of a Socket.IO packet that connects, and of one that carries an event."""
EVENT_NAMESPACE: Final = "/"


@dataclass(frozen=True)
class FollowerHello:
    """The description that a follower sends of itself when it connects.

    Parameters
    ----------
    channels
        The channels of each frame, put into the frame's order.
    source
        The follower's source: "simulated", "replay", "devices", or another short name.
    rate_hz
        Frames a second.
    frames_per_message
        Frames in a message, 1 to 100.
    annotations
        Opaque bytes that the leader stores with the recording and never decodes.
    extra
        Name of the scene's further event, empty for none.
    clock_id
        Identifies the clock of the frames' times; see `mmt.core.running.process.clock_id`.
    keep_frames
        How many of its newest frames the follower buffers to send again, 0 for none.
    run_id
        Identifies the process: the same process continues its sequence numbers when it
        reconnects, another one starts anew. Empty if unknown.
    samples_per_frame
        Samples of acceleration in a frame, 1 to 10; taken as 1 without that channel.

    Raises
    ------
    InputError
        A value is not allowed.
    """

    channels: tuple[Channel, ...]
    source: str
    rate_hz: int = 1000
    frames_per_message: int = 1
    annotations: bytes = b""
    extra: str = ""
    clock_id: str = field(default_factory=clock_id)
    keep_frames: int = 0
    run_id: str = ""
    samples_per_frame: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", ordered_channels(self.channels))
        for name, least, most in (
            ("samples_per_frame", 1, MOST_SAMPLES),
            ("frames_per_message", 1, MAX_RECORDS_PER_MESSAGE),
            ("keep_frames", 0, MAX_KEPT_FRAMES),
        ):
            if not least <= (value := getattr(self, name)) <= most:
                raise InputError(f"{name} is {value}: allowed is {least} to {most}")
        object.__setattr__(self, "samples_per_frame", samples_per_frame(self.frame_dtype))
        if len(self.annotations) > MAX_ANNOTATIONS_BYTES:
            raise InputError(
                f"annotations are {len(self.annotations)} bytes: "
                f"at most {MAX_ANNOTATIONS_BYTES} are allowed"
            )
        for name in ("source", "clock_id", "run_id", "extra"):
            if len(getattr(self, name)) > MAX_TEXT:
                raise InputError(f"{name} is longer than the {MAX_TEXT} characters allowed")

    @property
    def frame_dtype(self) -> np.dtype[np.void]:
        """Dtype of the follower's frames."""
        return frame_dtype(self.channels, self.samples_per_frame)

    @property
    def protocol(self) -> int:
        """Version of the layout on the wire."""
        return SEVERAL_SAMPLES_VERSION if self.samples_per_frame > 1 else PROTOCOL_VERSION

    def to_auth(self) -> dict[str, object]:
        """Return the ``auth`` of the Socket.IO connection."""
        several = {"samples_per_frame": self.samples_per_frame}
        return {
            "protocol": self.protocol,
            "rate_hz": self.rate_hz,
            "channels": list(self.channels),
            "frames_per_message": self.frames_per_message,
            "source": self.source,
            "clock_id": self.clock_id,
            "keep_frames": self.keep_frames,
            "run_id": self.run_id,
            "annotations": self.annotations,
            **({"extra": self.extra} if self.extra else {}),
            **(several if self.samples_per_frame > 1 else {}),
        }

    @classmethod
    def from_auth(cls, auth: object) -> "FollowerHello":
        """Validate the ``auth`` of a connection, which is not trusted.

        Raises
        ------
        InputError
            The ``auth`` is no hello of a known version; the message is for the follower's user.
        """
        if not isinstance(auth, Mapping):
            raise InputError("the hello is missing: connect with an mmt follower's auth")
        protocol = _read(auth, "protocol", int)
        if protocol not in {PROTOCOL_VERSION, SEVERAL_SAMPLES_VERSION}:
            raise InputError(
                f"the follower speaks link protocol {protocol}, the leader {PROTOCOL_VERSION} and "
                f"{SEVERAL_SAMPLES_VERSION}: install the same version of mmt on both"
            )
        several = protocol == SEVERAL_SAMPLES_VERSION
        channels = _read(auth, "channels", list)
        return cls(
            channels=ordered_channels(str(channel)[:MAX_TEXT] for channel in channels),
            source=peer_text(_read(auth, "source", str), MAX_TEXT + 1),
            rate_hz=_read(auth, "rate_hz", int),
            frames_per_message=_read(auth, "frames_per_message", int),
            annotations=_read(auth, "annotations", bytes),
            clock_id=_read(auth, "clock_id", str),
            keep_frames=_read(auth, "keep_frames", int) if "keep_frames" in auth else 0,
            run_id=_read(auth, "run_id", str) if "run_id" in auth else "",
            extra=_read(auth, "extra", str) if "extra" in auth else "",
            samples_per_frame=_read(auth, "samples_per_frame", int) if several else 1,
        )


@dataclass(frozen=True)
class LinkStatistics:
    """Counts of one side of the link since it was created, over all connections.

    The latencies are None if they are unknown: one-way latencies need a common clock or the
    offset between two clocks, and only the follower measures the round trip.
    """

    frames: int
    """Frames sent (follower) or accepted (leader)."""
    commands: int
    """Commands accepted (follower) or sent (leader)."""
    messages_sent: int
    bytes_sent: int
    dropped: int
    """Frames (follower) or commands (leader) dropped: the queue was full or the link down."""
    messages_received: int
    bytes_received: int
    lost: int
    """Sequence numbers that never arrived, or arrived too late."""
    out_of_order: int
    """Frames or commands that arrived after a newer one and were dropped."""
    repeated: int
    """Frames or commands that arrived twice and were dropped."""
    rejected: dict[str, int]
    """Rejected messages by reason; for reasons such as "not finite", single frames or commands."""
    latency_p50_ms: float | None
    """One way, from the time that a frame or command carries to its arrival."""
    latency_p99_ms: float | None
    latency_max_ms: float | None
    round_trip_p50_ms: float | None
    """From a frame's time to the arrival of a command that echoes it, less the echo's age."""
    round_trip_p99_ms: float | None
    clock: dict[str, float | None] = field(default_factory=dict)
    """The remote clock minus the local one, from exchanged time stamps."""
    emulated: dict[str, int] = field(default_factory=dict)
    """Messages that this side's emulated network received, lost and repeated."""


def encode_event(event: str, payload: object) -> bytes:
    """Return the Engine.IO message of a Socket.IO event with one argument, packed by msgpack."""
    packet = {"type": MSGPACK_EVENT, "data": [event, payload], "nsp": EVENT_NAMESPACE}
    encoded: bytes = msgpack.packb(packet)
    return encoded


def encode_rejection(kind: str, reason: str, times: int, record_bytes: int) -> bytes:
    """Return the message that tells a peer why its records are rejected.

    Parameters
    ----------
    kind
        The event with the rejected records.
    reason
        Reason, as in `LinkStatistics.rejected`.
    times
        Number of rejections since the last such message.
    record_bytes
        Size of a record.
    """
    hints = {
        "not bytes": ": send a Buffer (Node) or an ArrayBuffer (browsers), as the one argument",
        "size": f": records have {record_bytes} bytes each",
    }
    text = f"{kind} rejected: {reason}{hints.get(reason, '')}"
    return encode_event(REJECTED, {"text": text, "reason": reason, "times": times})


def argument_of(arguments: tuple[object, ...]) -> object:
    """Return the one argument of an event, or None if it has none or several."""
    return arguments[0] if len(arguments) == 1 else None


def ranges_of_payload(payload: object) -> list[Range] | None:
    """Return the ranges in the payload of a ``missing`` or ``gone``, or None if malformed."""
    if not isinstance(payload, list) or len(payload) > MAX_RANGES:
        return None
    ranges: list[Range] = []
    for item in payload:
        match item:
            case [int(first), int(stop)] if 0 <= first < stop <= SEQUENCES:
                ranges.append((int(first), int(stop)))
            case _:
                return None
    return ranges


def reason_of(payload: object) -> str | None:
    """Return the reason in the payload of an ``end`` or ``stop``, or None if it has none."""
    if not isinstance(payload, Mapping):
        return None
    reason = payload.get("reason")
    return peer_text(reason) if isinstance(reason, str) else None


def peer_text(text: str, longest: int = MAX_TEXT) -> str:
    """Return a text from the peer without control characters, of bounded length."""
    return printable(text[:longest])


def loss_of(reason: str) -> str:
    """Return in plain words the library's reason for the end of a connection."""
    return _LOSSES.get(reason, reason)


def _read(auth: Mapping[object, object], key: str, kind: type[Value]) -> Value:
    if key not in auth:
        raise InputError(f"the hello lacks {key!r}")
    value = auth[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        raise InputError(
            f"the hello's {key!r} is a {type(value).__name__}: allowed is {kind.__name__}"
        )
    return value
