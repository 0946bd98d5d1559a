"""Read a session file, whole or cut off, in one pass from its beginning.

Reading does not need the index at the end of the file, so a file that lacks it is read as
far as it goes: `scan_mcap` says how far that is, and what is wrong.
"""

import json
import os
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, BinaryIO, Final

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, UnsupportedCompressionError
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk, read_magic
from mcap.well_known import MessageEncoding

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.session.data import JsonObject, OutputBlock, RecordedSession
from mmt.session.mcap_writer import (
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
from mmt.session.messages import FRAME_BLOCK, FrameCodec, OutputCodec, event_codec

DAMAGE: Final = (McapError, struct.error, ValueError, zstandard.ZstdError)
"""What the MCAP library raises on damaged bytes; its CRC and Unicode errors are ValueErrors."""


@dataclass
class Scan:
    """Everything that could be read from an MCAP file, in the order of the file."""

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    chunks: int = 0
    """Chunks that were read."""
    damaged: int = 0
    """Chunks that are whole in length but not in content."""
    problem: str = ""
    """Why the file could not be read to its end; empty where it could."""

    @property
    def whole(self) -> bool:
        """Whether nothing is missing."""
        return not self.problem and not self.damaged

    def on_topic(self, topic: str) -> list[Message]:
        """Return the messages of a topic, in the order in which they were written."""
        ids = {channel.id for channel in self.channels.values() if channel.topic == topic}
        return [message for message in self.messages if message.channel_id in ids]

    def schema_of(self, topic: str) -> Schema | None:
        """Return the schema of a topic, None where the file has no such topic."""
        for channel in self.channels.values():
            if channel.topic == topic:
                return self.schemas.get(channel.schema_id)
        return None

    def metadata_of(self, name: str) -> dict[str, str]:
        """Return the last metadata record of a name, empty where there is none."""
        found: dict[str, str] = {}
        for record in self.metadata:
            if record.name == name:
                found = record.metadata
        return found


class _WholeReads:
    """A file whose reads return all that was asked for or end the file.

    The MCAP library takes a short read for a short record; a length from damaged bytes
    must not allocate more than the file holds.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._left = os.fstat(stream.fileno()).st_size - stream.tell()

    def read(self, length: int = -1) -> bytes:
        if length > self._left:
            raise EndOfFile
        data = self._stream.read(length)
        self._left -= len(data)
        return data


def scan_mcap(path: Path) -> Scan:
    """Read everything that is readable in an MCAP file.

    Raises
    ------
    InputError
        The file is missing, empty, or not an MCAP file.
    """
    try:
        with path.open("rb") as stream:
            _check_start(path, stream)
            return _scan(Scan(path), stream)
    except OSError as error:
        raise InputError(f"session {path}: {error.strerror or error}") from error


def _check_start(path: Path, stream: BinaryIO) -> None:
    if os.fstat(stream.fileno()).st_size == 0:
        raise InputError(f"session {path}: the file is empty")
    try:
        read_magic(ReadDataStream(stream))
    except (McapError, struct.error) as error:
        raise InputError(f"session {path}: this is not an MCAP file") from error
    stream.seek(0)


def _scan(scan: Scan, stream: BinaryIO) -> Scan:
    whole: IO[bytes] = _WholeReads(stream)  # type: ignore[assignment]  # it only calls read
    try:
        for record in StreamReader(whole, emit_chunks=True).records:
            if isinstance(record, Chunk):
                _scan_chunk(scan, record)
            else:
                _add_record(scan, record)
    except EndOfFile:
        scan.problem = "it ends before it was finished"
    except DAMAGE as error:
        scan.problem = f"a record cannot be read ({error})"
    return scan


def _scan_chunk(scan: Scan, chunk: Chunk) -> None:
    try:
        records = breakup_chunk(chunk, validate_crc=True)
    except UnsupportedCompressionError as error:
        raise InputError(
            f"session {scan.path}: {error}; install the Python package lz4 to read it"
        ) from error
    except DAMAGE:
        scan.damaged += 1
        return
    scan.chunks += 1
    for record in records:
        _add_record(scan, record)


def _add_record(scan: Scan, record: McapRecord) -> None:
    # Schemas and channels stand in a chunk, under its checksum, and again in the index at the
    # end, under none: the first counts.
    if isinstance(record, Message):
        scan.messages.append(record)
    elif isinstance(record, Channel):
        scan.channels.setdefault(record.id, record)
    elif isinstance(record, Schema):
        scan.schemas.setdefault(record.id, record)
    elif isinstance(record, Attachment):
        scan.attachments.append(record)
    elif isinstance(record, Metadata):
        scan.metadata.append(record)


def read_mcap(path: Path) -> RecordedSession:
    """Read a session file.

    18 s of frames take about 30 ms.

    Raises
    ------
    InputError
        The file is missing, of another kind, of a newer version, or was cut off or
        damaged; then the message says how to recover it.
    """
    scan = scan_mcap(path)
    if not scan.whole:
        damage = scan.problem or f"{scan.damaged} damaged chunks"
        raise InputError(
            f"session {path}: {damage}; save what is readable with: mmt session recover {path}"
        )
    return scanned_session(scan)


def scanned_session(scan: Scan) -> RecordedSession:
    """Return the session that a scan holds, whether the file was whole or not.

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
    return RecordedSession(
        frames=scanned_frames(scan),
        scene=None if scene is None else parse_json(scan.path, scene, "the scene"),
        annotations=annotations[-1] if annotations else b"",
        models=[((model.log_time - start_ns) / 1e9, model.data) for model in models],
        events=[_event(scan, message, start_ns) for message in scan.on_topic(EVENTS_TOPIC)],
        outputs=_outputs(scan, start_ns),
        path=scan.path,
        session_id=about.get("session_id"),
        began_utc_ns=None if utc_offset_ns(about) is None else start_ns,
        complete=scan.whole and not scan.metadata_of(RECOVERY_METADATA),
    )


def scanned_frames(scan: Scan) -> RecordArray:
    """Return the frames (n,) that a scan holds, back-filled ones included, by sequence.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version.
    """
    _check_kind(scan)
    schema = scan.schema_of(FRAMES_TOPIC)
    codec = FrameCodec(schema.data if schema else b"")
    frames = codec.decode([block.data for block in scan.on_topic(FRAMES_TOPIC)])
    late = scan.on_topic(BACKFILL_TOPIC)
    if not late:
        return frames
    filled = np.concatenate([frames, codec.decode([block.data for block in late])])
    return filled[np.argsort(filled["sequence"], kind="stable")]


def _check_kind(scan: Scan) -> None:
    if not scan.channels and not scan.whole:
        raise InputError(
            f"session {scan.path}: nothing in it can be read: {scan.problem or 'it is damaged'}"
        )
    schemas = {c.topic: scan.schemas.get(c.schema_id) for c in scan.channels.values()}
    checked_frame_schema(scan.path, schemas, scan.metadata_of(SESSION_METADATA))


def _event(scan: Scan, message: Message, start_ns: int) -> JsonObject:
    event = parse_event(scan.path, message.data, scan.channels[message.channel_id])
    return {"time_s": (message.log_time - start_ns) / 1e9, **event}


def utc_offset_ns(metadata: Mapping[str, str]) -> int | None:
    """Return UTC minus the recording machine's clock, None in a file that has no date."""
    text = metadata.get(UTC_OFFSET, "")
    return int(text) if re.fullmatch(r"-?[0-9]{1,20}", text) else None


def _outputs(scan: Scan, start_ns: int) -> list[OutputBlock]:
    messages = scan.on_topic(OUTPUT_TOPIC)
    schema = scan.schema_of(OUTPUT_TOPIC)
    if schema is None or not messages:
        return []
    codec = OutputCodec(schema.data)
    return [OutputBlock((m.log_time - start_ns) / 1e9, *codec.decode(m.data)) for m in messages]


def checked_frame_schema(
    path: Path, schemas: Mapping[str, Schema | None], metadata: Mapping[str, str]
) -> bytes:
    """Return the schema of a file's frames, from its schemas by topic and the session's metadata.

    Raises
    ------
    InputError
        The file is not a session, or of a newer version.
    """
    schema = schemas.get(FRAMES_TOPIC)
    if schema is None or schema.name != FRAME_BLOCK:
        raise InputError(
            f"session {path}: an MCAP file without the topic {FRAMES_TOPIC} of "
            f"{FRAME_BLOCK}; its topics: {', '.join(sorted(schemas)) or 'none'}"
        )
    version = metadata.get("format_version", "1")
    if not version.isdecimal() or int(version) > FORMAT_VERSION:
        raise InputError(
            f"session {path}: format version {version}, this program reads up to "
            f"{FORMAT_VERSION}; update mmt-haptics"
        )
    return bytes(schema.data)


def parse_event(path: Path, data: bytes, channel: Channel) -> dict[str, Any]:
    """Return an event of any version: JSON, or a Protobuf message that holds it.

    Raises
    ------
    InputError
        It cannot be read.
    """
    json_encoded = channel.message_encoding == MessageEncoding.JSON
    return parse_json(path, data if json_encoded else event_codec().decode(data), "an event")


def parse_json(path: Path, text: str | bytes, what: str) -> dict[str, Any]:
    """Return a JSON object out of a file.

    Raises
    ------
    InputError
        The text is not a JSON object.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"session {path}: {what} is not valid JSON: {error}") from error
    if not isinstance(value, dict):
        raise InputError(f"session {path}: {what} is not a JSON object")
    return value
