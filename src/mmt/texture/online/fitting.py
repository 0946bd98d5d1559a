"""The second stage of an update: segments become fitted filters of one common order."""

import itertools
from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.texture.model.fits import Fit, points_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.methods import ModellingMethod
from mmt.texture.online.work import Stopwatch, Work
from mmt.texture.segmentation.segments import SampleRange
from mmt.texture.settings import ModellingSettings

LARGEST_MODEL: Final = 1000
"""Samples of a model; of the two that lie closest, the older one leaves for the next."""


class FittingStage:
    """Fit segments by Burg's method, as samples with line spectral frequencies.

    Cost: O(new samples x order).

    Parameters
    ----------
    settings
        Settings of the modelling.
    method
        How to model.
    """

    def __init__(self, settings: ModellingSettings, method: ModellingMethod) -> None:
        self._method = method
        self._space = InputSpace(settings.inputs)
        self._numbers = itertools.count()
        self.fits: dict[SampleRange, Fit] = {}
        """By the range of their segments, in the order in which they came."""

    def fit(self, work: Work) -> None:
        """Fit the new segments, and set the fits that there are now."""
        clock = Stopwatch(work.durations_s)
        removed = list(work.removed)
        if work.forget_from is not None:
            removed += [key for key in self.fits if key[1] > work.forget_from]
        work.removed_count += self._remove(removed)
        for fit in self._method.add(work.added, self._numbers):
            self.fits[fit.segment.span] = fit
        work.removed_count += self._thin_out()
        work.fits = tuple(self.fits.values())
        clock.lap("fit")

    def _remove(self, ranges: Iterable[SampleRange]) -> int:
        """Take fits out; return how many there were."""
        return sum(self.fits.pop(key, None) is not None for key in ranges)

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
        distances, neighbours = cKDTree(points).query(points, k=surplus + 2)
        distances[neighbours == np.arange(len(points))[:, None]] = np.inf
        for _ in range(surplus):
            older = int(np.argmin(distances.min(axis=1)))
            distances[neighbours == older] = distances[older] = np.inf
            del self.fits[keys[older]]
        return surplus
