"""Buffer between a session that writes samples each millisecond and a card that asks for blocks.

The two run on separate clocks. A ring takes the session's samples; the card's blocks are
interpolated from it. The fill of the ring shows which clock is ahead. A proportional-integral
controller, critically damped with a time constant of 2 s, learns the drift and adjusts the
resampling step, and so the pitch, by 0.5 % at most. If that is not enough, the read position
jumps under a crossfade of one block, which counts as a slip.

One thread writes and another reads. Each index is changed by only one of them, after the samples
that it refers to; the interpreter makes each assignment atomic.
"""

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.resampling import AFTER, BEFORE, FillController, SampleRing

_CAPACITY_S: Final = 4
"""Least capacity; the number of samples is a power of two."""
_LEAST_SLACK_S: Final = 0.02
"""Least excess over the wanted fill from which the read position jumps."""
_FADE_S: Final = 0.002


class CardBuffer:
    """Hold the session's samples until the card asks for them.

    `write` takes about 0.5 us a sample, `read` some 50 us for a block of 96 frames.

    Parameters
    ----------
    rate_hz
        Rate of the samples written.
    card_rate_hz
        Rate of the samples read.
    block_frames
        Usual length of a block.
    buffer_ms
        How late a sample may be written.
    """

    def __init__(
        self, rate_hz: float, card_rate_hz: float, block_frames: int, buffer_ms: float
    ) -> None:
        self._ring = SampleRing(round(_CAPACITY_S * rate_hz).bit_length())
        self._rate_hz = rate_hz
        self._card_rate_hz = card_rate_hz
        block = block_frames * rate_hz / card_rate_hz
        self.target = block + AFTER + buffer_ms * rate_hz / 1000.0
        """Wanted number of unread samples when a block is asked for."""
        self._most = self.target + max(_LEAST_SLACK_S * rate_hz, self.target)
        self._fade = max(1, round(_FADE_S * card_rate_hz))
        self._position = 0.0
        self._playing = False
        self._idle_since = 0
        self._last = 0.0
        self._tail = np.zeros(0)
        self._muted = False
        self._rise = False
        self.follower = FillController(rate_hz)
        self.fill = 0.0
        """Unread samples at the last block."""
        self.underruns = 0
        """How often the card asked for samples that were not yet written."""
        self.slips = 0
        """How often the read position jumped."""

    @property
    def silent(self) -> bool:
        """Whether nothing is being played."""
        return not self._playing and not self._tail.size

    def write(self, samples: Iterable[float]) -> None:
        """Append samples; unread ones are overwritten when the ring is full."""
        self._ring.write(samples)

    def mute(self) -> None:
        """Fade to silence and stay there."""
        self._muted = True

    def read(self, frames: int) -> FloatArray:
        """Return the next `frames` frames for the card, shape (frames,)."""
        written = self._ring.written
        if not self._playing and not self._begin(written):
            return self._silence(frames)
        if self._muted:
            self._stop(written)
            return self._silence(frames)
        fill = written - self._position
        if fill > self._most:
            return self._jump(frames, written)
        self.fill = fill
        step = self._step(fill, frames)
        ready = math.floor((written - AFTER - self._position) / step)
        ready = max(0, min(frames, ready))
        block = self._ring.read(self._position, step, ready)
        self._position += step * ready
        if self._rise:
            block *= np.linspace(0.0, 1.0, ready)
            self._rise = False
        if ready:
            self._last = float(block[-1])
        if ready == frames:
            return block
        self.underruns += 1
        self._stop(written)
        return np.concatenate([block, self._silence(frames - ready)])

    def _begin(self, written: int) -> bool:
        if self._muted or self._tail.size or written - self._idle_since < self.target + BEFORE:
            return False
        self._position = written - self.target
        self._playing = self._rise = True
        return True

    def _stop(self, written: int) -> None:
        """Fade out; play again once enough new samples have been written."""
        self._playing = False
        self._idle_since = written
        self._tail = self._last * np.linspace(1.0, 0.0, self._fade + 1)[1:]
        self._last = 0.0

    def _silence(self, frames: int) -> FloatArray:
        block = np.zeros(frames)
        tail = self._tail[:frames]
        block[: len(tail)] = tail
        self._tail = self._tail[len(tail) :]
        return block

    def _jump(self, frames: int, written: int) -> FloatArray:
        """Jump to the wanted read position, under a crossfade from the old one."""
        self.slips += 1
        step = self._rate_hz / self._card_rate_hz
        aim = written - self.target
        share = np.linspace(0.0, 1.0, frames)
        there = (written - AFTER - aim) / step >= frames
        if not there or written - self._position > 0.5 * _CAPACITY_S * self._rate_hz:
            # the old samples are overwritten, or the block is longer than agreed: start again
            self._stop(written)
            self._idle_since = written - math.ceil(self.target) - BEFORE
            return self._silence(frames)
        old = self._ring.read(self._position, step, frames)
        new = self._ring.read(aim, step, frames)
        self._position = aim + step * frames
        block: FloatArray = old + share * (new - old)
        self._last = float(block[-1])
        return block

    def _step(self, fill: float, frames: int) -> float:
        """Return the resampling step (samples), and learn the drift from the fill."""
        correction = self.follower.correction(fill - self.target, frames / self._card_rate_hz)
        return self._rate_hz / self._card_rate_hz * (1.0 + correction)
