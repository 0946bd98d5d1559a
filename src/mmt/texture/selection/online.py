"""Online selection: keeps outliers out of a growing model, and its size below a limit.

All samples are tested again in every update, so that a knock that came before its neighbours is
removed once there are enough of them, and a good sample that bad ones made suspicious is restored.
An update is one round of the search, and begins where the last one ended.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.model.samples import TextureSamples
from mmt.texture.selection.outliers import find_outliers
from mmt.texture.selection.points import ModelPoints, amplitude_of, spectral_error
from mmt.texture.selection.simplices import enclose_without
from mmt.texture.settings import OnlineSelectionSettings

_TINY: Final = float(np.finfo(np.float64).tiny)


class Chosen(NamedTuple):
    """Masks of n samples: ``outlier`` (n,) are excluded, ``redundant`` (n,) removed for good."""

    outlier: BoolArray
    redundant: BoolArray


class OnlineSelection:
    """Selector of the samples of a growing model.

    Parameters
    ----------
    settings
        ``false_alarms`` among good samples, ``largest`` number of samples.
    """

    def __init__(self, settings: OnlineSelectionSettings) -> None:
        self._settings = settings
        self._outliers: frozenset[int] = frozenset()

    def choose(
        self,
        samples: TextureSamples,
        segments: Sequence[FloatArray],
        numbers: Sequence[int],
    ) -> Chosen:
        """Return which of n samples are outliers, and which are redundant.

        Parameters
        ----------
        samples, segments
            The fits, and what each was fitted to.
        numbers
            One for each sample, which stays the same as long as the sample does.

        Notes
        -----
        Samples without any vibration cannot be compared, and are kept. Of more than ``largest``
        good samples, those that the others predict best are redundant.
        """
        points, lsf, variance = samples.points, samples.lsf, samples.variance
        n = len(points)
        outlier = np.zeros(n, dtype=np.bool_)
        sound = np.flatnonzero(variance > 0.0)
        data = ModelPoints(
            points[sound], lsf[sound], variance[sound], [segments[i] for i in sound.tolist()]
        )
        order = data.canonical()
        data, sound = data.subset(order), sound[order]
        before = np.array([numbers[i] in self._outliers for i in sound.tolist()], dtype=np.bool_)
        found = find_outliers(data, self._settings.false_alarms, before)
        if found is not None:
            outlier[sound[found.outlier]] = True
        self._outliers = frozenset(numbers[i] for i in np.flatnonzero(outlier).tolist())
        redundant = np.zeros(n, dtype=np.bool_)
        good = np.flatnonzero(~outlier)
        surplus = len(good) - self._settings.largest
        if surplus > 0:
            redundant[good[best_predicted(points[good], lsf[good], variance[good], surplus)]] = True
        return Chosen(outlier, redundant)


def best_predicted(
    points: FloatArray, lsf: FloatArray, variance: FloatArray, count: int
) -> IntArray:
    """Return the numbers of the points that the others predict best, one leaving at a time.

    Corners of the hull leave only if nothing else is left. O(n log n) for each sweep, in
    which no two leave that predict each other; one sweep for a few points.
    """
    values = np.column_stack([lsf, variance])
    left = np.arange(len(points))
    gone: list[int] = []
    while len(gone) < count:
        around = enclose_without(points[left])
        error, inner = np.full(len(left), np.inf), around.found
        predicted = around.interpolate(values[left])[inner]
        predicted_lsf, predicted_variance = predicted[:, :-1], predicted[:, -1]
        error[inner] = spectral_error(
            amplitude_of(predicted_lsf, np.maximum(predicted_variance, _TINY)),
            amplitude_of(lsf[left[inner]], np.maximum(variance[left[inner]], _TINY)),
        )
        touched = np.zeros(len(left), dtype=np.bool_)
        leaving: list[int] = []
        for index in np.lexsort((*points[left].T[::-1], error)).tolist():
            if len(gone) + len(leaving) == count or (leaving and np.isinf(error[index])):
                break
            if not touched[around.members[index]].any():  # what predicts it stays
                leaving.append(index)
                touched[index] = True
        gone += left[leaving].tolist()
        left = np.delete(left, leaving)
    return np.array(gone, dtype=np.int64)
