"""Log of a model's updates, from which each state of the model can be built again."""

import weakref
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from mmt.texture.field.blocks import BLOCK_S, Blocks, BlockSums
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.methods import build_from_packed
from mmt.texture.online.updates import ModelSource, UpdateWork
from mmt.texture.segmentation.segmenter import SampleRange
from mmt.texture.settings import ModellingSettings
from mmt.texture.touch_down.fitting import TouchDown

_Fit = tuple[SampleRange, bytes]  # the range of its segment, and `Fit.packed`


class _Step(NamedTuple):
    """Changes of one update: fits that came and left, by their numbers, and blocks."""

    came: dict[int, _Fit]
    left: list[int]
    blocks: Blocks | None
    noise_power: float
    touch_downs: tuple[TouchDown, ...]
    model: int
    """Number of the newest update that made a model."""


class ModelLog:
    """Log of one model's updates.

    A model is built on access, and shared by all callers that hold it at that time. Access in the
    order of the updates replays each of them once.

    Parameters
    ----------
    settings
        How the model was built.
    steps
        Steps of another log.
    """

    def __init__(self, settings: ModellingSettings, steps: Sequence[_Step] = ()) -> None:
        self._settings = settings
        self._steps = list(steps)
        self._made: weakref.WeakValueDictionary[int, TextureModel] = weakref.WeakValueDictionary()
        self._begin()

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self._settings, self._steps)

    def add(self, work: UpdateWork) -> ModelSource:
        """Log an update of which the fits and blocks are known; return the source of its model."""
        came = {
            fit.number: (fit.segment.span, fit.packed)
            for fit in work.new_fits
            if fit.number not in work.removed_fits
        }
        number = len(self._steps) if work.made_anew or not self._steps else self._steps[-1].model
        step = _Step(
            came, list(work.removed_fits), work.blocks, work.noise_power, work.touch_downs, number
        )
        self._steps.append(step)
        return partial(self.model, number)

    def without(self, held_out: Sequence[SampleRange]) -> "ModelLog":
        """Return the log as it is without the fits and blocks that touch some ranges of samples."""
        return ModelLog(self._settings, [self._without(step, held_out) for step in self._steps])

    def _without(self, step: _Step, held_out: Sequence[SampleRange]) -> _Step:
        came = {
            number: (span, packed)
            for number, (span, packed) in step.came.items()
            if all(span.stop <= start or span.start >= stop for start, stop in held_out)
        }
        blocks = step.blocks
        if blocks is not None:
            length = round(BLOCK_S * self._settings.rate_hz)
            for start, stop in held_out:
                blocks = blocks[(blocks.start + length <= start) | (blocks.start >= stop)]
        return step._replace(came=came, blocks=blocks)

    @property
    def touch_downs(self) -> tuple[TouchDown, ...]:
        """Touch-downs of the newest update."""
        return self._steps[-1].touch_downs if self._steps else ()

    def model(self, number: int) -> TextureModel | None:
        """Return the model after an update by its number, None before the first or without fits."""
        number = self._steps[number].model if number >= 0 else -1
        if number < 0:
            return None
        model = self._made.get(number)
        if model is None:
            model = self._make(number)
            if model is not None:
                self._made[number] = model
        return model

    def _begin(self) -> None:
        """Discard the replayed state."""
        self._done = 0
        self._fits: dict[int, _Fit] = {}
        self._sums = BlockSums(self._settings) if self._settings.method == "field" else None

    def _make(self, number: int) -> TextureModel | None:
        """Replay the log up to an update, and make its model."""
        if number + 1 < self._done:
            self._begin()
        for step in self._steps[self._done : number + 1]:
            for left in step.left:
                self._fits.pop(left, None)
            self._fits.update(step.came)
            if self._sums is not None and step.blocks is not None:
                self._sums.add(step.blocks)
        self._done = number + 1
        if not self._fits:
            return None
        cells = None if self._sums is None else self._sums.cells()
        packed = [packed for _, packed in self._fits.values()]
        step = self._steps[number]
        return build_from_packed(self._settings, packed, step.noise_power, cells, step.touch_downs)
