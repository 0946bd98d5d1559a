"""The published sample selection, exactly as described in the paper.

"Sample selection of multi-trial data for data-driven haptic texture modeling", algorithm 1:
an edited nearest neighbour rule that removes outliers one after the other, then a condensed
one that begins with the minimal set and adds what the model so far misses. The result depends
on the order of the points, as the paper says.

Where the paper leaves a choice, or contradicts itself:

- The minimal set is the corners of the convex hull (section IV.B). They come first, are never
  tested, and always stay.
- Text and pseudo-code disagree which sparsity stands on top of the fraction; only local over
  average makes sparse places more tolerant, as the text wants.
- The pseudo-code trains the condensing model with the candidate in it, which an interpolation
  then meets exactly, so that nothing would ever be added; the text trains without, as here.
- The error compares spectra of signals, whose scatter alone (0.66 between two realisations)
  exceeds both thresholds. Here it compares the exact amplitude spectra of the filters.
- Inputs are normalised from 0 to 1 (section IV.B), here by their range over the points.
- The model is the radial basis function network of the authors' earlier work, of all frequencies
  and the variance (section IV); its radial function is that of
  `mmt.texture.interpolation.radial_basis.network.PUBLISHED`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.errors import InputError
from mmt.texture.selection.leave_one_out import (
    DelaunayNeighbours,
    Interpolator,
    hull_of,
    leave_each_out,
)
from mmt.texture.selection.points import ModelPoints, amplitude_of

LEAST_GAP_RAD: Final = 0.01
"""Least gap between line spectral frequencies that had to be put in order."""


def valid_filter(lsf: FloatArray, variance: float) -> tuple[FloatArray, float]:
    """Return line spectral frequencies in order inside (0, pi), and a positive variance.

    Interpolators that know nothing of filters may return invalid values. Valid ones, such as any
    convex combination, are returned unchanged. Otherwise the frequencies are sorted and pushed
    apart to `LEAST_GAP_RAD` (less where the order leaves no room for it).
    """
    variance = max(variance, float(np.finfo(np.float64).tiny))
    if (np.diff(lsf, prepend=0.0, append=np.pi) > 0).all():
        return lsf, variance
    gap = min(LEAST_GAP_RAD, 0.5 * np.pi / (len(lsf) + 1))
    steps = gap * np.arange(1, len(lsf) + 1)
    ordered = np.maximum.accumulate(np.sort(lsf) - steps)
    top = np.pi - gap * (len(lsf) + 1)
    return np.clip(ordered, 0.0, top) + steps, variance


TAU_1: Final = 0.25
TAU_2: Final = 0.42


@dataclass(frozen=True)
class PublishedSelection:
    """Result of algorithm 1 for n points, arrays of shape (n,).

    ``minimal``: corners of the hull. ``outlier``: removed by the first stage. ``kept``: in the
    selected set. ``error``: relative spectral error of the first stage at the moment of the
    test, ``threshold`` its threshold; both NaN for points that were not tested.
    """

    minimal: BoolArray
    outlier: BoolArray
    kept: BoolArray
    error: FloatArray
    threshold: FloatArray


def spectral_error(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return equation (2): the rms of the difference of amplitudes over that of the truth.

    Parameters
    ----------
    estimate, truth
        Amplitude spectra, shape (..., f).
    """
    difference = np.sqrt(np.mean((estimate - truth) ** 2, axis=-1))
    return np.asarray(difference / np.sqrt(np.mean(truth**2, axis=-1)))


def local_sparsity(points: FloatArray) -> FloatArray:
    """Return the mean distance (n,) to the corners of the simplex around each point's place.

    NaN for corners of the hull. The simplex is that of the triangulation without the point.
    """
    members, _, _ = leave_each_out(points)
    distances = np.linalg.norm(points[members] - points[:, None, :], axis=2).mean(axis=1)
    return np.where(members[:, 0] >= 0, distances, np.nan)


