"""Memory layout of a scan in an IIO buffer: types of its elements, and their alignment.

The elements lie in the order of their index, each aligned to its own size. The end of a scan is
aligned to its largest element, so that the next scan is aligned as well. Source: the kernel's
``Documentation/iio/iio_devbuf.rst``, and ``iio_compute_scan_bytes``.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from mmt.core.errors import MmtError

TIMESTAMP: Final = "in_timestamp"

_TYPE: Final = re.compile(r"([bl]e):([su])(\d+)/(8|16|32|64)(?:X(\d+))?(?:>>(\d+))?")
_CODES: Final = {8: "B", 16: "H", 32: "I", 64: "Q"}


@dataclass(frozen=True, slots=True)
class Element:
    """One value of a scan."""

    name: str
    """Such as ``in_accel_x``."""
    index: int
    bits: int
    storage_bits: int
    shift: int = 0
    signed: bool = True
    big_endian: bool = False

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self.storage_bits // 8

    @property
    def bounds(self) -> tuple[int, int]:
        """The least and the largest value that its bits hold."""
        span = 1 << self.bits
        return (-span // 2, span // 2 - 1) if self.signed else (0, span - 1)


def parse_element(name: str, index: str, kind: str) -> Element:
    """Return the element that the contents of its files ``_index`` and ``_type`` describe.

    Parameters
    ----------
    name
        Such as ``in_accel_x``.
    index
        Such as ``0``.
    kind
        Such as ``le:s12/16>>4``.

    Raises
    ------
    MmtError
        Type or index are invalid, or no accelerometer has this type.
    """
    parts = _TYPE.fullmatch(kind.strip())
    if parts is None or not index.strip().isdigit():
        raise MmtError(f"{name} has the type {kind.strip()!r} at {index.strip()!r}, which is none")
    order, sign, bits, storage, repeat, shift = parts.groups()
    if int(repeat or 1) > 1 or not 0 < int(bits) + int(shift or 0) <= int(storage):
        raise MmtError(f"{name} has the type {kind.strip()!r}, which no accelerometer has")
    return Element(
        name,
        int(index),
        int(bits),
        int(storage),
        int(shift or 0),
        sign == "s",
        order == "be",
    )


class Layout:
    """Offsets of the elements in a scan.

    Parameters
    ----------
    elements
        All enabled elements.
    wanted
        Names of the elements that `decode` gives, in this order.
    """

    def __init__(self, elements: Sequence[Element], wanted: Sequence[str]) -> None:
        offsets: dict[str, int] = {}
        end = 0
        for element in sorted(elements, key=lambda one: one.index):
            start = _aligned(end, element.size)
            offsets[element.name] = start
            end = start + element.size
        self.size = _aligned(end, max(element.size for element in elements))
        """Bytes of a scan."""
        by_name = {element.name: element for element in elements}
        self._columns = [_Column(by_name[name], offsets[name], self.size) for name in wanted]

    def decode(self, content: bytes) -> Iterator[tuple[int, ...]]:
        """Return the wanted values of each scan.

        Parameters
        ----------
        content
            Whole scans.
        """
        return zip(*(column.values(content) for column in self._columns), strict=True)


class _Column:
    """One element of successive scans."""

    def __init__(self, element: Element, offset: int, size: int) -> None:
        order = ">" if element.big_endian else "<"
        rest = size - offset - element.size
        self._scan = struct.Struct(f"{order}{offset}x{_CODES[element.storage_bits]}{rest}x")
        self._shift = element.shift
        self._mask = (1 << element.bits) - 1
        self._sign = 1 << (element.bits - 1) if element.signed else 0

    def values(self, content: bytes) -> list[int]:
        """Return the values without their padding bits."""
        shift, mask, sign = self._shift, self._mask, self._sign
        return [
            ((word >> shift & mask) ^ sign) - sign for (word,) in self._scan.iter_unpack(content)
        ]


def _aligned(place: int, size: int) -> int:
    return -(-place // size) * size
