"""The index of an MCAP file's chunks, held small until the end of the file."""

import zlib
from collections.abc import Iterator
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

_TOGETHER: Final = 128
"""Chunks whose records are compressed together; some 0.3 ms."""
_OF_WRITER: Final = "_Writer__chunk_indices"


class _Records:
    """Records that are written as they are."""

    def __init__(self, packed: bytes) -> None:
        self._packed = packed

    def write(self, builder: RecordBuilder) -> None:
        """Append the records to what is built."""
        builder.write(zlib.decompress(self._packed))


class PackedIndex:
    """What the writer keeps of each chunk: 40 bytes in place of the 600 of an object.

    A recording ends a chunk two or three times a second, so that in an hour it is 5 MB less.
    """

    def __init__(self) -> None:
        self._packed: list[_Records] = []
        self._newest: list[ChunkIndex] = []

    def append(self, index: ChunkIndex) -> None:
        """Keep the record of a chunk."""
        self._newest.append(index)
        if len(self._newest) < _TOGETHER:
            return
        builder = RecordBuilder()
        for each in self._newest:
            each.write(builder)
        records: bytes = builder.end()  # type: ignore[no-untyped-call]
        self._packed.append(_Records(zlib.compress(records)))
        self._newest.clear()

    def __iter__(self) -> Iterator[_Records | ChunkIndex]:
        yield from self._packed
        yield from self._newest


def pack_index(writer: Writer) -> None:
    """Have a new writer hold its index packed.

    The library has no setting for it; its list is replaced by name, and kept where a version has
    another name for it.
    """
    if getattr(writer, _OF_WRITER, None) == []:
        setattr(writer, _OF_WRITER, PackedIndex())
