"""Read stored messages of ROS 1 and 2 bags and MCAP files, as far as each file is whole.

A recorder that was killed leaves no index, and the file is then named ``.bag.active``.

A folder's ``metadata.yaml`` is not needed: the files name topics and types themselves.
"""

import bz2
import os
import re
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, Final, NamedTuple

from mmt.core.errors import InputError, short_message
from mmt.core.files.untrusted import require_fetched
from mmt.session.mcap.scan import iterate_mcap, most_bytes
from mmt.session.mcap.writer import FRAMES_TOPIC

_BEGINS: Final = b"#ROSBAG V2.0\n"
_LENGTH: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")
_MESSAGE, _BAG_HEADER, _CHUNK, _CONNECTION = b"\x02", b"\x03", b"\x05", b"\x07"

_Fields = dict[str, bytes]


def _records(stream: BinaryIO) -> Iterator[tuple[_Fields, bytes]]:
    while begin := stream.read(_LENGTH.size):
        head = _fields(_sized(stream, begin))
        length = stream.read(_LENGTH.size)
        if head["op"] != _CHUNK:
            yield head, _sized(stream, length)
        elif head["compression"] != b"none":
            packed = stream.read(*_LENGTH.unpack(length))
            yield from _records(BytesIO(_decompressed(head, packed)))
            if len(packed) < _LENGTH.unpack(length)[0]:
                raise InputError("it ends within a chunk")
        # else the chunk's records follow


def _decompressed(head: _Fields, data: bytes) -> bytes:
    (size,), compression = _LENGTH.unpack(head["size"]), head["compression"]
    if compression == b"bz2":
        return bz2.BZ2Decompressor().decompress(data, size)
    if compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        unpacked: bytes = LZ4FrameDecompressor().decompress(data, max_length=size)
        return unpacked
    return data


def _sized(stream: BinaryIO, length: bytes) -> bytes:
    """Return the bytes that follow their length."""
    if len(length) == _LENGTH.size:
        content = stream.read(*_LENGTH.unpack(length))
        if len(content) == _LENGTH.unpack(length)[0]:
            return content
    raise InputError("it ends within a record")


def _fields(content: bytes) -> _Fields:
    """Return the fields of a header, each ``name=value`` after its length."""
    stream, fields = BytesIO(content), {}
    while length := stream.read(_LENGTH.size):
        name, _, value = _sized(stream, length).partition(b"=")
        fields[name.decode()] = value
    return fields


_PACKED: Final = ".zstd"
_AT_ONCE: Final = 1 << 20
_LATEST_NS: Final = (1 << 63) - 1


class StoredMessage(NamedTuple):
    """A message as it stands in a file."""

    topic: str
    source: int | str
    """The publisher, as far as the file tells publishers apart: its number on its topic."""
    kind: str
    """Name of the message's type."""
    encoding: str
    definition: bytes
    definition_encoding: str
    received_ns: int
    data: bytes

    @property
    def in_si_units(self) -> bool:
        """Whether the type is one of those whose positions are in metres."""
        return self.encoding in {"cdr", "ros1"} or self.kind.startswith("foxglove.")


def stored_messages(path: Path, notes: list[str]) -> Iterator[StoredMessage]:
    """Yield the messages of a bag or an MCAP file; add a note for each file with lost messages.

    Raises
    ------
    InputError
        The folder has no such files.
    Exception
        The only file cannot be read at all.
    """
    inside = sorted(path.glob("[!.]*")) if path.is_dir() else [path]
    files = [file for file in inside if _kind(file) in _READERS]
    if not files:
        raise InputError(
            "this is not a ROS bag: there is no .mcap, .db3 or .bag file in this folder; a LeRobot "
            "data set is the folder that holds meta/info.json"
        )
    notes.extend(_of_lost_files(path, len(files)))
    for file in files:
        read = 0
        try:
            require_fetched(file)
            numbers: dict[str, dict[int | str, int]] = {}
            with _unpacked(file) as plain:
                for message in _READERS[_kind(file)](plain, notes):
                    of_topic = numbers.setdefault(message.topic, {})
                    yield message._replace(
                        source=of_topic.setdefault(message.source, len(of_topic))
                    )
                    read += 1
        except MemoryError:
            raise
        except Exception as error:
            if len(files) == 1 and not read:
                raise
            why = short_message(error).removeprefix(f"session {file}: ")
            kept = f"its first {read} messages were read, no more" if read else "it was left out"
            notes.append(f"{file.name}: {why}; {kept}")


def _of_lost_files(folder: Path, found: int) -> Iterator[str]:
    """Yield a note if a bag's description names more files than there are."""
    described = folder / "metadata.yaml"
    if described.is_file():
        text = described.read_text(encoding="utf-8", errors="replace")
        told = set(re.findall(r"^\s*- \"?(\S+\.(?:mcap|db3)(?:\.zstd)?)\b", text, re.MULTILINE))
        if len(told) > found:
            yield f"the bag has {len(told)} files by its metadata.yaml, of which {found} are here"


def _kind(file: Path) -> str:
    """Return the suffix that tells a file's format, without that of its compression."""
    return Path(file.name.lower().removesuffix(_PACKED)).suffix


