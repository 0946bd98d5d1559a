"""SPIHT coding of wavelet coefficients, with arithmetic coding, for wavelet bands of MPEG haptics.

Set partitioning in hierarchical trees: A. Said, W. A. Pearlman, "A new, fast, and efficient
image codec based on set partitioning in hierarchical trees", IEEE Trans. Circuits Syst. Video
Technol. 6(3), 1996; here in one dimension, coefficient i having the children 2i and 2i + 1.
Arithmetic coding: I. H. Witten, R. M. Neal, J. G. Cleary, "Arithmetic coding for data
compression", Comm. ACM 30(6), 1987, with ten bits and an adaptive probability for each of seven
contexts. The header and the contexts are those of ISO/IEC 23090-31, as its reference software
reads them.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.compiled import kernel

MOST_PLANES: Final = 15
"""Most bit planes that a block can have: its header has four bits for their number."""

_COUNT_BITS: Final = 4
_SCALE_BITS: Final = 8

_HEADER: Final = 0
_SIGN: Final = 1
_PIXEL: Final = 2
_SET: Final = 3
_CHILD: Final = 4
_GRANDCHILDREN: Final = 5
_REFINEMENT: Final = 6
_CONTEXTS: Final = 7

_ROOTS: Final = 4  # coefficients of the coarsest band, and initial sets

_PIXELS: Final = 0  # indices into `sizes`
_SETS: Final = 1
_SIGNIFICANT: Final = 2
_SYMBOLS: Final = 3

_FULL: Final = 1024
_HALF: Final = 512
_QUARTER: Final = 256
_LONGEST: Final = 11  # bits of the least probable symbol

Array = npt.NDArray[Any]


def encode_block(values: npt.NDArray[np.int64], planes: int, scale_code: int) -> bytes:
    """Return the coded coefficients of one block, eight bits in a byte, the highest bit first.

    Parameters
    ----------
    values
        Quantised coefficients, coarsest band first, each less than ``2**planes``; shape (n,),
        n a power of two, at least 16.
    planes
        Bit planes, 1 to 15.
    scale_code
        The 8 bits of the header for the scale, written lowest bit first.
    """
    return np.packbits(_encode(np.ascontiguousarray(values), planes, scale_code)).tobytes()


@kernel("void(u1[:,::1], i8[::1], i8, i8)", inner=True)
def _put(symbols: Array, sizes: Array, symbol: int, context: int) -> None:
    symbols[sizes[_SYMBOLS], 0] = symbol
    symbols[sizes[_SYMBOLS], 1] = context
    sizes[_SYMBOLS] += 1


@kernel("void(i8[::1], i8, i8, i8, i8[::1], i8[::1], i8[::1], u1[:,::1])", inner=True)
def _test(
    values: Array,
    threshold: int,
    place: int,
    context: int,
    pixels: Array,
    significant: Array,
    sizes: Array,
    symbols: Array,
) -> None:
    """Code whether one coefficient is significant, and append it to its list."""
    if abs(values[place]) >= threshold:
        _put(symbols, sizes, 1, context)
        _put(symbols, sizes, 1 if values[place] >= 0 else 0, _SIGN)
        significant[sizes[_SIGNIFICANT]] = place
        sizes[_SIGNIFICANT] += 1
    else:
        _put(symbols, sizes, 0, context)
        pixels[sizes[_PIXELS]] = place
        sizes[_PIXELS] += 1


@kernel("void(i8[::1], i8[::1], i8[::1])", inner=True)
def _descend(values: Array, descendants: Array, beyond: Array) -> None:
    """Find the largest descendant of each coefficient, and the largest beyond its children."""
    for place in range(len(values) // 2 - 1, 0, -1):
        children = max(abs(values[2 * place]), abs(values[2 * place + 1]))
        if 4 * place < len(values):
            beyond[place] = max(descendants[2 * place], descendants[2 * place + 1])
        descendants[place] = max(children, beyond[place])


@kernel(
    "void(i8[::1], i8, i8[::1], i8[::1], i8[:,::1], i8[::1], i8[::1], i8[::1], u1[:,::1])",
    inner=True,
)
def _sort_sets(
    values: Array,
    threshold: int,
    descendants: Array,
    beyond: Array,
    sets: Array,
    pixels: Array,
    significant: Array,
    sizes: Array,
    symbols: Array,
) -> None:
    """Code which sets of descendants are significant, and split these sets in the same pass."""
    kept = read = 0
    while read < sizes[_SETS]:
        place, is_beyond = sets[read, 0], sets[read, 1]
        read += 1
        largest = beyond[place] if is_beyond else descendants[place]
        _put(
            symbols, sizes, 1 if largest >= threshold else 0, _GRANDCHILDREN if is_beyond else _SET
        )
        if largest < threshold:
            sets[kept, 0], sets[kept, 1] = place, is_beyond
            kept += 1
        elif is_beyond:
            for child in range(2 * place, 2 * place + 2):
                sets[sizes[_SETS], 0], sets[sizes[_SETS], 1] = child, 0
                sizes[_SETS] += 1
        else:
            for child in range(2 * place, 2 * place + 2):
                _test(values, threshold, child, _CHILD, pixels, significant, sizes, symbols)
            if 4 * place + 3 < len(values):
                sets[sizes[_SETS], 0], sets[sizes[_SETS], 1] = place, 1
                sizes[_SETS] += 1
    sizes[_SETS] = kept


@kernel("u1[:,::1](i8[::1], i8, i8)", inner=True)
def _symbols(values: Array, planes: int, scale_code: int) -> Array:
    """Return the header and the bits of SPIHT, each with its context; shape (k, 2)."""
    count = len(values)
    symbols = np.empty((4 * count * (planes + 2) + 16, 2), np.uint8)
    pixels, significant = np.empty(count, np.int64), np.empty(count, np.int64)
    sets = np.empty((4 * count, 2), np.int64)
    descendants, beyond = np.zeros(count, np.int64), np.zeros(count, np.int64)
    sizes = np.zeros(4, np.int64)
    for bit in range(_COUNT_BITS):
        _put(symbols, sizes, planes >> bit & 1, _HEADER)
    for bit in range(_SCALE_BITS):
        _put(symbols, sizes, scale_code >> bit & 1, _HEADER)
    _descend(values, descendants, beyond)
    for place in range(2 * _ROOTS):
        pixels[place] = place
        if place >= _ROOTS:
            sets[place - _ROOTS, 0], sets[place - _ROOTS, 1] = place, 0
    sizes[_PIXELS], sizes[_SETS] = 2 * _ROOTS, _ROOTS
    for plane in range(planes, -1, -1):
        threshold, found, tried = 1 << plane, sizes[_SIGNIFICANT], sizes[_PIXELS]
        sizes[_PIXELS] = 0
        for index in range(tried):
            place = pixels[index]  # read before `_test` overwrites it: the list is rebuilt
            _test(values, threshold, place, _PIXEL, pixels, significant, sizes, symbols)
        _sort_sets(
            values, threshold, descendants, beyond, sets, pixels, significant, sizes, symbols
        )
        for index in range(found):
            bit = abs(values[significant[index]]) >> plane & 1
            _put(symbols, sizes, bit, _REFINEMENT)
    return symbols[: sizes[_SYMBOLS]]


@kernel("u1[::1](u1[:,::1])", inner=True)
def _code(symbols: Array) -> Array:
    """Return the arithmetic code of symbols with contexts, without trailing zeros."""
    zeros, totals = np.full(_CONTEXTS, 8), np.full(_CONTEXTS, 16)
    bits = np.zeros(_LONGEST * len(symbols) + 16, np.uint8)
    size = pending = lower = 0
    upper = _FULL
    for index in range(len(symbols)):
        context = symbols[index, 1]
        probability = int(np.floor(zeros[context] / totals[context] * _FULL + 0.5))
        width = upper - lower
        part = min(max(width * probability // _FULL, 1), width - 1)
        if symbols[index, 0]:
            lower += part
        else:
            upper = lower + part
            zeros[context] += 1
        totals[context] += 1
        while True:
            if upper <= _HALF or lower >= _HALF:
                bits[size] = 1 if lower >= _HALF else 0
                bits[size + 1 : size + 1 + pending] = 1 - bits[size]
                size, offset, pending = size + 1 + pending, _HALF * bits[size], 0
            elif lower >= _QUARTER and upper <= 3 * _QUARTER:
                offset = _QUARTER
                pending += 1
            else:
                break
            lower, upper = 2 * (lower - offset), 2 * (upper - offset)
    value, step = 0, _HALF  # the shortest number in the interval; a reader appends zeros
    while value < lower or (pending and not value):
        if value + step < upper:
            bits[size], value = 1, value + step
        size, step = size + 1, step // 2
    while size and not bits[size - 1]:
        size -= 1
    return bits[:size]


@kernel("u1[::1](i8[::1], i8, i8)")
def _encode(values: Array, planes: int, scale_code: int) -> Array:
    return _code(_symbols(values, planes, scale_code))
