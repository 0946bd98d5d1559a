"""The third stage of an update: an immutable model that interpolates between the fits."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mmt.texture.interpolation.registry import load
from mmt.texture.model.fits import Fit, samples_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.work import SegmentRange, Stopwatch, Work
from mmt.texture.settings import ModellingSettings

if TYPE_CHECKING:
    from mmt.texture.selection.online import OnlineSelection


class BuildingStage:
    """Choose the fits that a model is made of, and triangulate them.

    Cost: O(n log n) for all n fits.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        load(settings.interpolator)
        self._settings = settings
        self._space = InputSpace(settings.inputs)
        self._selection = _selection(settings)
        self._chosen: Sequence[Fit] = ()
        self._outliers = self._redundant = 0
        self.model: TextureModel | None = None
        """The newest model, None before the first fit."""

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
        if self._changes(work):
            self.model = self._built(work.noise_power)
        work.chosen, work.outliers, work.redundant = self._chosen, self._outliers, self._redundant
        work.model = self.model
        clock.lap("triangulate")

    def _changes(self, work: Work) -> bool:
        if work.added or work.removed_count:
            return True
        return work.forget_from is None and self.model is None and bool(work.fits)

    def _built(self, noise_power: float) -> TextureModel | None:
        if not self._chosen:
            return None
        return TextureModel(
            replace(samples_of(self._chosen, self._space), noise_power=noise_power),
            interpolate=self._settings.interpolate,
            interpolator=self._settings.interpolator,
            level=self._settings.level,
            shape=self._settings.shape,
            previous=self.model,
            rate_hz=self._settings.rate_hz,
        )


def _selection(settings: ModellingSettings) -> "OnlineSelection | None":
    """Return the selection that is asked for; without one its module is not imported."""
    if settings.selection is None:
        return None
    from mmt.texture.selection.online import OnlineSelection

    return OnlineSelection(settings.selection)
