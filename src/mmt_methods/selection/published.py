"""The published sample selection, exactly as described in the paper.

"Sample selection of multi-trial data for data-driven haptic texture modeling", algorithm 1:
an edited nearest neighbour rule that removes outliers one after the other, then a condensed
nearest neighbour rule that begins with the minimal set and adds points that the model so far
predicts badly. The result depends on the order of the points, as the paper says.

Choices, if the paper leaves one or contradicts itself:

- The minimal set is the corners of the convex hull (section IV.B). They come first, are never
  tested, and always stay.
- Text and pseudo-code disagree on the numerator of the ratio of sparsities. Only local over average
  makes sparse places more tolerant, as the text wants. Both are those of the initial set.
- The pseudo-code trains the condensing model with the candidate in it. An interpolation would then
  predict the candidate exactly, and no point would be added. The text trains without it, as here.
- The paper's error compares spectra of signals, whose scatter alone (0.66 between two realisations)
  exceeds both thresholds. Here the error compares the exact amplitude spectra of the filters.
- Inputs are normalised from 0 to 1 (section IV.B), here by their range over the points.
- The model is the radial basis function network of the authors' earlier work, for all frequencies
  and the variance (section IV). The papers name neither its radial function nor the training of its
  weights: see `SMOOTHING`.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.interpolation.network_solving import RadialBasisNetwork
from mmt_methods.selection.points import (
    ModelPoints,
    amplitude_of,
    enclose_without,
    hull_of,
    spectral_error,
)
from mmt_methods.selection.selecting import Selection

SMOOTHING: Final = 0.03
"""Ridge regression. A network through every point would also follow the scatter of the fits, and
take two to four times as many good points for outliers."""

TAU_1: Final = 0.25
TAU_2: Final = 0.42
"""Thresholds on the relative spectral error."""

_LEAST_GAP_RAD: Final = 0.01


class NetworkNeighbours:
    """One network for all values, through or near every present point.

    The error at a sample, with that sample left out, follows in closed form
    (`mmt.texture.interpolation.network_solving`). If a sample is removed or added for good, the
    network is solved anew.

    Parameters
    ----------
    points
        Shape (n, d), in the unit box.
    values
        Shape (n, v).
    present
        Mask (n,) of the points in the network, at least one.
    smoothing
        Smoothing of the network; 0 passes through every point.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        present: BoolArray,
        smoothing: float = 0.0,
    ) -> None:
        self._points, self._values, self._smoothing = points, values, smoothing
        self._use(np.flatnonzero(present))

    def predict(self, index: int) -> FloatArray | None:
        """Predict the values (v,) at a point without it; None if the others do not suffice."""
        found = np.flatnonzero(self._numbers == index)
        if not len(found):
            return np.asarray(self._network.at(self._points[index : index + 1])[0])
        row = int(found[0])
        pivot = float(self._network.inverse[row, row])
        if self._network.is_indispensable(pivot):
            return None
        return np.asarray(self._values[index] - self._network.weights[row] / pivot)

    def remove(self, index: int) -> None:
        """Remove a point."""
        self._use(self._numbers[self._numbers != index])

    def add(self, index: int) -> None:
        """Add a point."""
        self._use(np.append(self._numbers, index))

    def _use(self, numbers: IntArray) -> None:
        """Solve for the network of some points, at least one."""
        self._numbers = numbers
        self._network = RadialBasisNetwork(
            self._points[numbers], self._values[numbers], self._smoothing
        )


def valid_filter(lsf: FloatArray, variance: float) -> tuple[FloatArray, float]:
    """Return line spectral frequencies in order inside (0, pi), and a positive variance.

    The prediction of a network may be no valid filter. Valid filters are returned unchanged;
    otherwise frequencies are sorted and pushed apart to 0.01 rad (less if there is no room for it).
    """
    variance = max(variance, float(np.finfo(np.float64).tiny))
    if (np.diff(lsf, prepend=0.0, append=np.pi) > 0).all():
        return lsf, variance
    gap = min(_LEAST_GAP_RAD, 0.5 * np.pi / (len(lsf) + 1))
    steps = gap * np.arange(1, len(lsf) + 1)
    ordered = np.maximum.accumulate(np.sort(lsf) - steps)
    top = np.pi - gap * (len(lsf) + 1)
    return np.clip(ordered, 0.0, top) + steps, variance


