"""Read everything that is readable in an MCAP file, which may be cut off or damaged.

Reading does not need the index at the end of the file. `Scan.problem` says what is wrong.
"""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from mmt.core.errors import InputError, naming
from mmt.core.files.untrusted import require_fetched
from mmt.session.mcap.records import HEAD, INDEX_DAMAGED, RecordWalk, intact, open_records

MOST_MIB: Final = "MMT_MOST_MIB"
"""Environment variable: size to which a file may unpack, in MiB. `_MOST_RATIO` times the file's
size is always allowed."""
_MOST_MIB: Final = 64
_MOST_RATIO: Final = 50

_READ: Final = {
    *(Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK),
    *(Opcode.MESSAGE, Opcode.ATTACHMENT, Opcode.METADATA),
}

DAMAGE: Final = (
    McapError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
    zstandard.ZstdError,
    RuntimeError,
)
"""Exceptions that damaged bytes raise. The MCAP library's CRC and Unicode errors are ValueErrors,
those of lz4 are RuntimeErrors."""


class ChunkTooLarge(McapError):  # noqa: N818 - the name describes the chunk
    """Raised for a chunk that would unpack to more than is allowed."""


@dataclass
class Scan:
    """Everything that could be read from an MCAP file, in the order of the file.

    One of a file that stays on disk lacks messages, and attachments but the annotations.
    """

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    chunks: int = 0
    """Number of readable chunks."""
    damaged: int = 0
    """Number of unreadable chunks."""
    left_bytes: int = field(init=False)
    """Number of bytes to which further chunks may unpack."""
    too_large: int = 0
    """Number of damaged chunks that would unpack to more than is allowed."""
    damaged_records: int = 0
    """Number of damaged attachments and other records."""
    problem: str = ""
    """What is wrong with the file; empty if nothing is."""

    def __post_init__(self) -> None:
        self.left_bytes = most_bytes(self.path)

    @property
    def whole(self) -> bool:
        """Whether the file has no problem."""
        return not self.problem

    def on_topic(self, topic: str) -> list[Message]:
        """Return the messages of a topic, in the order of the file."""
        ids = {channel.id for channel in self.channels.values() if channel.topic == topic}
        return [message for message in self.messages if message.channel_id in ids]

    def metadata_of(self, name: str) -> dict[str, str]:
        """Return the last metadata record of a name, or {} if there is none."""
        return next((r.metadata for r in self.metadata[::-1] if r.name == name), {})


def scan_mcap(path: Path) -> Scan:
    """Read everything that is readable in an MCAP file.

    Raises
    ------
    InputError
        The file is missing, empty, or not an MCAP file.
    """
    with naming(f"session {path}"), path.open("rb") as stream:
        check_start(path, stream)
        with open_records(stream) as records:
            return _scan(Scan(path), records)


def iterate_mcap(
    path: Path, problems: list[str]
) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """Yield the readable messages of any MCAP file, in the order of the file.

    At the end, problems of the file are appended to `problems`. Some writers (mcap for C++, after a
    second `open`) have a schema in the index alone.

    Raises
    ------
    InputError
        The file is missing, empty or not an MCAP file.
    """
    with naming(f"session {path}"), path.open("rb") as stream:
        check_start(path, stream)
        scan, indexed = Scan(path), None
        with suppress(*DAMAGE, OSError):
            indexed = make_reader(stream).get_summary()
        told = indexed.schemas if indexed else {}
        with open_records(stream) as records:
            for opcode, content, _ in records:
                if opcode not in (Opcode.ATTACHMENT, Opcode.METADATA):
                    _add_content(scan, opcode, content)
                for message in scan.messages:
                    channel = scan.channels.get(message.channel_id)
                    if channel is not None:
                        number = channel.schema_id
                        yield scan.schemas.get(number, told.get(number)), channel, message
                scan.messages.clear()
    problems += [*_problems(scan), *(p for p in records.problems if p != INDEX_DAMAGED)]


def check_start(path: Path, stream: BinaryIO) -> None:
    """Check that a file begins or ends with the magic bytes of MCAP.

    Raises
    ------
    InputError
        The file does neither, or is empty.
    """
    size = os.fstat(stream.fileno()).st_size
    if size == 0:
        raise InputError("the file is empty")
    begins = stream.read(MAGIC_SIZE)
    stream.seek(max(0, size - MAGIC_SIZE))
    if MCAP0_MAGIC not in {begins, stream.read()}:
        require_fetched(path)
        raise InputError("this is not an MCAP file")
    stream.seek(0)


def _scan(scan: Scan, records: RecordWalk) -> Scan:
    attachments = metadata = 0
    for opcode, content, _ in records:
        attachments += opcode == Opcode.ATTACHMENT
        metadata += opcode == Opcode.METADATA
        _add_content(scan, opcode, content)
    count, fewer = records.statistics, []
    if count is not None:
        scan.damaged = max(scan.damaged, count.chunk_count - scan.chunks)
        lost = count.attachment_count - attachments + count.metadata_count - metadata
        scan.damaged_records = max(scan.damaged_records, lost)
        if not scan.damaged and count.message_count != len(scan.messages):
            fewer.append(f"it has {len(scan.messages)} messages of {count.message_count}")
    scan.problem = ", ".join([*fewer, *_problems(scan), *records.problems])
    return scan


