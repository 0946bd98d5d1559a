"""Stages of the modelling, and the results that they return.

They run in a process of their own (`mmt.leader.modelling.process`), so that no step delays a tick
by holding the interpreter lock.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from mmt.core.arrays import RecordArray
from mmt.texture.modeller_factory import ModellerFactory
from mmt.texture.online.updates import (
    ModelUpdate,
    NewSamples,
    ReadyModel,
    SurfaceStatement,
    UpdateWork,
)
from mmt.texture.settings import ModellingSettings

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.surfaces.modeller import SurfaceModeller


Models = dict[int | None, "TextureModel | None"]
"""The newest model of each surface by number, or by None if surfaces are not told apart."""


class UnchangedModel(ReadyModel):
    """Placeholder for the model in the last update of the surface; `received` replaces it."""


@dataclass(frozen=True)
class UpdateResult:
    """Result of an update.

    Attributes
    ----------
    update
        The update, or None if it is not announced.
    kept
        Numbers of the surfaces whose models are kept; None if surfaces are not told apart.
    samples
        Observed samples, and segments added and removed; None unless they were asked for.
    """

    update: ModelUpdate | None
    kept: tuple[int, ...] | None
    samples: NewSamples | None


def received(update: ModelUpdate, models: Models) -> ModelUpdate:
    """Return an update with all its models filled in, and store these in `models`."""

    def source(each: ModelUpdate) -> ReadyModel:
        if not isinstance(each.source, UnchangedModel):
            models[each.surface] = each.model
        return ReadyModel(models[each.surface])

    return with_models(update, source)


def with_models(update: ModelUpdate, source: Callable[[ModelUpdate], ReadyModel]) -> ModelUpdate:
    """Return an update with new sources of its models; surfaces that were left come first."""
    left = tuple(with_models(each, source) for each in update.left)
    return replace(update, left=left, source=source(update))


class Stages:
    """A modeller and the updates that are under way.

    Parameters
    ----------
    settings
        Settings of the modelling.
    period_s
        Time between updates.
    """

    def __init__(self, settings: ModellingSettings, period_s: float) -> None:
        self._factory = ModellerFactory(settings, period_s)
        self._returns_samples = False
        self._numbers = itertools.count()
        self.begin()

    def begin(self, statements: Sequence[SurfaceStatement] = ()) -> None:
        """Begin a new model, and discard all work under way.

        Parameters
        ----------
        statements
            As of `ModellerFactory.make`.
        """
        self._modeller = self._factory.make(statements)
        self._steps: Iterator[UpdateWork] = iter(())
        self._works: dict[int, UpdateWork] = {}
        self._sent: Models = {}

    def return_samples(self) -> None:
        """Return the samples of each update from now on."""
        self._returns_samples = True

    def state_surface(self, statement: SurfaceStatement) -> None:
        """Set the surface as stated by a person; call only if surfaces are told apart."""
        cast("SurfaceModeller", self._modeller).state_surface(statement)

    def segment(self, frames: RecordArray) -> int | None:
        """Segment frames (n,) of one period; return the number of the first work, or None."""
        self._steps = self._modeller.segment(frames)
        return self.next_work()

    def next_work(self) -> int | None:
        """Continue to segment; return the number of the next work, or None if there is no more."""
        work = next(self._steps, None)
        if work is None:
            return None
        number = next(self._numbers)
        self._works[number] = work
        return number

    def merge(self, later: int, earlier: int, *, segments: bool) -> None:
        """Let a work take over the rest of an earlier one; see `UpdateWork.merge`."""
        self._works[later].merge(self._works.pop(earlier), segments=segments)

    def fit(self, number: int) -> None:
        """Fit the new segments."""
        work = self._works[number]
        work.modeller.fit(work)

    def build(self, number: int) -> None:
        """Build the model of the fits."""
        work = self._works[number]
        work.modeller.build(work)

    def judge(self, number: int) -> UpdateResult:
        """Judge the model; the work is done."""
        work = self._works.pop(number)
        work.modeller.judge(work)
        update = None
        if work.announced and work.update is not None:
            update = with_models(work.update, self._to_send)
        samples = work.samples if self._returns_samples else None
        return UpdateResult(update, self._modeller.kept, samples)

    def _to_send(self, update: ModelUpdate) -> ReadyModel:
        model, surface = update.model, update.surface
        if surface in self._sent and self._sent[surface] is model:
            return UnchangedModel()
        self._sent[surface] = model
        return ReadyModel(model)