def select_published(
    data: ModelPoints,
    *,
    tau_1: float = TAU_1,
    tau_2: float = TAU_2,
    interpolator: Interpolator | None = None,
) -> PublishedSelection:
    """Run algorithm 1 in the order in which the points stand.

    Parameters
    ----------
    data
        The points; segments are not used.
    tau_1, tau_2
        Thresholds on the relative spectral error.
    interpolator
        Interpolation model that is trained on points in the unit box; None for the networks of
        the paper.

    Raises
    ------
    InputError
        A threshold is not positive.

    Notes
    -----
    With networks O(n^3) for the first stage and O(n kept^2) for the second; with
    `DelaunayNeighbours` O(n log n) and O(n kept), with `retrained` interpolators n trainings each.
    """
    if interpolator is None:
        from mmt.texture.selection.networks import NetworkNeighbours

        interpolator = NetworkNeighbours  # imported here: the leader needs `spectral_error` alone
    if not (tau_1 > 0 and tau_2 > 0):
        raise InputError(f"tau_1 is {tau_1} and tau_2 {tau_2}: both must be positive")
    n = len(data)
    truth = amplitude_of(data.lsf, data.variance)
    values = np.column_stack([data.lsf, data.variance])
    points = _unit_box(data.points)
    minimal = np.zeros(n, dtype=np.bool_)
    minimal[hull_of(points)] = True
    error, threshold = _edit(points, values, truth, minimal, tau_1, interpolator)
    outlier = error > threshold  # false where not tested
    kept = _condense(points, values, truth, minimal, ~outlier, tau_2, interpolator)
    return PublishedSelection(minimal, outlier, kept, error, threshold)


def _unit_box(points: FloatArray) -> FloatArray:
    """Return points (n, d) with every input from 0 to 1; an input that is constant is 0."""
    extent = np.ptp(points, axis=0)
    return np.asarray((points - points.min(axis=0)) / np.where(extent > 0.0, extent, 1.0))


def _edit(
    points: FloatArray,
    values: FloatArray,
    truth: FloatArray,
    minimal: BoolArray,
    tau_1: float,
    interpolator: Interpolator,
) -> tuple[FloatArray, FloatArray]:
    """Return error and threshold (n,) of the first stage, lines 1 to 11."""
    error = np.full(len(points), np.nan)
    threshold = np.full(len(points), np.nan)
    inner = np.flatnonzero(~minimal)
    sparsity = local_sparsity(points)
    known = sparsity[inner][np.isfinite(sparsity[inner])]
    if not known.size:
        return error, threshold
    average = float(known.mean())
    alpha = tau_1 * float(np.abs(known - average).mean()) / average if average > 0 else 0.0
    model = interpolator(points, values, np.ones(len(points), dtype=np.bool_))
    shape = DelaunayNeighbours(points, points, np.ones(len(points), dtype=np.bool_))
    for index in inner.tolist():
        predicted = model.predict(index)
        simplex = shape.simplex(index)
        if predicted is None or simplex is None:
            continue
        distances = np.linalg.norm(points[simplex[0]] - points[index], axis=1)
        relative = float(distances.mean()) / average if average > 0 else 1.0
        threshold[index] = tau_1 + alpha * (relative - 1.0)
        error[index] = spectral_error(_amplitude(predicted), truth[index])
        if error[index] > threshold[index]:
            model.remove(index)
            shape.remove(index)
    return error, threshold


def _condense(
    points: FloatArray,
    values: FloatArray,
    truth: FloatArray,
    minimal: BoolArray,
    candidates: BoolArray,
    tau_2: float,
    interpolator: Interpolator,
) -> BoolArray:
    """Return what the second stage keeps, lines 12 to 20."""
    kept = minimal.copy()
    model = interpolator(points, values, kept)
    for index in np.flatnonzero(candidates & ~minimal).tolist():
        predicted = model.predict(index)
        missed = predicted is None or spectral_error(_amplitude(predicted), truth[index]) > tau_2
        if missed:
            model.add(index)
            kept[index] = True
    return kept


def _amplitude(values: FloatArray) -> FloatArray:
    lsf, variance = valid_filter(values[:-1], float(values[-1]))
    amplitude: FloatArray = amplitude_of(lsf[None], np.array([variance]))[0]
    return amplitude
