"""From a session that writes its samples each millisecond to a board that buffers and plays.

Each sample is interpolated to the board's rate at once. How far the board's buffer is filled tells
which clock is ahead, and the step from instant to instant follows it by 0.5 % at most, as in
`mmt.devices.haptuator.card_buffer`. A buffer that is far too full is emptied at twice the speed,
which keeps the signal continuous, and counted as a slip. An empty one gets silence first.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.resampling import AFTER, BEFORE, FillController, SampleRing

_CAPACITY_BITS: Final = 12
_LARGEST_WRITE: Final = 1024
_LEAST_SLACK_S: Final = 0.02
"""Beyond the wanted fill before it is caught up with."""


class BoardResampler:
    """Turn the session's samples into the board's.

    Parameters
    ----------
    rate_hz
        Sampling rate of the session's vibration.
    board_rate_hz
        Rate of the board's converter.
    buffer_ms
        What lies in the board's buffer before it is topped up.
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
        """How often a full buffer had to be caught up with."""

    def push(self, samples: Sequence[float], ahead: int) -> FloatArray:
        """Return what the board gets next, shape (m,).

        Parameters
        ----------
        samples
            Samples of the session; of a backlog longer than 1024 the oldest are left out.
        ahead
            The board's samples in its buffer and on their way.
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
