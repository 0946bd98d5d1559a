"""Stream the frames of an MCAP session file in the order of its chunks."""

import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import get_chunk_data_stream

from mmt.core.errors import InputError
from mmt.session.data import JsonObject, json_object
from mmt.session.mcap_reader import frame_codec, recorded_event
from mmt.session.mcap_records import HEAD, RecordWalk, open_records
from mmt.session.mcap_scan import DAMAGE, chunk_messages, most_bytes, read_index, unpacked
from mmt.session.mcap_writer import (
    ANNOTATIONS_ATTACHMENT,
    BACKFILL_TOPIC,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    RECOVERY_METADATA,
    SCENE_METADATA,
    SESSION_METADATA,
)
from mmt.session.messages import FrameCodec

_CHUNKS_TOGETHER: Final = 8
"""Chunks whose messages are yielded together, a few seconds of a session."""
_CHANNEL_ID: Final = struct.Struct("<H")
_MESSAGE_HEAD: Final = 22
"""Bytes of a message before its data: channel, sequence and two times."""


class OrderedContent(NamedTuple):
    """Content of a session file beside its frames; events only if the scene has ``[control]``."""

    codec: FrameCodec
    scene: JsonObject | None
    annotations: bytes
    complete: bool
    events: Sequence[JsonObject]


def open_in_order(path: Path) -> OrderedContent | None:
    """Return a file's content beside its frames, or None if the file must be read whole.

    That is the case if the file was cut off, is damaged, unpacks to too much, or has back-filled
    frames.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version, or its scene is not valid.
    """
    try:
        with path.open("rb") as stream:
            found = read_index(path, stream)
            if found is None:
                return None
            reader, summary = found
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            attached = [
                a.data for a in reader.iter_attachments() if a.name == ANNOTATIONS_ATTACHMENT
            ]
            text = metadata.get(SCENE_METADATA, {}).get("json")
            scene = None if text is None else json_object(text, f"session {path}: the scene")
            handed_over = scene is not None and "control" in scene
            events = _events(path, stream, summary) if handed_over else []
    except (*DAMAGE, OSError):
        return None
    if BACKFILL_TOPIC in (channel.topic for channel in summary.channels.values()):
        return None
    return OrderedContent(
        frame_codec(path, summary.channels, summary.schemas, metadata.get(SESSION_METADATA, {})),
        scene,
        attached[-1] if attached else b"",
        not metadata.get(RECOVERY_METADATA),
        events,
    )


def _events(path: Path, stream: BinaryIO, summary: Any) -> list[JsonObject]:
    channels = {c.id: c for c in summary.channels.values() if c.topic == EVENTS_TOPIC}
    found = list(_on_topic(stream, summary, EVENTS_TOPIC))
    first = next(_on_topic(stream, summary, FRAMES_TOPIC), None)
    start_ns = 0 if first is None else first.log_time
    found.sort(key=attrgetter("log_time"))
    return [
        recorded_event(path, message, channels[message.channel_id], start_ns) for message in found
    ]


def _on_topic(stream: BinaryIO, summary: Any, topic: str) -> Iterator[Message]:
    """Yield the messages on a topic in the order of the file."""
    ids = {channel.id for channel in summary.channels.values() if channel.topic == topic}
    for index in sorted(summary.chunk_indexes, key=attrgetter("chunk_start_offset")):
        if ids & index.message_index_offsets.keys():
            yield from (m for m in chunk_messages(stream, index) if m.channel_id in ids)


def frame_payloads(path: Path) -> Iterator[list[bytes]]:
    """Yield the messages with frames, a few chunks at a time.

    Raises
    ------
    InputError
        The file cannot be read to its end.
    """
    try:
        with path.open("rb") as stream, open_records(stream) as records:
            yield from _payloads(path, records)
            problems = records.problems
    except (*DAMAGE, OSError) as error:
        problems = [f"a record cannot be read ({error})"]
    if problems:
        raise InputError(
            f"session {path}: {', '.join(problems)}; save what is readable with: "
            f"mmt session recover {path}"
        )


def _payloads(path: Path, records: RecordWalk) -> Iterator[list[bytes]]:
    """Yield the messages, without using the message indexes.

    `_frame_messages` splits a chunk into records by their lengths: the MCAP library reads each
    record field by field, which would take much of the time of processing a session.
    """
    ids: set[int] = set()
    payloads: list[bytes] = []
    chunks, left = 0, most_bytes(path)
    for opcode, content, _ in records:
        if opcode == Opcode.CHUNK:
            chunks += 1
            chunk = unpacked(Chunk.read(ReadDataStream(BytesIO(content))), left)
            left -= len(chunk.data)
            payloads += _frame_messages(chunk, ids)
            if chunks % _CHUNKS_TOGETHER == 0:
                yield payloads
                payloads = []
    yield payloads
    if records.statistics is not None and records.statistics.chunk_count != chunks:
        raise EndOfFile("chunks are missing")


def _frame_messages(chunk: Chunk, ids: set[int]) -> Iterator[bytes]:
    """Yield an unpacked chunk's messages with frames; add its channels of frames to `ids`."""
    reader, length = get_chunk_data_stream(chunk, validate_crc=True)
    data, at = reader.read(length), 0
    while at < length:
        opcode, size = HEAD.unpack_from(data, at)
        at += HEAD.size
        if at + size > length:
            raise EndOfFile("it is longer than its chunk")
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(data[at : at + size])))
            if channel.topic == FRAMES_TOPIC:
                ids.add(channel.id)
        elif opcode == Opcode.MESSAGE and _CHANNEL_ID.unpack_from(data, at)[0] in ids:
            yield data[at + _MESSAGE_HEAD : at + size]
        at += size
