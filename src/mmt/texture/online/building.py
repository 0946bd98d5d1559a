"""The third stage of an update: an immutable model that interpolates between the fits."""

from functools import cache

from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.methods import ModellingMethod
from mmt.texture.online.work import Made, ModelSource, Stopwatch, Work


class BuildingStage:
    """Build the model of the fits by the method.

    Parameters
    ----------
    method
        How to model.
    deferred
        Whether each model is made only when it is asked for, before the next update.
    """

    def __init__(self, method: ModellingMethod, *, deferred: bool = False) -> None:
        self._method = method
        self._deferred = deferred
        self._source: ModelSource | None = None

    @property
    def model(self) -> TextureModel | None:
        """The newest model, None before the first fit."""
        return None if self._source is None else self._source()

    def build(self, work: Work) -> None:
        """Build the model anew, where it changes, and set it."""
        clock = Stopwatch(work.durations_s)
        make = self._method.model(work, changed=self._changes(work))
        if make is not None and not work.fits:
            self._source = Made()
        elif make is not None:
            self._source = cache(make) if self._deferred else Made(make().prepared())
        work.made_anew = make is not None
        if self._source is not None:
            work.source = self._source
        clock.lap("triangulate")

    def _changes(self, work: Work) -> bool:
        if work.added or work.removed_count:
            return True
        return work.forget_from is None and self._source is None and bool(work.fits)
