"""Decode the session in a scanned MCAP file, which may be cut off or damaged."""

import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Schema
from mcap.well_known import MessageEncoding

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.session.data import (
    JsonObject,
    OutputBlock,
    RecordedSession,
    clock_offset_ns,
    compares_clocks,
    json_object,
)
from mmt.session.mcap.messages import FRAME_BLOCK, FrameCodec, OutputCodec, event_codec
from mmt.session.mcap.scan import Scan, scan_mcap
from mmt.session.mcap.writer import (
    ACCELERATION_RATE,
    ANNOTATIONS_ATTACHMENT,
    BACKFILL_TOPIC,
    EVENTS_TOPIC,
    FORMAT_VERSION,
    FRAMES_TOPIC,
    MODEL_MEDIA_TYPE,
    OUTPUT_TOPIC,
    RECOVERY_METADATA,
    SCENE_METADATA,
    SESSION_METADATA,
    UTC_OFFSET,
)


def read_mcap(path: Path) -> RecordedSession:
    """Read a session file; 18 s of frames take about 30 ms.

    Raises
    ------
    InputError
        The file is missing, not a session, of a newer version, cut off or damaged. In the last
        two cases the message says how to recover it.
    """
    scan = scan_mcap(path)
    if not scan.whole:
        raise InputError(
            f"session {path}: {scan.problem}; save what is readable with: "
            f"mmt session recover {path}"
        )
    return scanned_session(scan)


def scanned_session(scan: Scan) -> RecordedSession:
    """Return the session in a scan, also if the file was cut off or damaged.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version.
    """
    blocks = scan.on_topic(FRAMES_TOPIC)
    start_ns = blocks[0].log_time if blocks else 0
    annotations = [a.data for a in scan.attachments if a.name == ANNOTATIONS_ATTACHMENT]
    models = [a for a in scan.attachments if a.media_type == MODEL_MEDIA_TYPE]
    scene = scan.metadata_of(SCENE_METADATA).get("json")
    about = scan.metadata_of(SESSION_METADATA)
    frames = scanned_frames(scan)
    events = [
        recorded_event(scan.path, message, scan.channels[message.channel_id], start_ns)
        for message in scan.on_topic(EVENTS_TOPIC)
    ]
    return RecordedSession(
        frames=frames,
        scene=None if scene is None else json_object(scene, f"session {scan.path}: the scene"),
        annotations=annotations[-1] if annotations else b"",
        models=[((model.log_time - start_ns) / 1e9, model.data) for model in models],
        events=events,
        outputs=_outputs(scan, start_ns),
        path=scan.path,
        session_id=about.get("session_id"),
        began_utc_ns=_began_utc_ns(utc_offset_ns(about), start_ns, frames, events),
        complete=scan.whole and not scan.metadata_of(RECOVERY_METADATA),
    )


def scanned_frames(scan: Scan) -> RecordArray:
    """Return the frames (n,) in a scan; back-filled ones are sorted in by sequence.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version.
    """
    if not scan.channels and not scan.whole:
        raise InputError(f"session {scan.path}: nothing in it can be read: {scan.problem}")
    about = scan.metadata_of(SESSION_METADATA)
    codec = frame_codec(scan.path, scan.channels, scan.schemas, about)
    frames = codec.decode([block.data for block in scan.on_topic(FRAMES_TOPIC)])
    late = scan.on_topic(BACKFILL_TOPIC)
    if not late:
        return frames
    filled = np.concatenate([frames, codec.decode([block.data for block in late])])
    return filled[np.argsort(filled["sequence"], kind="stable")]


def utc_offset_ns(metadata: Mapping[str, str]) -> int | None:
    """Return UTC minus the recording machine's clock, or None if the file has no date."""
    text = metadata.get(UTC_OFFSET, "")
    return int(text) if re.fullmatch(r"-?[0-9]{1,20}", text) else None


