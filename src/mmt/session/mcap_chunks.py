"""The frames of an MCAP session file in the order of its chunks, without its index in memory."""

import os
import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import IO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk
from mcap.stream_reader import MAGIC_SIZE, get_chunk_data_stream

from mmt.core.errors import InputError
from mmt.session.data import JsonObject
from mmt.session.mcap_reader import DAMAGE, checked_frame_schema, parse_event, parse_json
from mmt.session.mcap_writer import (
    ANNOTATIONS_ATTACHMENT,
    BACKFILL_TOPIC,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    RECOVERY_METADATA,
    SCENE_METADATA,
    SESSION_METADATA,
)

_CHUNKS_TOGETHER: Final = 8
"""Chunks that are decoded at once, some seconds of a session."""
_HEAD: Final = struct.Struct("<BQ")
_CHANNEL_ID: Final = struct.Struct("<H")
_MESSAGE_HEAD: Final = 22
"""Bytes of a message's channel, number and times, before its data."""


class InOrder(NamedTuple):
    """What a session file holds beside its frames; events only where control could change hands."""

    schema: bytes
    scene: JsonObject | None
    annotations: bytes
    complete: bool
    events: Sequence[JsonObject]


def open_in_order(path: Path) -> InOrder | None:
    """Return what a file says of its session, None where it must be read whole.

    That is where it was cut off, where frames came late, or where it is not a session.

    Raises
    ------
    InputError
        The file is a session of a newer version, or its scene is not valid.
    """
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            if summary is None or not summary.chunk_indexes:
                return None
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            attached = [
                a.data for a in reader.iter_attachments() if a.name == ANNOTATIONS_ATTACHMENT
            ]
            text = metadata.get(SCENE_METADATA, {}).get("json")
            scene = None if text is None else parse_json(path, text, "the scene")
            handed_over = scene is not None and "control" in scene
            messages = reader.iter_messages(topics=EVENTS_TOPIC) if handed_over else ()
            events = [parse_event(path, message.data, channel) for _, channel, message in messages]
    except (*DAMAGE, EndOfFile, OSError):
        return None
    schemas = {c.topic: summary.schemas.get(c.schema_id) for c in summary.channels.values()}
    if BACKFILL_TOPIC in schemas:
        return None
    return InOrder(
        checked_frame_schema(path, schemas, metadata.get(SESSION_METADATA, {})),
        scene,
        attached[-1] if attached else b"",
        not metadata.get(RECOVERY_METADATA),
        events,
    )


def frame_payloads(path: Path) -> Iterator[list[bytes]]:
    """Yield the messages with frames, those of some chunks at a time.

    Raises
    ------
    InputError
        The file cannot be read to its end.
    """
    try:
        with path.open("rb") as stream:
            yield from _payloads(stream)
    except (*DAMAGE, EndOfFile, OSError) as error:
        raise InputError(
            f"session {path}: a record cannot be read ({error}); save what is readable with: "
            f"mmt session recover {path}"
        ) from error


def _payloads(stream: IO[bytes]) -> Iterator[list[bytes]]:
    ids: set[int] = set()
    payloads: list[bytes] = []
    for number, chunk in enumerate(_chunks(stream), start=1):
        payloads += _frame_messages(chunk, ids)
        if number % _CHUNKS_TOGETHER == 0:
            yield payloads
            payloads = []
    yield payloads


def _chunks(stream: IO[bytes]) -> Iterator[Chunk]:
    """Yield the chunks of a file; the indexes of their messages are not looked at.

    Here and below, records are taken apart by their lengths: the library reads each number by
    number, which takes as long as much of what is done with a session.
    """
    left = os.fstat(stream.fileno()).st_size - stream.seek(MAGIC_SIZE)
    while True:
        head = stream.read(_HEAD.size)
        opcode, size = _HEAD.unpack(head)
        left -= len(head) + size
        if left < 0:
            raise EndOfFile
        if opcode == Opcode.DATA_END:
            return
        if opcode == Opcode.CHUNK:
            yield Chunk.read(ReadDataStream(BytesIO(stream.read(size))))
        else:
            stream.seek(size, os.SEEK_CUR)


def _frame_messages(chunk: Chunk, ids: set[int]) -> Iterator[bytes]:
    """Yield a chunk's messages with frames; note the channels that it declares for them."""
    reader, length = get_chunk_data_stream(chunk, validate_crc=True)
    data, at = reader.read(length), 0
    while at < length:
        opcode, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + size > length:
            raise EndOfFile
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(data[at : at + size])))
            if channel.topic == FRAMES_TOPIC:
                ids.add(channel.id)
        elif opcode == Opcode.MESSAGE and _CHANNEL_ID.unpack_from(data, at)[0] in ids:
            yield data[at + _MESSAGE_HEAD : at + size]
        at += size
