"""The online update of a texture model: stream in, immutable models out.

Awan et al., section V.C: once a period the newest samples are filtered and cut into segments
(`mmt.texture.signals`, `mmt.texture.segmentation`) and fitted, a new model is triangulated, and a
completion criterion judges it. The evaluation of recorded sessions runs these stages one after the
other (`update`); the live leader runs each in a task of its own. Both build the same model to the
bit.
"""

import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import RecordArray
from mmt.core.bounds import check
from mmt.texture.completion.criterion import Criterion
from mmt.texture.completion.distance import distance_sum
from mmt.texture.model.fits import Fit, fit_segments, points_of
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.methods import method_of
from mmt.texture.online.updates import (
    DEFERRED,
    ModelUpdate,
    ReadyModel,
    Stopwatch,
    UpdateWork,
)
from mmt.texture.segmentation.segmenter import OnlineSegmenter, SampleRange
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import NoiseFloor
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.space import InputSpace
from mmt.texture.touch_down import LEAST_RATE_HZ
from mmt.texture.touch_down.fitting import TouchDown, TouchDownFinder

LARGEST_MODEL: Final = 1000
"""Largest number of samples in a model, which limits its memory and the cost of an update. Beyond
it, the older of the two closest samples is removed."""

MOST_TOUCH_DOWNS: Final = 64
"""Largest number of touch-downs in a model; the newest are kept."""


