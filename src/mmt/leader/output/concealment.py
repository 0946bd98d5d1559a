"""Conceal vibration that did not arrive in time.

There are three ways: continue by a model of the newest samples, repeat these, or fade out. The
first two fill a gap with a continuation of the last output, at full level for 50 ms and silent
after 100 ms; when frames come again, the output crossfades to the stream within 5 ms. All ways
take and give one frame of 1 ms at a time, with one sample or several.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import Final, Literal, TypeAlias

import numpy as np

from mmt.core.arrays import FloatArray

Way = Literal["model", "repetition", "silence"]
"""How gaps are concealed."""

GoOn = Callable[[FloatArray, FloatArray], FloatArray]
"""Continues the samples of the newest 128 ms (m,), times gains (n,); returns (n,)."""

LONGEST_FRAMES: Final = 100
"""Longest gap that is concealed, in frames of 1 ms."""

_PAST_FRAMES: Final = 128
_FULL_FRAMES: Final = 50
_RUN_OUT_FRAMES: Final = 20
_FADE_FRAMES: Final = 5
_PAID_BACK: Final = 2
_ORDER_OF_ONE: Final = 16
_LARGEST_ORDER: Final = 32
"""Largest order of the model; its fit must take a small part of a tick."""


@cache
def _courses(samples_per_frame: int) -> tuple[FloatArray, FloatArray]:
    """Return the gains of the samples of an endless gap (n,), and those of a fade (n,)."""
    fading = (LONGEST_FRAMES - _FULL_FRAMES) * samples_per_frame
    falling = 0.5 + 0.5 * np.cos(np.pi * (np.arange(1, fading + 1) / fading))
    full, silent = _FULL_FRAMES * samples_per_frame, _RUN_OUT_FRAMES * samples_per_frame
    gains = np.concatenate([np.ones(full), falling, np.zeros(silent)])
    release = 1.0 - np.arange(1, len(gains) + 1) / (_FADE_FRAMES * samples_per_frame)
    return gains, np.maximum(0.0, release)


def course(invented: int, samples_per_frame: int) -> FloatArray:
    """Return the gains of a gap (n,) if `invented` frames of the allowance are used up.

    Full level, a raised cosine down, then zero; but never below the gains of a fade.
    """
    gains, release = _courses(samples_per_frame)
    left = gains[invented * samples_per_frame :]
    return np.maximum(left, release[: len(left)])


class FadeOut:
    """Hold the last sample and fade it out within 5 ms; fade the next ones in.

    Parameters
    ----------
    samples_per_frame
        Samples of vibration in a frame.
    """

    def __init__(self, samples_per_frame: int = 1) -> None:
        self._count = samples_per_frame
        self._steps = _FADE_FRAMES * samples_per_frame
        self._step = 0  # of the fade, from silence to all of its steps
        self._last = 0.0

    @property
    def silent(self) -> bool:
        """Whether the output is silent, so that the stream may jump."""
        return self._step == 0

    def play(self, values: Sequence[float]) -> Sequence[float]:
        """Return the samples of a frame that has arrived, faded in after a gap."""
        self._last = values[-1]
        return values if self._step == self._steps else self._faded(values, 1)

    def bridge(self) -> Sequence[float]:
        """Return the last sample, fading, for a frame that is missing."""
        return self._faded([self._last] * self._count, -1)

    def _faded(self, values: Sequence[float], direction: int) -> list[float]:
        faded = []
        for value in values:
            self._step = min(self._steps, max(0, self._step + direction))
            faded.append(self._step / self._steps * value)
        return faded


class Continuation:
    """Continue the last output in a gap, and fade back to the stream.

    A continuation is made once, when a gap begins. Invented frames are bounded: each takes one
    from an allowance of `LONGEST_FRAMES`, each frame that arrives gives two back, and the level
    falls as the allowance runs out. While no frame is missing, the output is the stream.

    Parameters
    ----------
    go_on
        Makes the continuation.
    samples_per_frame
        Samples of vibration in a frame.
    """

    def __init__(self, go_on: GoOn, samples_per_frame: int) -> None:
        self._go_on = go_on
        self._silence = [0.0] * samples_per_frame
        self._steps = _FADE_FRAMES * samples_per_frame
        past = _PAST_FRAMES * samples_per_frame
        self._past = deque([0.0] * past, maxlen=past)
        self._step = 0  # of the crossfade, from the continuation to the stream
        self._continued: list[float] = []
        self._place = 0
        self._invented = LONGEST_FRAMES

    @property
    def silent(self) -> bool:
        """Whether the output is silent, so that the stream may jump."""
        return self._step == 0 and self._place >= len(self._continued)

    def play(self, values: Sequence[float]) -> Sequence[float]:
        """Return the samples of a frame that has arrived, with a crossfade to them after a gap."""
        self._invented = max(0, self._invented - _PAID_BACK)
        if self._step < self._steps:
            values = self._faded_over(values)
        self._past.extend(values)
        return values

    def bridge(self) -> Sequence[float]:
        """Return the next samples of the continuation, for a frame that is missing."""
        if self._step > 0:
            self._step = 0
            past = np.array(list(self._past))
            gains = course(self._invented, len(self._silence))
            self._continued = self._go_on(past, gains).tolist()
            self._place = 0
        self._invented = min(LONGEST_FRAMES, self._invented + 1)
        values = self._next()
        self._past.extend(values)
        return values

    def _faded_over(self, values: Sequence[float]) -> list[float]:
        """Return a frame of the stream, crossfaded with the rest of the continuation."""
        mixed = []
        for value, continued in zip(values, self._next(), strict=True):
            self._step = min(self._steps, self._step + 1)
            share = self._step / self._steps
            mixed.append(share * value + (1.0 - share) * continued)
        return mixed

    def _next(self) -> Sequence[float]:
        """Return the continuation's next frame."""
        begin = self._place
        self._place += len(self._silence)
        return self._continued[begin : self._place] or self._silence


def backwards(past: FloatArray, gain: FloatArray) -> FloatArray:
    """Repeat the newest samples backwards, which joins without a step and needs no pitch."""
    repeated: FloatArray = gain * past[::-1][1 : len(gain) + 1]
    return repeated


def modelled(seed: int, samples_per_frame: int) -> GoOn:
    """Return a continuation by a model of the newest samples; imports the compiled numerics."""
    from mmt.texture.synthesis.concealment import continuation

    generator = np.random.default_rng(seed)
    order = min(_LARGEST_ORDER, _ORDER_OF_ONE * samples_per_frame)

    def go_on(past: FloatArray, gain: FloatArray) -> FloatArray:
        return continuation(past, gain, generator.standard_normal(len(gain)), order)

    return go_on


Concealment: TypeAlias = FadeOut | Continuation


def build_concealment(way: Way, seed: int, samples_per_frame: int) -> Concealment:
    """Return the concealment of a scene; `seed` is for the noise of a model."""
    if way == "silence":
        return FadeOut(samples_per_frame)
    go_on = modelled(seed, samples_per_frame) if way == "model" else backwards
    return Continuation(go_on, samples_per_frame)
