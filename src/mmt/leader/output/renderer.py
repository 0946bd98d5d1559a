"""What plays from a model or another method's generator, and the crossfade between two of them."""

import math
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mmt.core.arrays import FloatArray


class SynthesizedVibration(Protocol):
    """Renders vibration from a model, or from another method's generator."""

    @property
    def directed(self) -> bool:
        """Whether the inputs are velocity x, y and force, not speed and force."""

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return one sample in m/s2 for each moment of the inputs, shape (n,)."""


@runtime_checkable
class TouchDownRenderer(Protocol):
    """A renderer that renders the transient of a touch-down too."""

    def touch_down(self, approach_speed_mm_s: float) -> None:
        """Add the transient to the samples that follow."""


@runtime_checkable
class MotionFollowing(SynthesizedVibration, Protocol):
    """Synthesized vibration that follows the motion even while it is not played."""

    def follow(self, *inputs: FloatArray) -> object:
        """Follow the motion, given the inputs of `render`, without rendering."""


class Renderer(SynthesizedVibration, Protocol):
    """Renders from one model: a `Synthesizer`, or an object used like one."""

    model: Any


class RestartedRenderer(Renderer, Protocol):
    """A renderer that is reset for each surface's model."""

    def reset(self) -> None:
        """Begin anew."""


class ModelCrossfade:
    """Two synthesizers used like one, with a crossfade from one surface's model to another's.

    A fade that has begun is completed; the next one follows it.

    Parameters
    ----------
    one, other
        Renderers with different seeds, so that their vibrations are uncorrelated.
    crossfade_samples
        Length of a fade; 0 switches at once.
    """

    def __init__(
        self, one: RestartedRenderer, other: RestartedRenderer, *, crossfade_samples: int
    ) -> None:
        self._current, self._other = one, other
        self._length = crossfade_samples
        self._left = 0
        self._next: Any = None

    @property
    def model(self) -> Any:
        """The model that is rendered, or will be; assign one of the same surface: no fade."""
        return self._current.model if self._next is None else self._next

    @model.setter
    def model(self, model: Any) -> None:
        if self._next is None:
            self._current.model = model
        else:
            self._next = model

    @property
    def directed(self) -> bool:
        """Whether the models' inputs are velocity and force, not speed and force."""
        return self._current.directed

    def cross_to(self, model: Any) -> None:
        """Fade to the model of another surface."""
        if self._left:
            self._next = model
            return
        self._current, self._other = self._other, self._current
        self._current.model = model
        self._current.reset()
        self._left = self._length

    def touch_down(self, approach_speed_mm_s: float) -> None:
        """Add the transient of a touch-down; see `Synthesizer.touch_down`."""
        if isinstance(self._current, TouchDownRenderer):
            self._current.touch_down(approach_speed_mm_s)

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples in m/s2; see `Synthesizer.render`."""
        now = self._current.render(*inputs)
        if not self._left:
            return now
        before = self._other.render(*inputs)
        passed = self._length - self._left + 1 + np.arange(len(now))
        share = np.minimum(passed / self._length, 1.0)
        self._left = max(0, self._left - len(now))
        if not self._left and self._next is not None:
            following, self._next = self._next, None
            self.cross_to(following)
        return crossfaded(share, before, now)


def crossfaded(share: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the mix of two uncorrelated signals that keeps their power (gains cosine and sine).

    Parameters
    ----------
    share
        Share of `after`, 0 to 1, shape (n,).
    before, after
        The signals, shape (n,).
    """
    angle = 0.5 * math.pi * share
    mixed: FloatArray = np.cos(angle) * before + np.sin(angle) * after
    return mixed
