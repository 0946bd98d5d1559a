"""The first model of a surface, made from a short first look.

The look takes the stream as it comes, filtered as for the model, and keeps what is stroking. After
`LOOK_SAMPLES` of it the likeliest texture of a library is chosen, or none of them, and again
whenever the look is half as long again, up to `LONGEST_LOOK`. The spectra are those of the known
texture, or of filters fitted to the look; the level is a field (`mmt.texture.field.posterior`)
over the look's blocks, or over how far they are off the known texture.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.texture.field.blocks import BlockCutter, Blocks
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.covariance import coordinates
from mmt.texture.field.posterior import LevelField
from mmt.texture.library.conversion import Field, field, grid, into_space, model_of
from mmt.texture.library.identification import BLOCK, Choice, Stretch, choose, fitted
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.dft321 import dft321
from mmt.texture.signals.filtering import StreamFilter

LOOK_SAMPLES: Final = 200
"""Samples of stroking after which a texture is chosen."""

LONGEST_KNOWN: Final = 4000
"""Samples of stroking after which no known texture is chosen: as much as was felt then tells no
less than the texture itself would, and more than one that is like it."""

LONGEST_LOOK: Final = 8000
"""Samples of stroking after which the model stays."""


class WarmStart:
    """Choose a known texture or none, and keep a model by the look.

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
        self._filter = StreamFilter.of(settings)
        self._cutter = BlockCutter(
            self._space,
            settings.least_speed_mm_s,
            settings.least_force_n,
            settings.rate_hz,
        )
        self._blocks = self._cutter.cut([])
        self._look: list[AlignedBlock] = []
        self._seen = 0
        self._next = LOOK_SAMPLES
        self.choice: Choice | None = None
        """The newest choice."""
        self.model: TextureModel | None = None
        """What it gives, None before a choice."""

    @property
    def looking(self) -> bool:
        """Whether further frames may still change the choice."""
        return self._next <= LONGEST_LOOK

    def process(self, frames: RecordArray) -> Choice | None:
        """Process the newest frames (n,), in order; return a choice where they lead to one."""
        if not self.looking:
            return None
        block = self._filter.process(frames)
        self._blocks = self._blocks.joined(self._cutter.cut([block]))
        stroking = block.valid & (block.speed_mm_s >= self._settings.least_speed_mm_s)
        stroking &= block.normal_force_n >= self._settings.least_force_n
        edges = np.flatnonzero(np.diff(stroking, prepend=False, append=False))
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            self._look.append(block[start:stop])
            self._seen += stop - start
        if self._seen < self._next:
            return None
        while self._next <= self._seen:
            self._next = self._next * 5 // 4
        look = self._stretches()
        library = self._known if self._seen <= LONGEST_KNOWN else {}
        found = choose(library, look, self._space)
        if found is not None:
            self.choice, self.model = found, self._made(found, look)
        if self._next > LONGEST_LOOK:
            self._look.clear()
        return found

    def _made(self, choice: Choice, look: Sequence[Stretch]) -> TextureModel:
        if choice.name is not None:
            return at_level(self._known[choice.name], choice.gain, self._blocks, self._space)
        return _own(look, self._blocks, self._settings)

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


def _own(look: Sequence[Stretch], blocks: Blocks, settings: ModellingSettings) -> TextureModel:
    """Return a model of stretches and blocks alone, as a local one is built from its segments."""
    shortest = max(settings.shortest_samples, 3 * BLOCK)
    parts = [
        Stretch(stretch.inputs[part], stretch.vibration_m_s2[part])
        for stretch in look
        for part in np.array_split(
            np.arange(len(stretch.inputs)), max(1, len(stretch.inputs) // shortest)
        )
    ]
    cells = FieldCells.of(blocks.points, blocks.power, blocks.number)
    return TextureModel(
        fitted(parts, InputSpace(settings.inputs), settings.rate_hz),
        field=cells,
        rate_hz=settings.rate_hz,
    )


def at_level(known: TextureModel, gain: float, blocks: Blocks, space: InputSpace) -> TextureModel:
    """Return a known texture with the level that blocks tell, or by its gain without any.

    The field is of the blocks' powers over the known texture's, times the usual law, which is the
    field's prior mean.
    """
    inputs = grid(space)
    start = field(known, space, inputs)
    level = start.logarithm + np.log(gain)
    if len(blocks.power):
        there = field(known, space, space.scale * blocks.points).logarithm
        power = blocks.power * np.exp(coordinates(blocks.points).law - there)
        off = LevelField(FieldCells.of(blocks.points, power, blocks.number))
        at = coordinates(space.normalise(inputs))
        level = start.logarithm + off.predict(at).mean - at.law
    return model_of(Field(level, start.reflection), space, inputs, known.rate_hz)
