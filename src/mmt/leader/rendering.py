"""The switch from streamed to synthesized vibration, and back, with a crossfade."""

import math
from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np

from mmt.core.arrays import FloatArray

Mode = Literal["silent", "streamed", "fading", "synthesized"]


class SynthesizedVibration(Protocol):
    """What renders from a model."""

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return one sample for each moment of the inputs, shape (n,)."""


class VibrationSwitch:
    """Choose between two sources of vibration, sample by sample.

    The crossfade keeps the power of two uncorrelated signals (gains cosine and sine). It can
    be turned round at any moment, also in mid-fade, without a step.

    Parameters
    ----------
    streamed
        Called once a sample with the leader's time in ns, returns the streamed vibration in
        m/s2; None where the scene has none.
    synthesized
        The model's vibration, None where the scene has none.
    crossfade_samples
        Length of a full fade; 0 switches at once.
    limit_m_s2
        Bound of the output.
    period_ns
        Time between samples.
    """

    def __init__(
        self,
        streamed: Callable[[int], float] | None,
        synthesized: SynthesizedVibration | None,
        *,
        crossfade_samples: int,
        limit_m_s2: float,
        period_ns: int = 1_000_000,
    ) -> None:
        self._streamed = streamed
        self._synthesized = synthesized
        self._step = 1.0 / crossfade_samples if crossfade_samples > 0 else 1.0
        self._limit = limit_m_s2
        self._period_ns = period_ns
        self._share = 0.0  # of the synthesized vibration
        self._target = 0.0

    @property
    def mode(self) -> Mode:
        """Which vibration is heard now."""
        if self._share != self._target:
            return "fading"
        if self._share == 1.0:
            return "synthesized"
        return "streamed" if self._streamed is not None else "silent"

    def use_model(self, wanted: bool) -> None:
        """Fade to the model's vibration, or back to the streamed one."""
        self._target = 1.0 if wanted and self._synthesized is not None else 0.0

    def render(self, now_ns: int, *inputs: FloatArray) -> FloatArray:
        """Return the vibration of the elapsed ticks in m/s2, shape (n,).

        Parameters
        ----------
        now_ns
            The leader's time of the last of these ticks.
        *inputs
            What drives the model, in the order of its input space, each of shape (n,).
        """
        count = len(inputs[0])
        output = np.zeros(count)
        if self._share != self._target or self._share > 0.0:
            model = self._synthesized
            synthesized = model.render(*inputs) if model is not None else output
        else:
            synthesized = output
        for index in range(count):
            tick_ns = now_ns - (count - 1 - index) * self._period_ns
            streamed = self._streamed(tick_ns) if self._streamed is not None else 0.0
            self._advance()
            if self._share == 0.0:
                value = streamed
            elif self._share == 1.0:
                value = float(synthesized[index])
            else:
                angle = 0.5 * math.pi * self._share
                value = math.cos(angle) * streamed + math.sin(angle) * float(synthesized[index])
            output[index] = min(max(value, -self._limit), self._limit)
        return output

    def _advance(self) -> None:
        if self._share < self._target:
            self._share = min(self._target, self._share + self._step)
        elif self._share > self._target:
            self._share = max(self._target, self._share - self._step)