def _amplitude(model: NetworkNeighbours, index: int, count: int) -> FloatArray | None:
    """Return the spectrum (count,) predicted without a point; None if the others are too few."""
    values = model.predict(index)
    if values is None or not np.isfinite(values).all():
        return None
    lsf, variance = valid_filter(values[:-1], float(values[-1]))
    return np.asarray(amplitude_of(lsf[None], np.array([variance]), count)[0])


def local_sparsity(points: FloatArray) -> FloatArray:
    """Return the mean distance (n,) to the corners of the simplex around each point's place.

    NaN for corners of the hull. The simplex is that of the triangulation without the point.
    """
    around = enclose_without(points)
    distances = np.linalg.norm(points[around.members] - points[:, None], axis=2).mean(axis=1)
    return np.where(around.members[:, 0] >= 0, distances, np.nan)


def thresholds(points: FloatArray) -> FloatArray:
    """Return the thresholds (n,) of points (n, d), lines 1, 6 and 7; NaN for corners."""
    sparsity = local_sparsity(points)
    known = sparsity[np.isfinite(sparsity)]
    average = float(known.mean()) if known.size else 0.0
    if average == 0.0:
        return np.where(np.isfinite(sparsity), TAU_1, np.nan)
    alpha = TAU_1 * float(np.abs(known - average).mean()) / average
    return np.asarray(TAU_1 + alpha * (sparsity / average - 1.0))


def select_published(data: ModelPoints, *, smoothing: float = SMOOTHING) -> Selection:
    """Run algorithm 1 in the order in which the points stand.

    Score and error of the result are the relative spectral error of the first stage at the moment
    of the test, 0 and NaN for points that were not tested.

    Parameters
    ----------
    data
        The points; segments are not used.
    smoothing
        Smoothing of the network, for points in the unit box.

    Notes
    -----
    O(n^3) for the first stage and O(n kept^2) for the second.
    """
    truth = amplitude_of(data.lsf, data.variance, data.frequencies)
    values = np.column_stack([data.lsf, data.variance])
    extent = np.ptp(data.points, axis=0)
    points = (data.points - data.points.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
    minimal = np.zeros(len(data), dtype=np.bool_)
    minimal[hull_of(points)] = True
    limit = np.where(minimal, np.nan, thresholds(points))
    everyone = np.ones(len(data), dtype=np.bool_)
    error = _edit(NetworkNeighbours(points, values, everyone, smoothing), truth, limit)
    outlier = error > limit  # false if not tested
    model = NetworkNeighbours(points, values, minimal, smoothing)
    kept = _condense(model, truth, minimal, ~outlier)
    words = [
        f"its spectral error {wrong:.2f} exceeds {most:.2f}" if wrong > most else ""
        for wrong, most in zip(error, limit, strict=True)
    ]
    return Selection(outlier, kept, minimal, np.nan_to_num(error), tuple(words), error)


def _edit(model: NetworkNeighbours, truth: FloatArray, limit: FloatArray) -> FloatArray:
    """Return the error (n,) in the first stage, lines 2 to 11, NaN if not tested."""
    error = np.full(len(truth), np.nan)
    for index in np.flatnonzero(np.isfinite(limit)).tolist():
        predicted = _amplitude(model, index, truth.shape[1])
        if predicted is None:
            continue
        error[index] = spectral_error(predicted, truth[index])
        if error[index] > limit[index]:
            model.remove(index)
    return error


def _condense(
    model: NetworkNeighbours, truth: FloatArray, minimal: BoolArray, candidates: BoolArray
) -> BoolArray:
    """Return the mask of the second stage, lines 12 to 20; the model has the minimal set."""
    kept = minimal.copy()
    for index in np.flatnonzero(candidates & ~minimal).tolist():
        predicted = _amplitude(model, index, truth.shape[1])
        if predicted is None or spectral_error(predicted, truth[index]) > TAU_2:
            model.add(index)
            kept[index] = True
    return kept
