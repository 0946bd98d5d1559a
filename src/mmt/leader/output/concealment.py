"""What is played in the place of vibration that did not arrive in time.

Three ways: go on from a model of the newest samples, repeat these, or fade out. The first two
share their course: a gap begins with a continuation of what was played last, at full level for
50 ms, silent after 100 ms; when samples are there again, five of them fade over to the stream.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, Literal, Protocol

import numpy as np

from mmt.core.arrays import FloatArray

Way = Literal["model", "repetition", "silence"]
"""How gaps are concealed."""

GoOn = Callable[[FloatArray, FloatArray], FloatArray]
"""Continues the newest samples (`PAST_SAMPLES`,) under a course of gains (n,): returns (n,)."""

PAST_SAMPLES: Final = 128
LONGEST_SAMPLES: Final = 100
"""Nothing is invented for longer: 100 ms."""

_FULL_SAMPLES: Final = 50
_RUN_OUT_SAMPLES: Final = 20
_FADE_STEP: Final = 0.2
_PAID_BACK: Final = 2


def _course() -> FloatArray:
    """Return the gains of an endless gap's samples: full, a raised cosine down, zero."""
    fading = np.arange(1, LONGEST_SAMPLES - _FULL_SAMPLES + 1) / (LONGEST_SAMPLES - _FULL_SAMPLES)
    falling = 0.5 + 0.5 * np.cos(np.pi * fading)
    return np.concatenate([np.ones(_FULL_SAMPLES), falling, np.zeros(_RUN_OUT_SAMPLES)])


_COURSE: Final = _course()
_RELEASE: Final = np.maximum(0.0, 1.0 - _FADE_STEP * np.arange(1, len(_COURSE) + 1))


def course(invented: int) -> FloatArray:
    """Return the gains of a gap, (n,), where so much of the allowance is used up.

    None falls from one sample to the next by more than a fade does.
    """
    gains: FloatArray = np.maximum(_COURSE[invented:], _RELEASE[: len(_COURSE) - invented])
    return gains


class Concealment(Protocol):
    """Makes the output from samples that are there and samples that are missing."""

    @property
    def silent(self) -> bool:
        """Whether the output is silent, so that the stream may jump."""

    def play(self, value: float) -> float:
        """Return the output for a sample that is there."""

    def bridge(self) -> float:
        """Return the output for one that is missing."""


class FadeOut:
    """Hold the last sample and fade it out within five; fade the next ones in."""

    def __init__(self) -> None:
        self._gain = 0.0
        self._last = 0.0

    @property
    def silent(self) -> bool:
        """Whether the output is silent."""
        return self._gain == 0.0

    def play(self, value: float) -> float:
        """Return the sample, faded in after a gap."""
        self._last = value
        self._gain = min(1.0, self._gain + _FADE_STEP)
        return self._gain * value

    def bridge(self) -> float:
        """Return the last sample, fading."""
        self._gain = max(0.0, self._gain - _FADE_STEP)
        return self._gain * self._last


class Continuation:
    """Go on with what was played last, and fade back to the stream.

    A continuation is made once, when a gap begins. What is invented is bounded: each sample of
    it takes from an allowance of `LONGEST_SAMPLES`, each that arrives gives two back, and the
    level falls as the allowance runs out. While nothing is missing, the output is the stream.

    Parameters
    ----------
    go_on
        Makes the continuation.
    """

    def __init__(self, go_on: GoOn) -> None:
        self._go_on = go_on
        self._past = deque([0.0] * PAST_SAMPLES, maxlen=PAST_SAMPLES)
        self._share = 0.0  # of the stream in the output
        self._continued: list[float] = []
        self._place = 0
        self._invented = LONGEST_SAMPLES

    @property
    def silent(self) -> bool:
        """Whether the output is silent."""
        return self._share == 0.0 and self._place >= len(self._continued)

    def play(self, value: float) -> float:
        """Return the sample, faded over to after a gap."""
        self._invented = max(0, self._invented - _PAID_BACK)
        if self._share < 1.0:
            self._share = min(1.0, self._share + _FADE_STEP)
            value = self._share * value + (1.0 - self._share) * self._next()
        self._past.append(value)
        return value

    def bridge(self) -> float:
        """Return the next sample of the continuation."""
        if self._share > 0.0:
            self._share = 0.0
            past = np.fromiter(self._past, np.float64, PAST_SAMPLES)
            self._continued = self._go_on(past, course(self._invented)).tolist()
            self._place = 0
        self._invented = min(LONGEST_SAMPLES, self._invented + 1)
        value = self._next()
        self._past.append(value)
        return value

    def _next(self) -> float:
        if self._place >= len(self._continued):
            return 0.0
        self._place += 1
        return self._continued[self._place - 1]


def backwards(past: FloatArray, gain: FloatArray) -> FloatArray:
    """Repeat the newest samples backwards, which joins without a step and needs no pitch."""
    repeated: FloatArray = gain * past[::-1][1 : len(gain) + 1]
    return repeated


def modelled(seed: int) -> GoOn:
    """Return what goes on from a model of the newest samples; imports the compiled numerics."""
    from mmt.texture.synthesis.concealment import continuation

    generator = np.random.default_rng(seed)

    def go_on(past: FloatArray, gain: FloatArray) -> FloatArray:
        return continuation(past, gain, generator.standard_normal(len(gain)))

    return go_on


def build_concealment(way: Way, seed: int) -> Concealment:
    """Return the concealment of a scene; `seed` decides what a model invents."""
    if way == "silence":
        return FadeOut()
    return Continuation(modelled(seed) if way == "model" else backwards)
