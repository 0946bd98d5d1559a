"""The third stage of an update: an immutable model that interpolates between the fits."""

import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.texture.interpolation.registry import load
from mmt.texture.model.fits import Fit, samples_of, unpacked
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.gathering import Gathering
from mmt.texture.online.work import Made, ModelSource, SegmentRange, Stopwatch, Work
from mmt.texture.settings import ModellingSettings

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.selection.online import OnlineSelection

_INDEPENDENT: Final = ("delaunay", "nearest")
"""Interpolators of which a model is the same whatever the model before was."""


class BuildingStage:
    """Choose the fits that a model is made of, and triangulate them.

    Cost: O(n log n) for all n fits.

    Parameters
    ----------
    settings
        Settings of the modelling.
    deferred
        Whether each model is made only when it is asked for, where none depends on the one
        before.
    """

    def __init__(self, settings: ModellingSettings, *, deferred: bool = False) -> None:
        load(settings.interpolator)
        self._settings = settings
        self._space = InputSpace(settings.inputs)
        self._selection = _selection(settings)
        self._gathering = Gathering(settings) if _gathers(settings) else None
        self._chosen: Sequence[Fit] = ()
        self._outliers = self._redundant = 0
        self._deferred = deferred and settings.interpolator in _INDEPENDENT
        if self._gathering is not None and self._deferred:
            self._gathering.remember()
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
        felt = self._gathering is not None and self._gathering.add(work)
        if self._changes(work) or (felt and self._chosen):
            packed = tuple([fit.packed for fit in self._chosen])
            deferred = _Deferred(packed, work.noise_power, self._settings, self._cells())
            self._source = deferred if self._deferred else Made(deferred.made(self.model))
        work.chosen, work.outliers, work.redundant = self._chosen, self._outliers, self._redundant
        if self._source is not None:
            work.source = self._source
        clock.lap("triangulate")

    def _cells(self) -> "Callable[[], FieldCells] | None":
        if self._gathering is None:
            return None
        return self._gathering.deferred() if self._deferred else self._gathering.cells

    def _changes(self, work: Work) -> bool:
        if work.added or work.removed_count:
            return True
        return work.forget_from is None and self._source is None and bool(work.fits)


class _Deferred:
    """The model of some fits, made anew for whoever asks while nobody else holds it."""

    def __init__(
        self,
        packed: tuple[bytes, ...],
        noise_power: float,
        settings: ModellingSettings,
        cells: "Callable[[], FieldCells] | None",
    ) -> None:
        self._packed, self._noise_power, self._settings = packed, noise_power, settings
        self._cells = cells
        self._held: weakref.ref[TextureModel] | None = None

    def __call__(self) -> TextureModel | None:
        held = None if self._held is None else self._held()
        if held is None:
            held = self.made()
            self._held = None if held is None else weakref.ref(held)
        return held

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self._packed, self._noise_power, self._settings, self._cells)

    def made(self, previous: TextureModel | None = None) -> TextureModel | None:
        """Return a new model, grown from an earlier one; None without fits."""
        if not self._packed:
            return None
        settings = self._settings
        samples = unpacked(self._packed, InputSpace(settings.inputs))
        return TextureModel(
            replace(samples, noise_power=self._noise_power),
            interpolate=settings.interpolate,
            interpolator=settings.interpolator,
            level=settings.level,
            shape=settings.shape,
            field=None if self._cells is None else self._cells(),
            previous=previous,
            rate_hz=settings.rate_hz,
        )


def _gathers(settings: ModellingSettings) -> bool:
    """Say whether blocks tell the level; beside a selection its samples do, without outliers."""
    return settings.level == "gaussian_process" and settings.selection is None


def _selection(settings: ModellingSettings) -> "OnlineSelection | None":
    """Return the selection that is asked for; without one its module is not imported."""
    if settings.selection is None:
        return None
    from mmt.texture.selection.online import OnlineSelection

    return OnlineSelection(settings.selection)
