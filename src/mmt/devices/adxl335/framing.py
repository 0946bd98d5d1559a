"""Frames of a microcontroller that samples an accelerometer: bytes to records and back, no I/O.

A frame is COBS-encoded (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) and ended by
a zero byte. Before the encoding it holds, little-endian: version (u8), number of the last sample
(u32), the board's time of the last sample (u32, us), n times three converter counts (u16), and
CRC-16 of all that (polynomial 0x1021, initial value 0xFFFF). n is 1 to 32 and follows from
the length.
"""

import struct
from collections import Counter
from collections.abc import Sequence
from typing import Final, NamedTuple

from mmt.devices.serial_ports import FrameDecoder, framed

VERSION: Final = 1
MOST_SAMPLES: Final = 32
"""Samples in one frame at most: it then stays below 254 bytes, and COBS adds exactly one byte."""

Counts = tuple[int, int, int]
"""x, y, z in counts of the converter."""

_HEAD: Final = struct.Struct("<BII")
_SAMPLE: Final = struct.Struct("<HHH")
_OVERHEAD: Final = _HEAD.size + 2


class BoardFrame(NamedTuple):
    """Samples that the board sent together."""

    sequence: int
    """Number of the last sample, modulo 2^32."""
    time_us: int
    """Board's own time of the last sample, modulo 2^32."""
    samples: tuple[Counts, ...]
    """Oldest first."""


def encode_frame(frame: BoardFrame) -> bytes:
    """Return a frame as it goes over the wire, with its final zero.

    Raises
    ------
    ValueError
        No sample, or more than 32.
    """
    if not 1 <= len(frame.samples) <= MOST_SAMPLES:
        raise ValueError(f"a frame holds 1 to {MOST_SAMPLES} samples, not {len(frame.samples)}")
    plain = _HEAD.pack(VERSION, frame.sequence, frame.time_us)
    plain += b"".join(_SAMPLE.pack(*sample) for sample in frame.samples)
    return framed(plain)


class BoardDecoder(FrameDecoder[BoardFrame]):
    """Decoder of the board's frames."""

    _version = VERSION
    _shortest = _OVERHEAD + _SAMPLE.size
    _step = _SAMPLE.size
    _longest = _OVERHEAD + MOST_SAMPLES * _SAMPLE.size + 1

    def _parse(self, content: bytes) -> BoardFrame:
        _, sequence, time_us = _HEAD.unpack_from(content)
        if len(content) == _HEAD.size + _SAMPLE.size:  # the usual case, twice as quick
            return BoardFrame(sequence, time_us, (_SAMPLE.unpack_from(content, _HEAD.size),))
        return BoardFrame(sequence, time_us, tuple(_SAMPLE.iter_unpack(content[_HEAD.size :])))


_MASK: Final = 0xFFFFFFFF
_LARGEST_GAP: Final = 1 << 20
"""Samples; if the counter moves by more, or backwards, the board has restarted."""


class Timeline:
    """Give the samples of successive frames their times, and count lost samples.

    A frame gives the number and the time of its last sample. Its other samples are spaced evenly
    between the previous frame's last sample and this one. Of the first frame, which has no
    previous frame, only the last sample is used.

    Parameters
    ----------
    faults
        Counts go here: ``lost samples``, ``repeated frames``, ``restarts`` of the board.
    """

    def __init__(self, faults: Counter[str]) -> None:
        self.faults = faults
        self._last: BoardFrame | None = None
        self._time_us = 0

    def place(self, frame: BoardFrame) -> Sequence[tuple[int, Counts]]:
        """Return the frame's samples as (time_ns, counts), oldest first.

        Times begin with the board's first time stamp. They go on if the board's 32-bit counter
        wraps (every 71.6 minutes), and begin anew if the board restarts, after an unknown pause.
        """
        last, self._last = self._last, frame
        step = 0 if last is None else (frame.sequence - last.sequence) & _MASK
        if last is None or step > _LARGEST_GAP:
            self.faults["restarts"] += last is not None
            self._time_us = frame.time_us
            return ((frame.time_us * 1000, frame.samples[-1]),)
        if step == 0:
            self._last = last
            self.faults["repeated frames"] += 1
            return ()
        elapsed_us = (frame.time_us - last.time_us) & _MASK
        self._time_us += elapsed_us
        end_ns = self._time_us * 1000
        samples = frame.samples
        if step == len(samples) == 1:  # the usual case, several times as quick
            return ((end_ns, samples[0]),)
        number = min(len(samples), step)
        if step > number:
            self.faults["lost samples"] += step - number
        return tuple(
            (end_ns - elapsed_us * 1000 * back // step, samples[-1 - back])
            for back in range(number - 1, -1, -1)
        )