def _began_utc_ns(
    utc_ahead_ns: int | None, start_ns: int, frames: RecordArray, events: Sequence[JsonObject]
) -> int | None:
    """Return when the first frame was measured, or None in a file without a date.

    The messages of a live recording have the time of arrival. The first comparison of the clocks
    says when a frame was measured; without one it is taken to be measured when it arrived.
    """
    if utc_ahead_ns is None:
        return None
    before_jump = itertools.takewhile(lambda event: "clock_step_ns" not in event, events)
    clock = next(filter(compares_clocks, before_jump), None)
    if clock is None or len(frames) == 0:
        return start_ns
    measured_ns = int(frames["time_ns"][0])
    if start_ns - utc_ahead_ns == measured_ns:  # the messages' times are by the follower's clock
        return start_ns
    offset_ns = clock_offset_ns(clock, measured_ns - int(clock["clock_offset_ns"]))
    return measured_ns - int(offset_ns) + utc_ahead_ns


def _outputs(scan: Scan, start_ns: int) -> list[OutputBlock]:
    messages = scan.on_topic(OUTPUT_TOPIC)
    used = (scan.channels[message.channel_id].schema_id for message in messages)
    schema = scan.schemas.get(next(used, 0))
    if schema is None:
        return []
    codec = OutputCodec(schema.data)
    return [
        output_block(scan.path, codec, message, scan.channels[message.channel_id], start_ns)
        for message in messages
    ]


def output_block(
    path: Path, codec: OutputCodec, message: Message, channel: Channel, start_ns: int
) -> OutputBlock:
    """Decode a message with the leader's output; `start_ns` is session time zero.

    Raises
    ------
    InputError
        The message does not parse, or its channel has an invalid rate.
    """
    mode, vibration_m_s2 = codec.decode(message.data)
    time_s = (message.log_time - start_ns) / 1e9
    return OutputBlock(time_s, mode, vibration_m_s2, _samples_per_frame(path, channel))


def frame_codec(
    path: Path,
    channels: Mapping[int, Channel],
    schemas: Mapping[int, Schema],
    metadata: Mapping[str, str],
) -> FrameCodec:
    """Return the codec for a file's frames, from its channels, schemas and session metadata.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version.
    """
    by_topic = {channel.topic: channel for channel in channels.values()}
    channel = by_topic.get(FRAMES_TOPIC)
    schema = None if channel is None else schemas.get(channel.schema_id)
    if channel is None or schema is None or schema.name != FRAME_BLOCK:
        raise InputError(
            f"session {path}: an MCAP file without the topic {FRAMES_TOPIC} of "
            f"{FRAME_BLOCK}; its topics: {', '.join(sorted(by_topic)) or 'none'}"
        )
    version = metadata.get("format_version", "1")
    if not version.isdecimal() or int(version) > FORMAT_VERSION:
        raise InputError(
            f"session {path}: format version {version}, this program reads up to "
            f"{FORMAT_VERSION}; update mmt-haptics"
        )
    return FrameCodec(bytes(schema.data), _samples_per_frame(path, channel))


def _samples_per_frame(path: Path, channel: Channel) -> int:
    """Return the samples of acceleration, or of the output, per frame."""
    text = channel.metadata.get(ACCELERATION_RATE, "1000")
    if not re.fullmatch(r"([1-9]|10)000", text):
        raise InputError(
            f"session {path}: {ACCELERATION_RATE} of {channel.topic} is {text!r}, it must be a "
            "multiple of 1000, to 10000"
        )
    return int(text) // 1000


def parse_event(path: Path, data: bytes, channel: Channel) -> dict[str, Any]:
    """Decode an event of any format version: JSON, or a Protobuf message that holds JSON.

    Raises
    ------
    InputError
        The event does not parse.
    """
    json_encoded = channel.message_encoding == MessageEncoding.JSON
    text = data if json_encoded else event_codec().decode(data)
    return json_object(text, f"session {path}: an event")


def recorded_event(path: Path, message: Message, channel: Channel, start_ns: int) -> JsonObject:
    """Decode an event; its ``time_s`` becomes the time since the first frame, at `start_ns`.

    In a recording that began in mid-session it was later than that.

    Raises
    ------
    InputError
        The event does not parse.
    """
    event = parse_event(path, message.data, channel)
    return {**event, "time_s": max(0.0, (message.log_time - start_ns) / 1e9)}
