"""Compressed index of an MCAP file's chunks, to save memory while the file is written."""

import zlib
from collections.abc import Iterator
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

_TOGETHER: Final = 128
"""Number of index records that are compressed together, in about 0.3 ms."""
_OF_WRITER: Final = "_Writer__chunk_indices"


class _Records:
    """Compressed index records."""

    def __init__(self, packed: bytes) -> None:
        self._packed = packed

    def write(self, builder: RecordBuilder) -> None:
        """Append the decompressed records to the builder."""
        builder.write(zlib.decompress(self._packed))


class PackedIndex:
    """List of index records for the MCAP writer: 40 bytes per chunk instead of 600 for an object.

    A recording ends two or three chunks a second, so this saves 5 MB per hour.
    """

    def __init__(self) -> None:
        self._packed: list[_Records] = []
        self._newest: list[ChunkIndex] = []

    def append(self, index: ChunkIndex) -> None:
        """Add the index record of a chunk."""
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
    """Make a new MCAP writer compress its index.

    The library has no setting for this, so its private list is replaced. If a version of the
    library names the list differently, nothing is changed.
    """
    if getattr(writer, _OF_WRITER, None) == []:
        setattr(writer, _OF_WRITER, PackedIndex())
