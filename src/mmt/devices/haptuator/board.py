"""A board that buffers and plays samples: its serial port, and samples at its rate.

Bytes go in and out without waiting. The session's samples, written each millisecond, are
interpolated to the board's rate at once. The fill of the board's buffer shows which clock is ahead,
and the resampling step is adjusted by 0.5 % at most, as in `mmt.devices.haptuator.card_buffer`. A
buffer that is far too full is drained at twice the speed, which keeps the signal continuous and
counts as a slip. An empty buffer gets silence first.
"""

import math
import os
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.framing import Decoder, Message, encode
from mmt.devices.haptuator.resampling import AFTER, BEFORE, FillController, SampleRing
from mmt.devices.serial_ports import SerialLine

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
        self._decoder = Decoder()
        self.faults: Counter[str] = self._decoder.faults
        """Those of the messages received, and ``dropped writes`` of more than the port takes."""
        self._backlog = bytearray()

    def open(self) -> None:
        """Open the port and discard its input buffer; see `SerialLine`."""
        super().open()
        self._decoder.reset()
        self._backlog = bytearray(b"\0")  # ends a frame that the board has half of

    def receive(self) -> Sequence[Message]:
        """Return the received messages; see `SerialLine.read`."""
        return self._decoder.feed(self.read())

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