@contextmanager
def _unpacked(file: Path) -> Iterator[Path]:
    """Yield a file, or a temporary one with its content if it is compressed as a whole."""
    if file.suffix.lower() != _PACKED:
        yield file
        return
    import zstandard

    with TemporaryDirectory() as folder:
        plain, left = Path(folder, file.stem), most_bytes(file)
        with file.open("rb") as packed, plain.open("wb") as out:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            while chunk := reader.read(_AT_ONCE):
                left -= out.write(chunk)
                if left < 0:
                    raise InputError(
                        f"it unpacks to more than {most_bytes(file) >> 20} MiB; unpack it before "
                        "(zstd -d)"
                    )
        yield plain


def _of_mcap(path: Path, notes: list[str]) -> Iterator[StoredMessage]:
    problems: list[str] = []
    undated = 0
    for schema, channel, message in iterate_mcap(path, problems):
        if channel.topic == FRAMES_TOPIC and schema is not None and "mmt" in schema.name:
            raise InputError("a session of mmt is one as it is, without import")
        if message.log_time > _LATEST_NS:
            undated += 1
            continue
        definition = schema.data if schema is not None else b""
        kind, told = (schema.name, schema.encoding) if schema is not None else ("", "")
        yield StoredMessage(
            *(channel.topic, channel.id, kind, channel.message_encoding),
            *(definition, told, message.log_time, message.data),
        )
    if undated:
        problems.append(f"{undated} messages with impossible times were left out")
    if problems:
        notes.append(f"{path.name}: {', '.join(problems)}; what is whole was read")


def _of_db3(path: Path, _notes: list[str]) -> Iterator[StoredMessage]:
    with _openable(path) as uri, closing(sqlite3.connect(uri, uri=True)) as stored:
        yield from _of_database(stored)


@contextmanager
def _openable(path: Path) -> Iterator[str]:
    """Yield the URI of a database, or of a copy of it that can be opened in its place.

    What a killed recorder wrote last stands in a journal beside, which SQLite moves into the file.
    Of a file that was cut within a page it takes what is missing for zeros.
    """
    with path.open("rb") as stream:
        page = int.from_bytes(stream.read(18)[16:], "big")
    page = 1 << 16 if page == 1 else page
    surplus = path.stat().st_size % page if page else 0
    journal = path.with_name(f"{path.name}-wal")
    if not surplus and not journal.exists():
        yield f"{path.absolute().as_uri()}?immutable=1"
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        shutil.copyfile(path, copy)
        os.truncate(copy, copy.stat().st_size - surplus)
        if journal.exists():
            shutil.copyfile(journal, copy.with_name(journal.name))
        yield f"{copy.as_uri()}?mode=rw"


def _of_database(stored: sqlite3.Connection) -> Iterator[StoredMessage]:
    stored.execute("PRAGMA writable_schema = 1")  # else a file that was cut off is refused
    described = "topic_type, encoded_message_definition, encoding FROM message_definitions"
    try:
        found = stored.execute(f"SELECT {described}")
        definitions = {kind: (text.encode(), language) for kind, text, language in found}
    except sqlite3.Error:  # recorders before Iron wrote none
        definitions = {}
    told = stored.execute("SELECT id, name, type, serialization_format FROM topics")
    topics = {number: texts for number, *texts in told}
    for number, received_ns, data in stored.execute(
        "SELECT topic_id, timestamp, data FROM messages"
    ):
        name, kind, encoding = topics[number]
        definition, language = definitions.get(kind, (b"", ""))
        yield StoredMessage(
            *(name, number, kind, encoding, definition, language, received_ns, bytes(data))
        )


def _of_bag(path: Path, _notes: list[str]) -> Iterator[StoredMessage]:
    """Yield the messages of a ROS 1 bag, each with the name of its node or of its connection."""
    connections: dict[bytes, tuple[str, str, str, str, bytes, str]] = {}
    index_at = b"\0"
    with path.open("rb") as stream:
        if stream.read(len(_BEGINS)) != _BEGINS:
            raise InputError("this is not a ROS 1 bag of format 2.0")
        for head, data in _records(stream):
            number = head.get("conn", b"")
            if head["op"] == _BAG_HEADER:
                index_at = head["index_pos"]
            elif head["op"] == _CONNECTION:
                told = _fields(data)
                publisher = told.get("callerid", number.hex().encode()).decode()
                kind, definition = told["type"].decode(), told["message_definition"]
                topic = head["topic"].decode()
                connections[number] = (topic, publisher, kind, "ros1", definition, "ros1msg")
            elif head["op"] == _MESSAGE and number in connections:
                seconds, rest_ns = _TIME.unpack(head["time"])
                yield StoredMessage(*connections[number], seconds * 1_000_000_000 + rest_ns, data)
        if stream.tell() < int.from_bytes(index_at, "little"):
            raise InputError("it ends before its index")


_READERS: Final[Mapping[str, Callable[[Path, list[str]], Iterator[StoredMessage]]]] = {
    ".mcap": _of_mcap,
    ".db3": _of_db3,
    ".bag": _of_bag,
    ".active": _of_bag,
}
