"""What a scene makes of a run, from its tables alone: parts, channels, bytes on the wire."""

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

from mmt.core.feedback_records import CONTACT, CONTACT_DTYPE, CONTACT_GATHERED, ENERGY, ENERGY_DTYPE
from mmt.core.frames import COMMAND_DTYPE, frame_dtype
from mmt.leader.parts import tasks_of
from mmt.link.protocol import COMMANDS, FRAMES, encode_event
from mmt.scene import Scene, Service


@dataclass(frozen=True)
class SideParts:
    """The parts that concern one service, and the tasks that run in it beside the ticks."""

    runs: tuple[str, ...]
    left_out: tuple[str, ...]
    tasks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stream:
    """What goes one way in the normal case: no tick missed, nothing sent again.

    The headers of WebSocket, TCP and IP, the pings and the time stamps are not in it.
    """

    way: str
    """"up" (follower to leader) or "down"."""
    event: str
    holds: tuple[str, ...]
    record_bytes: int
    """Bytes of a frame or a command."""
    records_per_message: int
    message_bytes: int
    """With Socket.IO's envelope, as the link's statistics count what is sent."""
    messages_per_s: float
    payload_bytes_per_s: float
    """Bytes of the records alone, as the link's statistics count them."""
    bytes_per_s: float


@dataclass(frozen=True)
class SceneDescription:
    """Parts of either service, None where the scene has no follower, and the streams."""

    leader: SideParts
    follower: SideParts | None
    streams: tuple[Stream, ...]
    robot_limits: str | None
    """Where, how fast and how hard the robot may be moved, None where none is."""
    acceleration: str | None
    """Samples of acceleration in a frame and where their band ends, None where there is one."""
    hand_force: str | None
    """Where the hand's force comes from and how late, None where no handle renders."""

    def as_dict(self) -> dict[str, Any]:
        """Return it for a program."""
        return asdict(self)


LEADER: Final[Service] = "leader"
FOLLOWER: Final[Service] = "follower"


def describe_scene(scene: Scene) -> SceneDescription:
    """Return what runs where and what goes over the wire; nothing is started or imported."""
    return SceneDescription(
        leader=_side(scene, LEADER),
        follower=_side(scene, FOLLOWER) if scene.source is not None else None,
        streams=_streams(scene),
        robot_limits=scene.describe_motion_limits(),
        acceleration=scene.describe_acceleration(),
        hand_force=scene.describe_hand_force(),
    )


def _side(scene: Scene, service: Service) -> SideParts:
    concerned = scene.parts(service)
    return SideParts(
        runs=tuple(name for name, runs in concerned.items() if runs),
        left_out=tuple(name for name, runs in concerned.items() if not runs),
        tasks=tasks_of(scene) if service == LEADER else (),
    )


def _streams(scene: Scene) -> tuple[Stream, ...]:
    if scene.link is None:
        return ()
    rate_hz = float(scene.session.rate_hz)
    speed = scene.replay.speed if scene.replay is not None else 1.0
    channels = scene.channels()
    at_once = max(1.0, speed)  # frames that fall due in a tick travel together
    gathered = at_once * math.ceil(scene.link.frames_per_message / at_once)
    frames = _stream(
        "up",
        FRAMES,
        channels,
        frame_dtype(channels, scene.session.samples_per_frame).itemsize,
        gathered,
        rate_hz * speed,
    )
    if not scene.commands:
        return (frames,)
    commands = _stream("down", COMMANDS, ("position",), COMMAND_DTYPE.itemsize, 1.0, rate_hz)
    return (frames, commands, *_feedback_streams(scene, rate_hz))


def _feedback_streams(scene: Scene, rate_hz: float) -> tuple[Stream, ...]:
    """Return what force feedback adds; energies go while there is contact, in every tick."""
    table = scene.force_feedback
    if table is not None and table.method == "passive":
        size = ENERGY_DTYPE.itemsize
        return tuple(
            _stream(way, ENERGY, ("energy",), size, 1.0, rate_hz) for way in ("up", "down")
        )
    if scene.reports_contact:
        holds, size = ("command", "position", "force"), CONTACT_DTYPE.itemsize
        return (_stream("up", CONTACT, holds, size, CONTACT_GATHERED, rate_hz),)
    return ()


def _stream(
    way: str,
    event: str,
    holds: tuple[str, ...],
    record_bytes: int,
    records_per_message: float,
    records_per_s: float,
) -> Stream:
    records = max(1, round(records_per_message))
    message_bytes = len(encode_event(event, bytes(records * record_bytes)))
    messages_per_s = records_per_s / records
    return Stream(
        way=way,
        event=event,
        holds=holds,
        record_bytes=record_bytes,
        records_per_message=records,
        message_bytes=message_bytes,
        messages_per_s=messages_per_s,
        payload_bytes_per_s=records_per_s * record_bytes,
        bytes_per_s=messages_per_s * message_bytes,
    )
