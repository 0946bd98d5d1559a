"""Decode the session in a scanned MCAP file, which may be cut off or damaged."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Message
from mcap.well_known import MessageEncoding

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.files.untrusted import json_object
from mmt.session.data import (
    JsonObject,
    OutputBlock,
    RecordedSession,
    clock_offset_ns,
    compares_clocks,
)
from mmt.session.mcap.messages import FRAME_BLOCK, FrameCodec, OutputCodec, event_text
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
        The file is not a session, of several sessions, or of a newer version.
    """
    begun = scan.on_topic(FRAMES_TOPIC) or scan.messages  # if the follower never came: events
    start_ns = begun[0].log_time if begun else 0
    models = [a for a in scan.attachments if a.media_type == MODEL_MEDIA_TYPE]
    frames = scanned_frames(scan)
    events = [recorded_event(scan, message, start_ns) for message in scan.on_topic(EVENTS_TOPIC)]
    codec, outputs = output_codec(scan), scan.on_topic(OUTPUT_TOPIC)
    return RecordedSession(
        frames=frames,
        scene=scene_of(scan),
        annotations=annotations_of(scan),
        models=[((model.log_time - start_ns) / 1e9, model.data) for model in models],
        events=events,
        outputs=[output_block(scan, codec, each, start_ns) for each in outputs] if codec else [],
        path=scan.path,
        session_id=scan.metadata_of(SESSION_METADATA).get("session_id"),
        began_utc_ns=_began_utc_ns(utc_offset_ns(scan), start_ns, frames, events),
        complete=is_complete(scan),
    )


def scanned_frames(scan: Scan) -> RecordArray:
    """Return the frames (n,) in a scan; back-filled ones are sorted in by sequence.

    Raises
    ------
    InputError
        The file is not a session, of several sessions, or of a newer version.
    """
    if not scan.channels and not scan.whole:
        raise InputError(f"session {scan.path}: nothing in it can be read: {scan.problem}")
    codec = frame_codec(scan)
    frames = codec.decode([block.data for block in scan.on_topic(FRAMES_TOPIC)])
    late = scan.on_topic(BACKFILL_TOPIC)
    if not late:
        return frames
    filled = np.concatenate([frames, codec.decode([block.data for block in late])])
    return filled[np.argsort(filled["sequence"], kind="stable")]


def scene_of(scan: Scan) -> JsonObject | None:
    """Return the scene, or None if the file has none; an `InputError` if it is not valid."""
    scene = scan.metadata_of(SCENE_METADATA).get("json")
    return None if scene is None else json_object(scene, f"session {scan.path}: the scene")


def annotations_of(scan: Scan) -> bytes:
    """Return the follower's last annotations."""
    return next((a.data for a in scan.attachments[::-1] if a.name == ANNOTATIONS_ATTACHMENT), b"")


def is_complete(scan: Scan) -> bool:
    """Return whether the file is whole, and was never recovered."""
    return scan.whole and not scan.metadata_of(RECOVERY_METADATA)


def utc_offset_ns(scan: Scan) -> int | None:
    """Return UTC minus the recording machine's clock, or None if the file has no date."""
    text = scan.metadata_of(SESSION_METADATA).get(UTC_OFFSET, "")
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


def output_codec(scan: Scan) -> OutputCodec | None:
    """Return the codec of the leader's output, or None if the file has none."""
    of_topics = {channel.topic: channel.schema_id for channel in scan.channels.values()}
    schema = scan.schemas.get(of_topics.get(OUTPUT_TOPIC, 0))
    return None if schema is None else OutputCodec(schema.data)


def output_block(scan: Scan, codec: OutputCodec, message: Message, start_ns: int) -> OutputBlock:
    """Decode a message with the leader's output; `start_ns` is session time zero.

    Raises
    ------
    InputError
        The message does not parse, or its channel has an invalid rate.
    """
    mode, vibration_m_s2 = codec.decode(message.data)
    time_s = (message.log_time - start_ns) / 1e9
    channel = scan.channels[message.channel_id]
    return OutputBlock(time_s, mode, vibration_m_s2, _samples_per_frame(scan.path, channel))


def frame_codec(scan: Scan) -> FrameCodec:
    """Return the codec for a file's frames.

    Raises
    ------
    InputError
        The file is not a session, of several sessions, or of a newer version.
    """
    path, topics = scan.path, sorted({channel.topic for channel in scan.channels.values()})
    of_frames = [channel for channel in scan.channels.values() if channel.topic == FRAMES_TOPIC]
    schemas = [scan.schemas.get(channel.schema_id) for channel in of_frames]
    layouts = {bytes(each.data) for each in schemas if each and each.name == FRAME_BLOCK}
    if not layouts:
        raise InputError(
            f"session {path}: an MCAP file without the topic {FRAMES_TOPIC} of "
            f"{FRAME_BLOCK}; its topics: {', '.join(topics) or 'none'}"
        )
    about = scan.metadata_of(SESSION_METADATA)
    told = [each.metadata for each in scan.metadata if each.name == SESSION_METADATA]
    if len(layouts) > 1 or any(each != about for each in told):  # as after ``mcap merge``
        raise InputError(
            f"session {path}: it was merged of several recordings, whose frames are not told "
            "apart; read each by itself"
        )
    version = about.get("format_version", "1")
    if version.isdecimal() and int(version) > FORMAT_VERSION:  # else damaged: it has no checksum
        raise InputError(
            f"session {path}: format version {version}, this program reads up to "
            f"{FORMAT_VERSION}; update mmt-haptics"
        )
    return FrameCodec(layouts.pop(), _samples_per_frame(path, of_frames[0]))


def _samples_per_frame(path: Path, channel: Channel) -> int:
    """Return the samples of acceleration, or of the output, per frame."""
    text = channel.metadata.get(ACCELERATION_RATE, "1000")
    if not re.fullmatch(r"([1-9]|10)000", text):
        raise InputError(
            f"session {path}: {ACCELERATION_RATE} of {channel.topic} is {text!r}, it must be a "
            "multiple of 1000, to 10000"
        )
    return int(text) // 1000


def parse_event(scan: Scan, message: Message) -> dict[str, Any]:
    """Decode an event of any format version: JSON, or a Protobuf message that holds JSON.

    Raises
    ------
    InputError
        The event does not parse.
    """
    encoding, data = scan.channels[message.channel_id].message_encoding, message.data
    text = data if encoding == MessageEncoding.JSON else event_text(data)
    return json_object(text, f"session {scan.path}: an event")


def recorded_event(scan: Scan, message: Message, start_ns: int) -> JsonObject:
    """Decode an event; its ``time_s`` becomes the time since the first frame, at `start_ns`.

    In a recording that began in mid-session it was later than that.

    Raises
    ------
    InputError
        The event does not parse.
    """
    event = parse_event(scan, message)
    return {**event, "time_s": max(0.0, (message.log_time - start_ns) / 1e9)}