class OnlineModeller:
    """Build a texture model from a stream of frames.

    Parameters
    ----------
    settings
        See `ModellingSettings`.
    deferred
        Whether no model is built here: `mmt.texture.online.history` takes them from its log.
    """

    kept = None
    """Numbers of the surfaces whose models are kept; None if surfaces are not told apart."""

    def __init__(
        self, settings: ModellingSettings | None = None, *, deferred: bool = False
    ) -> None:
        check("settings", settings, ModellingSettings | None)
        self.settings = settings or ModellingSettings()
        self.space = InputSpace(self.settings.inputs)
        self._filter = StreamFilter(self.settings)
        self._segmenter = OnlineSegmenter(self.settings)
        self._noise = NoiseFloor()
        fast = self.settings.vibration_rate_hz >= LEAST_RATE_HZ
        self._touch_downs = TouchDownFinder(self.settings) if fast else None
        self._method = method_of(self.settings)
        self._numbers = itertools.count()
        self._deferred = deferred
        self._source: ReadyModel | None = None
        self.fits: dict[SampleRange, Fit] = {}
        """Fits by the range of their segments, in the order in which they came."""
        self._touched: tuple[TouchDown, ...] = ()  # after `fit`; `_built`: those in the model
        self._built: tuple[TouchDown, ...] = ()

    @property
    def completion(self) -> Criterion:
        """The criterion of completion, as of the newest update."""
        return self._method.criterion

    @property
    def model(self) -> TextureModel | None:
        """The newest model, None before the first fit."""
        return None if self._source is None else self._source()

    def update(self, frames: RecordArray) -> ModelUpdate:
        """Add the newest frames and return the new state.

        Parameters
        ----------
        frames
            Shape (n,), with position, force and acceleration; in order, with jumps in
            ``sequence`` where frames are missing. May be empty. The numbering continues if numbers
            restart or wrap, see `mmt.texture.signals.filtering`.

        Raises
        ------
        InputError
            The array holds no frames, or a channel is missing.
        """
        update = run_stages(self.segment(frames))
        assert update is not None  # noqa: S101 - every call gives work
        return update

    # --- the stages; the work goes through them in this order

    def segment(self, frames: RecordArray) -> Iterator[UpdateWork]:
        """Filter and segment frames (n,), and yield the work for an update; O(n)."""
        clock = Stopwatch()
        aligned = self._filter.process(frames)
        self._noise.update(aligned)
        clock.lap("filter")
        change = self._segmenter.update(aligned)
        touched = [] if self._touch_downs is None else self._touch_downs.update(aligned)
        clock.lap("segment")
        yield UpdateWork(
            modeller=self,
            time_s=self._session_time_s(self._filter.newest + 1),
            observed=[aligned],
            added=change.added,
            removed=change.removed,
            noise_power=self._noise.power,
            faults=self._filter.faults,
            touched=touched,
            durations_s=clock.laps,
        )

    def remove_after(self, from_sample: int) -> UpdateWork:
        """Return the work of removing all that reaches beyond a sample: it is of another surface.

        A criterion that was met only because of this becomes unmet.

        Parameters
        ----------
        from_sample
            The first sequence number that is not of this surface.
        """
        known = self._noise.power, self._filter.faults
        time_s = self._session_time_s(self._filter.newest + 1)
        return UpdateWork(self, time_s, [], [], [], *known, forget_from=from_sample)

    def _session_time_s(self, sequence: int) -> float:
        return (sequence - self._filter.first) / self.settings.rate_hz

    def fit(self, work: UpdateWork) -> None:
        """Fit the new segments, and set ``work.fits`` to all fits; O(new samples x order)."""
        clock = Stopwatch(work.durations_s)
        removed = list(work.removed)
        if work.forget_from is not None:
            removed += [key for key in self.fits if key[1] > work.forget_from]
        gone = [self.fits.pop(key) for key in removed if key in self.fits]
        work.new_fits = fit_segments(work.added, self._numbers, self.settings)
        self.fits |= {fit.segment.span: fit for fit in work.new_fits}
        gone += self._thin_out()
        work.removed_count += len(gone)
        work.removed_fits = {fit.number for fit in gone}
        work.fits = tuple(self.fits.values())
        self._touched = (*self._touched, *work.touched)[-MOST_TOUCH_DOWNS:]
        if work.forget_from is not None:
            self._touched = tuple(t for t in self._touched if t.frame < work.forget_from)
        work.touch_downs = self._touched
        clock.lap("fit")

    def _thin_out(self) -> list[Fit]:
        """Limit the model to `LARGEST_MODEL` samples; return those that are removed.

        The older of the two closest samples is removed: a region that the hand revisits keeps its
        newest samples, and a region that it touched once keeps its sample.
        """
        surplus = max(0, len(self.fits) - LARGEST_MODEL)
        if surplus == 0:
            return []
        keys, gone = list(self.fits), []
        points = points_of(self.fits.values(), self.space)
        distances, neighbours = cKDTree(points).query(points, k=surplus + 2)
        distances[neighbours == np.arange(len(points))[:, None]] = np.inf
        for _ in range(surplus):
            older = int(np.argmin(distances.min(axis=1)))
            distances[neighbours == older] = distances[older] = np.inf
            gone.append(self.fits.pop(keys[older]))
        return gone

    def build(self, work: UpdateWork) -> None:
        """Build and set the model of the fits, if it changes."""
        clock = Stopwatch(work.durations_s)
        changed = bool(work.added or work.removed_count) or work.touch_downs != self._built
        self._built = work.touch_downs
        changed |= work.forget_from is None and self._source is None and bool(work.fits)
        work.made_anew = self._method.changes(work, changed=changed)
        if work.made_anew:
            empty = self._deferred or not work.fits
            self._source = ReadyModel(None if empty else self._method.model(work).prepared())
        if self._source is not None:
            work.source = self._source
        clock.lap("triangulate")

    def judge(self, work: UpdateWork) -> ModelUpdate:
        """Judge the model by the criterion; set ``work.update`` to the result, and return it.

        A criterion that was met only by samples of another surface becomes unmet.
        """
        clock = Stopwatch(work.durations_s)
        criterion = self.completion
        points = np.empty((0, self.space.dimensions))
        if work.fits:
            points = points_of(work.fits, self.space)
        revoked = work.forget_from is not None and work.removed_count > 0
        self._method.judge(work, points, anew=revoked or work.forget_from is None)
        if revoked and work.forget_from is not None:
            criterion.revoke_since(self._session_time_s(work.forget_from))
        clock.lap("completion")
        work.durations_s["completion"] -= work.durations_s.get(DEFERRED, 0.0)
        work.update = ModelUpdate(
            time_s=work.time_s if work.session_time_s is None else work.session_time_s,
            samples=len(work.fits),
            added=len(work.added),
            removed=work.removed_count,
            distance=distance_sum(points),
            progress=criterion.progress,
            order=self.settings.filter_order,
            started=criterion.started,
            stopped=criterion.stopped,
            source=work.source,
            durations_s=work.durations_s,
            surface=work.surface,
            changes=work.changes,
            left=work.left,
            faults=work.faults,
        )
        return work.update


def run_stages(steps: Iterator[UpdateWork]) -> ModelUpdate | None:
    """Run every stage of each piece of work, and return the last update that is announced."""
    update = None
    for work in steps:
        modeller = work.modeller
        modeller.fit(work)
        modeller.build(work)
        modeller.judge(work)
        update = work.update if work.announced else update
    return update
