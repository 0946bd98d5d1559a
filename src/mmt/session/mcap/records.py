"""Iterate over the records of an MCAP file, skipping damaged ones.

A record with an inconsistent head or length is skipped. The walk continues at the next bytes whose
lengths form a record.
"""

import mmap
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Statistics
from mcap.stream_reader import MAGIC_SIZE
from mcap.writer import MCAP0_MAGIC

HEAD: Final = struct.Struct("<BQ")
"""Opcode and length of a record."""

INDEX_DAMAGED: Final = "its index is damaged"
"""The problem of a file whose index is unusable; files of other programs may have no index."""

_CHECKSUM: Final = struct.Struct("<I")
_FOOTER: Final = struct.Struct("<QQI")
_FOOTER_BYTES: Final = HEAD.size + _FOOTER.size
_SIZES: Final = {"B": 1, "H": 2, "I": 4, "Q": 8, "s": 4, "S": 8}
_LAYOUTS: Final = {
    Opcode.HEADER: "ss",
    Opcode.FOOTER: "QQI",
    Opcode.SCHEMA: "Hsss",
    Opcode.CHANNEL: "HHsss",
    Opcode.CHUNK: "QQQIsS",
    Opcode.MESSAGE: "HIQQ*",
    Opcode.MESSAGE_INDEX: "Hs",
    Opcode.CHUNK_INDEX: "QQQQsQsQQ",
    Opcode.ATTACHMENT: "QQssSI",
    Opcode.ATTACHMENT_INDEX: "QQQQQss",
    Opcode.STATISTICS: "QHIIIIQQs",
    Opcode.METADATA: "ss",
    Opcode.METADATA_INDEX: "QQs",
    Opcode.SUMMARY_OFFSET: "BQQ",
    Opcode.DATA_END: "I",
}
"""Fields of each record: numbers, bytes after a length of four (s) or eight bytes (S), and the
rest of the record (*)."""
_PRIVATE: Final = 0x80
"""First opcode of records that other programs define."""
_MAY_BEGIN: Final = re.compile(rb"(?=[\x01-\x0f].{4}\0{4})", re.DOTALL)
"""Matches the possible beginning of a record of less than 4 GB."""
_AT_ONCE: Final = 1 << 24
"""Bytes per step of a checksum."""


class McapRecord(NamedTuple):
    """A record and its offset in the file."""

    opcode: int
    content: bytes
    at: int


class RecordWalk:
    """Iterates over the records of an MCAP file.

    Parameters
    ----------
    data
        The file, which may be mapped into memory.

    Attributes
    ----------
    statistics
        Counts of records from the file's index, or None if the index cannot be read.
    problems
        Problems of the file, complete after the iteration.
    """

    def __init__(self, data: memoryview) -> None:
        self._data = data
        self.statistics: Statistics | None = None
        self.problems: list[str] = []

    def __iter__(self) -> Iterator[McapRecord]:
        at, ended, indexed = MAGIC_SIZE, False, self._is_indexed()
        damaged = int(self._data[:MAGIC_SIZE] != MCAP0_MAGIC)
        while not ended and at + HEAD.size <= len(self._data):
            record = self._record(at)
            if record is None:
                damaged += 1
                at = self._next(at + 1)
                continue
            yield record
            if record.opcode == Opcode.CHUNK:
                self._leave()
            elif record.opcode == Opcode.DATA_END:
                self._check_data(record)
            elif record.opcode == Opcode.STATISTICS and indexed:
                self.statistics = Statistics.read(ReadDataStream(BytesIO(record.content)))
            ended = record.opcode == Opcode.FOOTER
            at += HEAD.size + len(record.content)
        if damaged:
            self.problems.append(f"it is damaged at {damaged} places or more")
        if not ended or self._data[at:] != MCAP0_MAGIC:
            self.problems.append("it ends before it was finished")
        elif not indexed:
            self.problems.append(INDEX_DAMAGED)

    def _head(self, at: int) -> tuple[int, int]:
        opcode, length = HEAD.unpack_from(self._data, at)
        return opcode, length

    def _record(self, at: int) -> McapRecord | None:
        """Return the record at an offset, or None if there is no valid one."""
        opcode, length = self._head(at)
        begin = at + HEAD.size
        if length > len(self._data) - begin or (at == MAGIC_SIZE and opcode != Opcode.HEADER):
            return None
        content = self._data[begin : begin + length]
        return McapRecord(opcode, bytes(content), at) if _fits(opcode, content) else None

    def _next(self, at: int) -> int:
        """Return the offset of the next record, or the file's length if there is none."""
        for found in _MAY_BEGIN.finditer(self._data, at):
            place = found.start()
            # almost any bytes would pass as a message
            if self._data[place] != Opcode.MESSAGE and self._record(place) is not None:
                return place
        return len(self._data)

    def _check_data(self, end: McapRecord) -> None:
        (checksum,), found = _CHECKSUM.unpack(end.content), 0
        if checksum == 0:
            return
        for at in range(0, end.at, _AT_ONCE):
            found = zlib.crc32(self._data[at : min(at + _AT_ONCE, end.at)], found)
            self._leave()
        if checksum != found:
            self.problems.append("its checksum does not fit")

    def _leave(self) -> None:
        """Release the pages of a mapped file, which count as memory of this process."""
        mapped = self._data.obj
        if isinstance(mapped, mmap.mmap) and hasattr(mapped, "madvise"):
            mapped.madvise(mmap.MADV_DONTNEED)

    def _is_indexed(self) -> bool:
        """Return whether the file ends with an index whose checksum is right."""
        footer = len(self._data) - MAGIC_SIZE - _FOOTER_BYTES
        if footer < MAGIC_SIZE or self._head(footer) != (Opcode.FOOTER, _FOOTER.size):
            return False
        start, _, checksum = _FOOTER.unpack_from(self._data, footer + HEAD.size)
        covered = self._data[start : footer + _FOOTER_BYTES - _CHECKSUM.size]
        return bool(MAGIC_SIZE < start <= footer and checksum == zlib.crc32(covered))


@contextmanager
def open_records(stream: BinaryIO) -> Iterator[RecordWalk]:
    """Map a non-empty file into memory for the block, and yield its records."""
    with (
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as mapped,
        memoryview(mapped) as data,
    ):
        yield RecordWalk(data)


def problems_of(stream: BinaryIO) -> list[str]:
    """Return the problems of a non-empty file, none if it is whole; see `RecordWalk`."""
    with open_records(stream) as records:
        for _ in records:
            pass
        return records.problems


def intact(attachment: bytes) -> bool:
    """Return whether an attachment's checksum is right.

    MCAP allows 0 for no checksum. Session files always have one, so 0 counts as damage.
    """
    (checksum,) = _CHECKSUM.unpack(attachment[-_CHECKSUM.size :])
    return bool(checksum == zlib.crc32(attachment[: -_CHECKSUM.size]))


def _fits(opcode: int, content: memoryview) -> bool:
    """Return whether the lengths of a record's fields add up to the record's length."""
    if opcode not in _LAYOUTS:
        return opcode >= _PRIVATE
    at = 0
    for field in _LAYOUTS[Opcode(opcode)]:
        if field == "*":
            return at <= len(content)
        size = _SIZES[field]
        if at + size > len(content):
            return False
        if field in "sS":
            size += int.from_bytes(content[at : at + size], "little")
        at += size
    return at == len(content)
