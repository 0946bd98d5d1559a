"""The first model of a surface: a known texture, chosen by a short first look.

The look takes the stream as it comes, filtered as for the model, and keeps what is stroking. After
`LOOK_SAMPLES` of it the likeliest texture of a library is chosen, and again whenever the look is
twice as long, up to `LONGEST_LOOK`. In between and after, the samples of the local model move it.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.texture.library.blending import blend
from mmt.texture.library.conversion import into_space
from mmt.texture.library.identification import Choice, Stretch, choose
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.dft321 import dft321
from mmt.texture.signals.filtering import StreamFilter

LOOK_SAMPLES: Final = 200
"""Samples of stroking after which a texture is chosen."""

LONGEST_LOOK: Final = 4000
"""Samples of stroking after which the choice stays."""


class WarmStart:
    """Choose a known texture, and blend it with the samples of the local model.

    Parameters
    ----------
    library
        Models by name, at least one.
    settings
        Those of the local model: inputs, axes, and what counts as stroking.

    Raises
    ------
    InputError
        The library is empty, or a model has another sampling rate.
    """

    def __init__(self, library: Mapping[str, TextureModel], settings: ModellingSettings) -> None:
        if not library:
            raise InputError("the library has no model: name at least one")
        for name, model in library.items():
            if model.rate_hz != settings.rate_hz:
                raise InputError(
                    f"model {name} is sampled at {model.rate_hz:g} Hz, {settings.rate_hz:g} Hz "
                    "are needed: leave it out of the library"
                )
        self._settings = settings
        self._space = InputSpace(settings.inputs)
        self._known = {name: into_space(model, self._space) for name, model in library.items()}
        self._filter = StreamFilter(
            normal=settings.normal, axis=settings.axis, rate_hz=settings.rate_hz
        )
        self._look: list[AlignedBlock] = []
        self._seen = 0
        self._next = LOOK_SAMPLES
        self.choice: Choice | None = None

    @property
    def looking(self) -> bool:
        """Whether further frames may still change the choice."""
        return self._next <= LONGEST_LOOK

    def process(self, frames: RecordArray) -> Choice | None:
        """Process the newest frames (n,), in order; return a choice where they lead to one."""
        if not self.looking:
            return None
        block = self._filter.process(frames)
        stroking = block.valid & (block.speed_mm_s >= self._settings.least_speed_mm_s)
        stroking &= block.normal_force_n >= self._settings.least_force_n
        edges = np.flatnonzero(np.diff(stroking, prepend=False, append=False))
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            self._look.append(block[start:stop])
            self._seen += stop - start
        if self._seen < self._next:
            return None
        while self._next <= self._seen:
            self._next *= 2
        found = choose(self._known, self._stretches())
        self.choice = found or self.choice
        if self._next > LONGEST_LOOK:
            self._look.clear()
        return found

    def model(self, samples: TextureSamples | None) -> TextureModel | None:
        """Return the chosen texture, moved by samples of the local one; None before a choice."""
        if self.choice is None:
            return None
        return blend(self._known[self.choice.name], self.choice.gain, samples, self._space)

    def _stretches(self) -> list[Stretch]:
        everything = AlignedBlock.concatenate(self._look)
        cuts = np.flatnonzero(np.diff(everything.index) != 1) + 1
        parts = [everything[a:b] for a, b in pairwise([0, *cuts.tolist(), len(everything)])]
        return [self._stretch(part) for part in parts]

    def _stretch(self, part: AlignedBlock) -> Stretch:
        vibration = part.vibration_m_s2
        motion = part.velocity_mm_s if self._space.directed else part.speed_mm_s[:, None]
        return Stretch(
            np.column_stack([motion, part.normal_force_n]),
            dft321(vibration) if vibration.shape[1] == 3 else vibration[:, 0],
        )
