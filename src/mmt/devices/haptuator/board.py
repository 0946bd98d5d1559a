"""A board that buffers and plays samples: its frames, its serial port, and samples at its rate.

A frame is COBS-encoded (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) and ended by
a zero byte. Before the encoding it holds, little-endian: version (u8), kind (u8), the kind's
content, and CRC-16 of all that (polynomial 0x1021, initial value 0xFFFF).

Bytes go in and out without waiting. The session's samples, written each millisecond, are
interpolated to the board's rate at once. The fill of the board's buffer shows which clock is ahead,
and the resampling step is adjusted by 0.5 % at most, as in `mmt.devices.haptuator.card_buffer`. A
buffer that is far too full is drained at twice the speed, which keeps the signal continuous and
counts as a slip. An empty buffer gets silence first.
"""

import math
import os
import struct
from collections import Counter
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.resampling import AFTER, BEFORE, FillController, SampleRing
from mmt.devices.serial_ports import FrameDecoder, SerialLine, framed

VERSION: Final = 1
MOST_SAMPLES: Final = 120
"""Samples in one frame at most: it then stays below 254 bytes, and COBS adds exactly one byte."""
FULL_SCALE: Final = 32_767

_SAMPLES: Final = 1
_RESET: Final = 2
_REPORT: Final = 3
_HEAD: Final = struct.Struct("<BB")
_SEQUENCE: Final = struct.Struct("<H")
_REPORT_BODY: Final = struct.Struct("<IHHHHH")


class BoardSamples(NamedTuple):
    """Samples for the converter."""

    sequence: int
    """Number of the frame, modulo 2^16; the first after a reset is 1."""
    values: tuple[int, ...]
    """Full scale is +-32767."""


class Reset(NamedTuple):
    """Command to empty the buffer and restart the counts; it is frame number 0."""


class BoardReport(NamedTuple):
    """The state that the board reports."""

    rate_hz: int
    """Sample rate of its converter."""
    capacity: int
    """Samples that its buffer holds."""
    fill: int
    """Samples in the buffer that are still to be played."""
    sequence: int
    """Number of the newest frame received, even if it did not fit; 0 after a reset."""
    underruns: int
    """How often the buffer ran dry since the reset, modulo 2^16."""
    lost: int
    """Frames missing, invalid, or rejected by a full buffer since the reset, modulo 2^16."""


Message = BoardSamples | Reset | BoardReport


def encode(message: Message) -> bytes:
    """Return a message as it goes over the wire, with its final zero.

    Raises
    ------
    ValueError
        There are no samples or more than 120, or a sample is beyond full scale.
    """
    if isinstance(message, BoardSamples):
        if not 1 <= len(message.values) <= MOST_SAMPLES:
            raise ValueError(f"a frame holds 1 to {MOST_SAMPLES}, not {len(message.values)}")
        if max(message.values) > FULL_SCALE or min(message.values) < -FULL_SCALE:
            raise ValueError(f"a sample is beyond {FULL_SCALE}")
        plain = _HEAD.pack(VERSION, _SAMPLES) + _SEQUENCE.pack(message.sequence)
        plain += struct.pack(f"<{len(message.values)}h", *message.values)
    elif isinstance(message, BoardReport):
        plain = _HEAD.pack(VERSION, _REPORT) + _REPORT_BODY.pack(*message)
    else:
        plain = _HEAD.pack(VERSION, _RESET)
    return framed(plain)


class Decoder(FrameDecoder[Message]):
    """Decoder of messages."""

    _version = VERSION
    _shortest = _HEAD.size + 2

    def _parse(self, content: bytes) -> Message | None:
        kind, body = content[1], content[_HEAD.size :]
        if kind == _REPORT and len(body) == _REPORT_BODY.size:
            return BoardReport(*_REPORT_BODY.unpack(body))
        if kind == _RESET and not body:
            return Reset()
        count, odd = divmod(len(body) - _SEQUENCE.size, 2)
        if kind == _SAMPLES and 1 <= count <= MOST_SAMPLES and not odd:
            values = struct.unpack_from(f"<{count}h", body, _SEQUENCE.size)
            return BoardSamples(_SEQUENCE.unpack_from(body)[0], values)
        return None


