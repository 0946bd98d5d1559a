"""The Digital F/T's stream: 13 bytes a record, no mark, no number, a sum of seven bits."""

import struct
from typing import Final

SIZE: Final = 13
_GAUGES: Final = struct.Struct(">6h")
_CONFIRMED: Final = 3
"""Records in a row whose sums are right: what is found by chance is one in two million."""

Gauges = tuple[int, int, int, int, int, int]
"""G0 to G5 in counts."""


def pack_record(gauges: Gauges, *, error: bool = False) -> bytes:
    """Return the record's bytes: the even gauges, the odd ones, then error bit and sum."""
    content = _GAUGES.pack(*gauges[0::2], *gauges[1::2])
    return content + bytes([sum(content) & 0x7F | (0x80 if error else 0)])


class RecordStream:
    """Find records among bytes, and their place again after garbage.

    While the sums are right each 13 bytes are a record. After one that is wrong, the next
    place is searched from which three in a row are right; what lies before it is left out.
    """

    def __init__(self) -> None:
        self.bad = 0
        """How often the sum was wrong where a record was expected."""
        self.errors = 0
        """Records with the error bit, left out."""
        self.reset()

    def reset(self, rest: bytes = b"") -> None:
        """Begin anew with these bytes."""
        self._rest = rest
        self._in_step = False
        self._skipped = 0

    def feed(self, received: bytes) -> list[Gauges | None]:
        """Take bytes and return the records that are whole.

        Returns
        -------
        records
            None in the place of each that was broken or had the error bit set.
        """
        content = self._rest + received if self._rest else received
        records: list[Gauges | None] = []
        append, unpack = records.append, _GAUGES.unpack_from
        start, end = 0, len(content)
        while end - start >= SIZE:
            if not self._in_step:
                start, self._in_step = self._search(content, start)
                if not self._in_step:
                    break
                records += [None] * -(-self._skipped // SIZE)
                self._skipped = 0
            last = start + SIZE - 1
            if (sum(content[start:last]) ^ content[last]) & 0x7F:
                self.bad += 1
                self._in_step = False
                continue
            if content[last] & 0x80:
                self.errors += 1
                append(None)
            else:
                a, c, e, b, d, f = unpack(content, start)
                append((a, b, c, d, e, f))
            start += SIZE
        self._rest = content[start:]
        return records

    def _search(self, content: bytes, start: int) -> tuple[int, bool]:
        """Return where records begin, or from where to go on searching, and which it is."""
        place, found = start, False
        while len(content) - place >= SIZE * _CONFIRMED:
            if all(_is_right(content, place + SIZE * i) for i in range(_CONFIRMED)):
                found = True
                break
            place += 1
        self._skipped += place - start
        return place, found


def _is_right(content: bytes, start: int) -> bool:
    last = start + SIZE - 1
    return (sum(content[start:last]) ^ content[last]) & 0x7F == 0
