"""The third stage of an update: an immutable model that interpolates between the fits."""

import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mmt.texture.model.fits import Fit, samples_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.methods import ModellingMethod, ModelMaker
from mmt.texture.online.work import Made, ModelSource, SegmentRange, Stopwatch, Work
from mmt.texture.settings import ModellingSettings

if TYPE_CHECKING:
    from mmt.texture.selection.online import OnlineSelection


class BuildingStage:
    """Choose the fits that a model is made of, and build it by the method.

    Parameters
    ----------
    settings
        Settings of the modelling.
    method
        How to model.
    deferred
        Whether each model is made only when it is asked for.
    """

    def __init__(
        self, settings: ModellingSettings, method: ModellingMethod, *, deferred: bool = False
    ) -> None:
        self._method = method
        self._space = InputSpace(settings.inputs)
        self._selection = _selection(settings)
        self._chosen: Sequence[Fit] = ()
        self._outliers = self._redundant = 0
        self._deferred = deferred
        self._source: ModelSource | None = None

    @property
    def model(self) -> TextureModel | None:
        """The newest model, None before the first fit."""
        return None if self._source is None else self._source()

    @property
    def selects(self) -> bool:
        """Whether a selection keeps fits out, and sends some away for good."""
        return self._selection is not None

    def choose(self, work: Work) -> list[SegmentRange]:
        """Say which fits the model is made of, where it changes.

        Returns
        -------
        redundant
            The ranges of fits that are to leave for good.
        """
        if not self._changes(work):
            return []
        clock = Stopwatch(work.durations_s)
        everything = self._chosen = work.fits
        if self._selection is None or not everything:
            return []
        found = self._selection.choose(
            samples_of(everything, self._space),
            [fit.segment.vibration_m_s2 for fit in everything],
            [fit.number for fit in everything],
        )
        self._outliers = int(found.outlier.sum())
        self._redundant += int(found.redundant.sum())
        kept = np.flatnonzero(~found.outlier & ~found.redundant)
        self._chosen = tuple(everything[index] for index in kept.tolist())
        clock.lap("select")
        left = [everything[index].segment for index in np.flatnonzero(found.redundant).tolist()]
        return [(segment.start, segment.stop) for segment in left]

    def build(self, work: Work) -> None:
        """Build the model anew, where it changes, and set it."""
        clock = Stopwatch(work.durations_s)
        make = self._method.model(work, self._chosen, changed=self._changes(work))
        if make is not None and not self._chosen:
            self._source = Made()
        elif make is not None:
            self._source = Deferred(make) if self._deferred else Made(make().prepared())
        work.chosen, work.outliers, work.redundant = self._chosen, self._outliers, self._redundant
        if self._source is not None:
            work.source = self._source
        clock.lap("triangulate")

    def _changes(self, work: Work) -> bool:
        if work.added or work.removed_count:
            return True
        return work.forget_from is None and self._source is None and bool(work.fits)


class Deferred:
    """A model that is made anew for whoever asks while nobody else holds it."""

    def __init__(self, make: ModelMaker) -> None:
        self._make = make
        self._held: weakref.ref[TextureModel] | None = None

    def __call__(self) -> TextureModel:
        """Return it."""
        held = None if self._held is None else self._held()
        if held is None:
            held = self._make()
            self._held = weakref.ref(held)
        return held

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self._make,)


def _selection(settings: ModellingSettings) -> "OnlineSelection | None":
    """Return the selection that is asked for; without one its module is not imported."""
    if settings.selection is None:
        return None
    from mmt.texture.selection.online import OnlineSelection

    return OnlineSelection(settings.selection)
