"""The second stage of an update: segments become fitted filters of one common order."""

import itertools
from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.texture.model.fits import Fit, automatic_order, points_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.methods import ModellingMethod
from mmt.texture.online.work import SegmentRange, Stopwatch, Work
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings

LARGEST_MODEL: Final = 1000
"""Samples of a model; of the two that lie closest, the older one leaves for the next."""


class FittingStage:
    """Fit segments by Burg's method, as samples with line spectral frequencies.

    Cost: O(new samples x order); all segments are fitted again where an automatic order changes.

    Parameters
    ----------
    settings
        Settings of the modelling.
    method
        How to model.
    """

    def __init__(self, settings: ModellingSettings, method: ModellingMethod) -> None:
        self._method = method
        self._settings = settings
        self._space = InputSpace(settings.inputs)
        self._numbers = itertools.count()
        self.order: int | None = None if settings.order == "auto" else settings.order
        """The common order, None before an automatic one is chosen."""
        self.fits: dict[SegmentRange, Fit] = {}
        """By the range of their segments, in the order in which they came."""

    def fit(self, work: Work, *, started: bool) -> None:
        """Fit the new segments, and set the fits that there are now.

        Parameters
        ----------
        work
            With segments.
        started
            Whether the start criterion is met. An automatic order follows the data until then;
            from then on it stays, so that the rendered filters keep their kind.
        """
        clock = Stopwatch(work.durations_s)
        removed = list(work.removed)
        if work.forget_from is not None:
            removed += [key for key in self.fits if key[1] > work.forget_from]
        work.removed_count += self.remove(removed)
        self._fit(work.added, started=started)
        work.removed_count += self._thin_out()
        work.fits, work.order = tuple(self.fits.values()), self.order
        clock.lap("fit")

    def remove(self, ranges: Iterable[SegmentRange]) -> int:
        """Take fits out; return how many there were."""
        return sum(self.fits.pop(key, None) is not None for key in ranges)

    def _fit(self, segments: list[Segment], *, started: bool) -> None:
        if self._settings.order == "auto" and segments and not started:
            everything = [*(fit.segment for fit in self.fits.values()), *segments]
            before, self.order = self.order, automatic_order(everything, self._settings)
            segments = segments if self.order == before else everything
        if self.order is None:
            return
        for fit in self._method.add(segments, self.order, self._numbers):
            self.fits[fit.segment.start, fit.segment.stop] = fit

    def _thin_out(self) -> int:
        """Keep the model at its largest size; return how many samples leave.

        The older of the two samples that lie closest in the plane leaves: where the hand keeps
        coming back the samples are recent, and a place that it has touched once is kept.
        """
        surplus = max(0, len(self.fits) - LARGEST_MODEL)
        if surplus == 0:
            return 0
        keys = list(self.fits)
        points = points_of(self.fits.values(), self._space)
        for _ in range(surplus):
            distances, _ = cKDTree(points).query(points, k=2)
            older = int(np.argmin(distances[:, 1]))
            points = np.delete(points, older, axis=0)
            del self.fits[keys.pop(older)]
        return surplus
