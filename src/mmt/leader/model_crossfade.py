"""From one surface's model to that of another, with the crossfade of the switch."""

import math
from typing import TYPE_CHECKING

import numpy as np

from mmt.core.arrays import FloatArray

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.synthesis.synthesizer import Synthesizer


class ModelCrossfade:
    """Two synthesizers that take turns; in the place of one, which only changes its model.

    The crossfade keeps the power of two uncorrelated signals (gains cosine and sine). A fade
    that has begun goes on to its end; the next one follows it.

    Parameters
    ----------
    one, other
        With different seeds, so that their vibrations are uncorrelated.
    crossfade_samples
        Length of a fade; 0 goes over at once.
    """

    def __init__(self, one: "Synthesizer", other: "Synthesizer", *, crossfade_samples: int) -> None:
        self._heard, self._other = one, other
        self._length = crossfade_samples
        self._left = 0
        self._next: TextureModel | None = None

    @property
    def model(self) -> "TextureModel | None":
        """The model that is rendered, or will be; assigning another of its surface is no fade."""
        return self._heard.model if self._next is None else self._next

    @model.setter
    def model(self, model: "TextureModel | None") -> None:
        if self._next is None:
            self._heard.model = model
        else:
            self._next = model

    @property
    def directed(self) -> bool:
        """Whether the models are ones of velocity, not of speed."""
        return self._heard.directed

    def cross_to(self, model: "TextureModel") -> None:
        """Fade to the model of another surface."""
        if self._left:
            self._next = model
            return
        self._heard, self._other = self._other, self._heard
        self._heard.model = model
        self._heard.reset()
        self._left = self._length

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples in m/s2; see `Synthesizer.render`."""
        now = self._heard.render(*inputs)
        if not self._left:
            return now
        before = self._other.render(*inputs)
        passed = self._length - self._left + 1 + np.arange(len(now))
        angle = 0.5 * math.pi * np.minimum(passed / self._length, 1.0)
        self._left = max(0, self._left - len(now))
        if not self._left and self._next is not None:
            following, self._next = self._next, None
            self.cross_to(following)
        faded: FloatArray = np.cos(angle) * before + np.sin(angle) * now
        return faded