def _problems(scan: Scan) -> Iterator[str]:
    if damaged := scan.damaged - scan.too_large:
        yield f"{damaged} damaged chunks"
    if scan.too_large:
        yield (
            f"{scan.too_large} of its chunks would unpack to more than the "
            f"{most_bytes(scan.path) >> 20} MiB that a file of this size may ({MOST_MIB} allows "
            "more)"
        )
    if scan.damaged_records:
        yield f"{scan.damaged_records} other damaged records"


def _add_content(scan: Scan, opcode: int, content: bytes) -> None:
    try:
        if opcode == Opcode.ATTACHMENT and not intact(content):
            scan.damaged_records += 1
        elif opcode in _READ:
            stored = BytesIO(HEAD.pack(opcode, len(content)) + content)
            _add_record(scan, next(StreamReader(stored, skip_magic=True, emit_chunks=True).records))
    except DAMAGE:
        scan.damaged_records += 1


def most_bytes(path: Path) -> int:
    """Return to how many bytes a file's chunks may unpack, far more than any recording needs.

    Raises
    ------
    InputError
        `MOST_MIB` in the environment is not a number of MiB.
    """
    text = os.environ.get(MOST_MIB, str(_MOST_MIB))
    if not text.isdecimal():
        raise InputError(f"{MOST_MIB} is {text!r} in the environment, it must be a number of MiB")
    return max(int(text) << 20, _MOST_RATIO * path.stat().st_size)


def read_index(path: Path, stream: BinaryIO) -> tuple[Any, Any] | None:
    """Return the MCAP library's reader of a file, and the file's summary.

    None if the file has no index, or not of all chunks, or would unpack to more than is allowed.
    """
    reader = make_reader(stream)
    summary = reader.get_summary()
    if summary is None or not summary.chunk_indexes:
        return None
    count = summary.statistics and summary.statistics.chunk_count
    if count is not None and count != len(summary.chunk_indexes):
        return None
    size = sum(index.uncompressed_size for index in summary.chunk_indexes)
    return (reader, summary) if size <= most_bytes(path) else None


def chunk_messages(path: Path, index: ChunkIndex) -> list[Message]:
    """Return the messages of a chunk, given its entry in the file's index.

    Raises
    ------
    Exception
        As in `unpacked`; also if the chunk is larger than its entry says.
    """
    with path.open("rb") as stream:
        stream.seek(index.chunk_start_offset + HEAD.size)
        chunk = Chunk.read(ReadDataStream(stream))
    records = breakup_chunk(unpacked(chunk, index.uncompressed_size), validate_crc=True)
    return [record for record in records if isinstance(record, Message)]


def unpacked(chunk: Chunk, most: int) -> Chunk:
    """Return a chunk, decompressed.

    Raises
    ------
    ChunkTooLarge
        The data, or the size that the chunk declares, exceed `most` bytes.
    Exception
        The chunk is damaged; see `DAMAGE`.
    """
    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression == "zstd":
        size = max(size, zstandard.frame_content_size(data))
    elif chunk.compression != "lz4":
        size = len(data)
    if size > most:
        raise ChunkTooLarge("a chunk unpacks to more than it may")
    if chunk.compression == "zstd":
        data = zstandard.decompress(data, size)
    elif chunk.compression == "lz4":
        frame = LZ4FrameDecompressor()
        data = frame.decompress(data, max_length=size)
        if not frame.eof:
            raise EndOfFile("a chunk is cut off, or larger than it says")
    return replace(chunk, compression="", data=data)


def _scan_chunk(scan: Scan, chunk: Chunk) -> None:
    try:
        whole = unpacked(chunk, scan.left_bytes)
        scan.left_bytes -= len(whole.data)
        records = breakup_chunk(whole, validate_crc=True)
    except DAMAGE as error:
        scan.too_large += isinstance(error, ChunkTooLarge)
        scan.damaged += 1
        return
    scan.chunks += 1
    for record in records:
        _add_record(scan, record)


def _add_record(scan: Scan, record: McapRecord) -> None:
    # Schemas and channels are in a chunk, which has a checksum, and again in the index at the end
    # of the file, where nothing may protect them: keep the first.
    if isinstance(record, Chunk):
        _scan_chunk(scan, record)
    elif isinstance(record, Message):
        scan.messages.append(record)
    elif isinstance(record, Channel):
        scan.channels.setdefault(record.id, record)
    elif isinstance(record, Schema):
        scan.schemas.setdefault(record.id, record)
    elif isinstance(record, Attachment):
        scan.attachments.append(record)
    elif isinstance(record, Metadata):
        scan.metadata.append(record)