_LARGEST_BACKLOG: Final = 8192

_CAPACITY_BITS: Final = 12
_LARGEST_WRITE: Final = 1024
_LEAST_SLACK_S: Final = 0.02
"""Least excess over the wanted fill from which the buffer is drained."""


class HaptuatorBoard(SerialLine):
    """Messages to and from a board.

    Parameters
    ----------
    port, baud_rate
        As in `mmt.devices.haptuator.serial_driver.HaptuatorSerialOptions`.
    """

    def __init__(self, port: str, baud_rate: int) -> None:
        super().__init__(f"Haptuator's board on {port}", port, baud_rate, write_timeout=0)
        self.faults: Counter[str] = Counter()
        """``bad frames``, ``bad checksums`` and ``other versions`` received, and ``dropped writes``
        of more than the port takes."""
        self._decoder = Decoder()
        self._backlog = bytearray()

    def open(self) -> None:
        """Open the port and discard its input buffer; see `SerialLine`."""
        super().open()
        self._decoder = Decoder()
        self._backlog = bytearray(b"\0")  # ends a frame that the board has half of

    def receive(self) -> Sequence[Message]:
        """Return the received messages; see `SerialLine.read`."""
        messages = self._decoder.feed(self.read())
        if self._decoder.faults:
            self.faults.update(self._decoder.faults)
            self._decoder.faults.clear()
        return messages

    def send(self, *messages: Message) -> None:
        """Send messages; bytes that the port does not take now go with the next ones.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        port, backlog = self._opened(), self._backlog
        for message in messages:
            backlog += encode(message)
        try:
            # pyserial's own write spins if the system's buffer is full
            sent = os.write(port.fileno(), backlog) if os.name == "posix" else port.write(backlog)
        except BlockingIOError:
            sent = 0
        except (OSError, TypeError) as error:
            raise self._lost(error) from error
        del backlog[:sent]
        if len(backlog) > _LARGEST_BACKLOG:
            self.faults["dropped writes"] += 1
            backlog[:] = b"\0"


class BoardResampler:
    """Turn the session's samples into the board's.

    Parameters
    ----------
    rate_hz
        Sampling rate of the session's vibration.
    board_rate_hz
        Rate of the board's converter.
    buffer_ms
        Wanted fill of the board's buffer before each write.
    """

    def __init__(self, rate_hz: float, board_rate_hz: float, buffer_ms: float) -> None:
        self._ring = SampleRing(_CAPACITY_BITS)
        self._ring.write([0.0] * (BEFORE + AFTER))
        self._per_sample = board_rate_hz / rate_hz
        self._rate_hz = rate_hz
        self._target = buffer_ms * rate_hz / 1000.0
        self._slack = max(_LEAST_SLACK_S * rate_hz, self._target)
        self._position = float(BEFORE)
        self._slipping = False
        self.follower = FillController(rate_hz)
        self.slips = 0
        """How often a buffer that was too full had to be drained."""

    def push(self, samples: Sequence[float], ahead: int) -> FloatArray:
        """Return the next samples for the board, shape (m,).

        Parameters
        ----------
        samples
            Samples of the session; only the newest 1024 are used.
        ahead
            Samples in the board's buffer and on their way to it.
        """
        count = len(samples)
        dry = ahead <= 0 and count < self._target
        error = ahead / self._per_sample - self._target
        self._ring.write(samples[-_LARGEST_WRITE:])
        step = (1.0 + self._correction(error, count, dry)) / self._per_sample
        ready = max(0, math.floor((self._ring.written - AFTER - self._position) / step))
        block = self._ring.read(self._position, step, ready)
        self._position += step * ready
        if dry:
            block *= np.linspace(0.0, 1.0, ready)
            silence = round((self._target - count) * self._per_sample)
            return np.concatenate([np.zeros(silence), block])
        return block

    def _correction(self, error: float, count: int, dry: bool) -> float:
        if dry:
            return 0.0
        if error > self._slack or (self._slipping and error > 0.0):
            self.slips += not self._slipping
            self._slipping = True
            return 1.0
        self._slipping = False
        return self.follower.correction(error, count / self._rate_hz)
