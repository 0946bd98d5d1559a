"""The online update of a texture model: stream in, immutable models out.

Awan et al., section V.C: once a period the newest samples are filtered, cut into segments and
fitted; the fits join the sample set and a new model is triangulated. The same class serves the
live leader and the evaluation of recorded sessions.

Cost of an update: O(new samples x order) for filtering and fitting, O(n log n) for the
triangulation of all n samples. The model has `LARGEST_MODEL` samples at most, so that neither
memory nor the cost of an update grows without end where the criteria are never met.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.completion.criteria import make_criterion
from mmt.texture.completion.criterion import Criterion, Progress
from mmt.texture.completion.distance import distance_sum
from mmt.texture.interpolation.interpolators import load
from mmt.texture.model.fits import Fit, automatic_order, fit_segments, samples_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.stopwatch import Stopwatch
from mmt.texture.segmentation.low_band import LowBand
from mmt.texture.segmentation.segmenter import OnlineSegmenter, segmentation_settings
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.noise_floor import NoiseFloor

if TYPE_CHECKING:
    from mmt.texture.selection.online import OnlineSelection
    from mmt.texture.surfaces.changes import SurfaceChange

LARGEST_MODEL: Final = 1000
"""Samples of a model; of the two that lie closest, the older one leaves for the next."""

SegmentRange = tuple[int, int]


@dataclass(frozen=True)
class ModelUpdate:
    """What one update did.

    ``time_s`` is the session time of the newest frame, ``distance`` the completion sum,
    ``progress`` what the criterion in use says, ``durations_s`` the seconds spent on each stage.
    ``outliers`` counts fits that a selection keeps out, ``redundant`` those that left for good.
    Where surfaces are told apart, ``surface`` is the number of the one that all this is of,
    ``changes`` says which changes this update brings to light, in order, and ``left`` what
    has become of the models of the surfaces that were left by them.
    """

    time_s: float
    samples: int
    added: int
    removed: int
    distance: float
    progress: Progress
    order: int | None
    started: bool
    stopped: bool
    model: TextureModel | None
    durations_s: dict[str, float]
    outliers: int = 0
    redundant: int = 0
    surface: int | None = None
    changes: "tuple[SurfaceChange, ...]" = ()
    left: "tuple[ModelUpdate, ...]" = ()


class OnlineModeller:
    """Build a texture model from a stream of frames.

    Parameters
    ----------
    settings
        See `ModellingSettings`.
    accept
        Asked for each segment whether it may enter the model; the evaluation holds
        segments out with it.
    """

    def __init__(
        self,
        settings: ModellingSettings | None = None,
        accept: Callable[[Segment], bool] | None = None,
    ) -> None:
        self.settings = settings or ModellingSettings()
        load(self.settings.interpolator)
        self._accept = accept
        self.space = InputSpace(self.settings.inputs)
        self._filter = StreamFilter(
            normal=self.settings.normal,
            axis=self.settings.axis,
            rate_hz=self.settings.rate_hz,
        )
        self._segmenter = OnlineSegmenter(
            segmentation_settings(self.settings), overlap_samples=self.settings.overlap_samples
        )
        self.completion: Criterion = make_criterion(self.settings)
        self.order: int | None = None if self.settings.order == "auto" else self.settings.order
        self.fits: dict[SegmentRange, Fit] = {}
        self._numbers = itertools.count()
        self._selection = _selection(self.settings)
        self._chosen: list[Fit] = []
        self._outliers = self._redundant = 0
        self._noise = NoiseFloor()
        by_process = self.settings.level != "interpolated"
        self._low_band = LowBand(self.settings.rate_hz) if by_process else None
        self._first_sequence: int | None = None
        self._time_s = 0.0
        self.model: TextureModel | None = None

    @property
    def delay_samples(self) -> int:
        """Samples by which segments lag behind the newest frame, from the filters."""
        return self._filter.delay_samples

    def update(self, frames: RecordArray) -> ModelUpdate:
        """Take the newest frames and return the new state.

        Parameters
        ----------
        frames
            Shape (n,), with position, force and acceleration; in order, with jumps in
            ``sequence`` where frames are missing. May be empty.
        """
        *_, update = self.stages(frames)
        assert update is not None  # noqa: S101 - the last stage gives it
        return update

    def stages(self, frames: RecordArray) -> Iterator[ModelUpdate | None]:
        """Do the same as `update` in stages; None after each, the update after the last.

        A service that must keep its ticks runs them one by one, so that the interpreter lock
        is never contended for longer than a stage.
        """
        clock = Stopwatch()
        if len(frames):
            if self._first_sequence is None:
                self._first_sequence = int(frames["sequence"][0])
            elapsed = int(frames["sequence"][-1]) + 1 - self._first_sequence
            self._time_s = elapsed / self.settings.rate_hz
        aligned = self._filter.process(frames)
        self._noise.update(aligned)
        if self._low_band is not None:
            self._low_band.update(aligned)
        self.completion.observe(aligned)
        clock.lap("filter")
        yield None
        clock.resume()
        change = self._segmenter.update(aligned)
        added = [s for s in change.added if self._accept is None or self._accept(s)]
        if self._low_band is not None:
            added = [self._low_band.restored(s) for s in added]
        clock.lap("segment")
        yield None
        clock.resume()
        removed = self._remove([(s.start, s.stop) for s in change.removed])
        self._fit(added)
        removed += self._thin_out()
        clock.lap("fit")
        yield None
        clock.resume()
        if added or removed or (self.model is None and self.fits):
            if self._choose():
                clock.lap("select")
                yield None
                clock.resume()
            self._rebuild()
        clock.lap("triangulate")
        self.completion.update(self.model, self._time_s)
        clock.lap("completion")
        yield self._state(len(added), removed, clock.laps)

    def forget(self, from_sample: int) -> ModelUpdate:
        """Take out what reaches beyond a sample, which is of another surface.

        A criterion that only those samples have met is no longer met.

        Parameters
        ----------
        from_sample
            The first sequence number that is not of this surface.
        """
        removed = self._remove([key for key in self.fits if key[1] > from_sample])
        if removed:
            self._choose()
            self._rebuild()
            since_s = (from_sample - (self._first_sequence or 0)) / self.settings.rate_hz
            self.completion.update(self.model, self._time_s)
            self.completion.revoke_since(since_s)
        return self._state(0, removed, {})

    def _state(self, added: int, removed: int, durations_s: dict[str, float]) -> ModelUpdate:
        return ModelUpdate(
            time_s=self._time_s,
            samples=len(self._chosen),
            added=added,
            removed=removed,
            distance=distance_sum(self._points(self._chosen)),
            progress=self.completion.progress,
            order=self.order,
            started=self.completion.started,
            stopped=self.completion.stopped,
            model=self.model,
            durations_s=durations_s,
            outliers=self._outliers,
            redundant=self._redundant,
        )

    def _remove(self, ranges: list[SegmentRange]) -> int:
        count = 0
        for key in ranges:
            count += self.fits.pop(key, None) is not None
        return count

    def _fit(self, segments: list[Segment]) -> None:
        """Fit the new segments, or all of them where the common order has changed.

        An automatic order follows the data until the start criterion is met; from then on
        it stays, so that the rendered filters keep their kind.
        """
        if self.settings.order == "auto" and segments and not self.completion.started:
            everything = [*(fit.segment for fit in self.fits.values()), *segments]
            before, self.order = self.order, automatic_order(everything, self.settings)
            segments = segments if self.order == before else everything
        if self.order is None:
            return
        for fit in fit_segments(segments, self.order, self._numbers, self.settings):
            self.fits[fit.segment.start, fit.segment.stop] = fit

    def _thin_out(self) -> int:
        """Keep the model at its largest size; return how many samples leave.

        Of the two that lie closest in the plane the older one leaves: what the hand keeps
        coming back to stays fresh, and what it has touched once stays.
        """
        surplus = max(0, len(self.fits) - LARGEST_MODEL)
        for _ in range(surplus):
            points = self._points(list(self.fits.values()))
            distances, _ = cKDTree(points).query(points, k=2)
            del self.fits[list(self.fits)[int(np.argmin(distances[:, 1]))]]
        return surplus

    def _choose(self) -> bool:
        """Say which fits the model is made of; true where a selection was asked."""
        everything = list(self.fits.values())
        self._chosen = everything
        if self._selection is None or not everything:
            return False
        found = self._selection.choose(
            samples_of(everything, self.space),
            [fit.segment.vibration_m_s2 for fit in everything],
            [fit.number for fit in everything],
        )
        for index in np.flatnonzero(found.redundant).tolist():
            segment = everything[index].segment
            del self.fits[segment.start, segment.stop]
        self._outliers = int(found.outlier.sum())
        self._redundant += int(found.redundant.sum())
        kept = np.flatnonzero(~found.outlier & ~found.redundant)
        self._chosen = [everything[index] for index in kept.tolist()]
        return True

    def _rebuild(self) -> None:
        if not self._chosen:
            self.model = None
            return
        self.model = TextureModel(
            replace(samples_of(self._chosen, self.space), noise_power=self._noise.power),
            interpolate=self.settings.interpolate,
            interpolator=self.settings.interpolator,
            level=self.settings.level,
            shape=self.settings.shape,
            previous=self.model,
            rate_hz=self.settings.rate_hz,
        )

    def _points(self, fits: list[Fit]) -> FloatArray:
        """Return the normalised points of fits, shape (n, d)."""
        if not fits:
            return np.empty((0, self.space.dimensions))
        return samples_of(fits, self.space).points


def _selection(settings: ModellingSettings) -> "OnlineSelection | None":
    """Return the selection that is asked for; without one its module is not imported."""
    if settings.selection is None:
        return None
    from mmt.texture.selection.online import OnlineSelection

    return OnlineSelection(settings.selection)
