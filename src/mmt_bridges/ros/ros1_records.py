"""Read the messages of a ROS 1 bag (format 2.0) from its beginning, without its index.

A recorder that was killed leaves no index, and the file is then named ``.bag.active``.
"""

import bz2
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mmt.core.errors import InputError

_BEGINS: Final = b"#ROSBAG V2.0\n"
_LENGTH: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")
_MESSAGE, _CHUNK, _CONNECTION = b"\x02", b"\x05", b"\x07"

_Fields = dict[str, bytes]


class BagMessage(NamedTuple):
    """A message and what its connection says of it."""

    topic: str
    publisher: str
    """Name of the node, or the connection's number."""
    kind: str
    definition: bytes
    received_ns: int
    data: bytes


def bag_messages(path: Path) -> Iterator[BagMessage]:
    """Yield the messages in the order of the file.

    Raises
    ------
    InputError
        The file is no such bag, or ends within a record.
    """
    connections: dict[bytes, tuple[str, str, str, bytes]] = {}
    with path.open("rb") as stream:
        if stream.read(len(_BEGINS)) != _BEGINS:
            raise InputError("this is not a ROS 1 bag of format 2.0")
        for head, data in _records(stream):
            number = head.get("conn", b"")
            if head["op"] == _CONNECTION:
                told = _fields(data)
                publisher = told.get("callerid", number.hex().encode()).decode()
                kind, definition = told["type"].decode(), told["message_definition"]
                connections[number] = (head["topic"].decode(), publisher, kind, definition)
            elif head["op"] == _MESSAGE and number in connections:
                seconds, rest_ns = _TIME.unpack(head["time"])
                yield BagMessage(*connections[number], seconds * 1_000_000_000 + rest_ns, data)


def _records(stream: BinaryIO) -> Iterator[tuple[_Fields, bytes]]:
    while begin := stream.read(_LENGTH.size):
        head = _fields(_sized(stream, begin))
        length = stream.read(_LENGTH.size)
        if head["op"] != _CHUNK:
            yield head, _sized(stream, length)
        elif head["compression"] != b"none":
            packed = stream.read(*_LENGTH.unpack(length))
            yield from _records(BytesIO(_unpacked(head, packed)))
            if len(packed) < _LENGTH.unpack(length)[0]:
                raise InputError("it ends within a chunk")
        # else the chunk's records follow


def _unpacked(head: _Fields, data: bytes) -> bytes:
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
