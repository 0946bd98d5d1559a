"""Describe a scene from its tables alone: parts, channels, bytes on the wire."""

import math
from dataclasses import dataclass
from typing import Final

from mmt.core.frames import (
    COMMAND_DTYPE,
    CONTACT,
    CONTACT_DTYPE,
    CONTACT_GATHERED,
    ENERGY,
    ENERGY_DTYPE,
    frame_dtype,
    missing_band,
)
from mmt.leader.parts import tasks_of
from mmt.link.protocol import COMMANDS, FRAMES, encode_event
from mmt.scene import Scene, Service


@dataclass(frozen=True)
class SideParts:
    """Parts of one service, and its tasks beside the ticks."""

    runs: tuple[str, ...]
    left_out: tuple[str, ...]
    tasks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stream:
    """One kind of message in the normal case, without missed ticks or repeated frames.

    Headers of WebSocket, TCP and IP, pings and exchanges of time stamps are not counted.
    """

    way: str
    """"up" (follower to leader) or "down"."""
    event: str
    holds: tuple[str, ...]
    record_bytes: int
    """Size of a frame or a command."""
    records_per_message: int
    message_bytes: int
    """Size of a message with Socket.IO's envelope, as in the link's statistics of sent bytes."""
    messages_per_s: float
    bytes_per_s: float


@dataclass(frozen=True)
class SceneDescription:
    """Parts of both services, the streams between them, and limits in words."""

    leader: SideParts
    follower: SideParts | None
    streams: tuple[Stream, ...]
    robot_limits: str | None
    """See `Scene.describe_motion_limits`."""
    acceleration: str | None
    """The acceleration in a frame, None for at most one sample per frame."""
    hand_force: str | None
    """See `describe_hand_force`."""


LEADER: Final[Service] = "leader"
FOLLOWER: Final[Service] = "follower"


def describe_scene(scene: Scene) -> SceneDescription:
    """Describe the parts and streams of a scene; nothing is started or imported."""
    return SceneDescription(
        leader=_side(scene, LEADER),
        follower=_side(scene, FOLLOWER) if scene.source is not None else None,
        streams=_streams(scene),
        robot_limits=scene.describe_motion_limits(),
        acceleration=_acceleration(scene),
        hand_force=describe_hand_force(scene),
    )


def _acceleration(scene: Scene) -> str | None:
    """Describe the acceleration in a frame; None for at most one sample per frame."""
    session = scene.session
    if session.samples_per_frame == 1 or "acceleration" not in scene.channels():
        return None
    text = f"{session.samples_per_frame} samples a frame"
    sensor = scene.devices.accelerometer if scene.devices is not None else None
    if sensor is None:
        return text
    board = sensor.options.get("board")
    rate_hz = (board if isinstance(board, dict) else sensor.options).get("rate_hz")
    if not isinstance(rate_hz, int | float):
        return f"{text}; its start says what {sensor.driver} gives"
    band = missing_band(rate_hz, session.acceleration_rate_hz)
    return f"{text}; {sensor.driver} {band}" if band else text


def describe_hand_force(scene: Scene) -> str | None:
    """Describe the source and the delay of the hand's force at a real handle.

    With the hand's motion it drives the rendered vibration. None without handle or rendering.
    """
    handle = scene.handle
    if handle is None or scene.rendering is None:
        return None
    if handle.hand_force == "measured":
        return "measured by the handle, at once"
    if scene.link is None:
        return (
            f"{handle.surface_stiffness_n_mm:g} N/mm below the surface, which is at the "
            "scene's zero or where another leader says, at once"
        )
    network = scene.network
    trip = "a round trip" if network is None else f"about {2.0 * network.delay_ms:g} ms"
    if scene.reports_contact:
        return (
            "by the hand's own motion and the model of the contact, at once; until the first "
            f"touch has shown the surface, or after it has moved, {trip} late"
        )
    return (
        f"the follower's: vibration follows the hand's motion at once, its force {trip} late "
        '(method "passive" tells of energies, "streamed" and "model" let it come at once)'
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
    at_once = max(1.0, speed)  # frames that are due in one tick share a message
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
    """Return the streams of force feedback; energies are sent in every tick during contact."""
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
        bytes_per_s=messages_per_s * message_bytes,
    )
