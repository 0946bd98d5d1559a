"""Detection of outliers against the prediction of their neighbours, independent of point order.

Evidence is computed for every point, from its own samples too where they are available, and each
kind is centred and scaled by the median and the median absolute deviation over all points. Positive
evidence is squared and summed: knocks only add energy, and each adds to another kind. Of the points
above the limit the worst among their neighbours are removed, and the rest is tested again without
them, so that a knock does not condemn its neighbours. Finally every removed point is tested once
more against those that stayed, and may be restored. The last kind of evidence is what the outliers
have in common: the waveform of the knock in their segments, or the discriminant of their spectra
where segments are not available.

The result does not depend on the order of the points.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.selection.cache import SearchCache
from mmt.texture.selection.knocks import WhitenedSegments, knock_evidence, learn_wave
from mmt.texture.selection.neighbour_prediction import NeighbourPrediction, NeighbourPredictor
from mmt.texture.selection.points import ModelPoints, log_density_of
from mmt.texture.selection.transients import bursts, whitening

LEAST: Final = 8
"""Least number of outliers from which what they have in common is estimated."""


def discriminant_scores(excess: FloatArray, accused: BoolArray) -> FloatArray:
    """Return Fisher's linear discriminant of each point, good points against outliers, shape (n,).

    Knocks resemble each other, since mostly the same table is struck. The discriminant (Fisher
    1936) is taken in the whitened excess of the log spectra over the prediction. The covariance of
    the good points is shrunk half and half towards a multiple of the identity (Ledoit and Wolf
    2004), since there are about as many frequencies as points. The mean of the outliers leaves out
    the point in question.

    Parameters
    ----------
    excess
        Logarithms of the spectra over the prediction, in sampling deviations, shape (n, f).
    accused
        Which points are outliers so far, shape (n,).

    Notes
    -----
    Zero for all where fewer than `LEAST` are outliers, or fewer are not. O(n f^2 + f^3).
    """
    count = int(accused.sum())
    if count < LEAST or len(accused) - count < LEAST:
        return np.zeros(len(accused))
    good = excess[~accused]
    centred = excess - np.median(good, axis=0)
    deviations = good - good.mean(axis=0)
    covariance = deviations.T @ deviations / len(good)
    size = len(covariance)
    covariance[np.diag_indices(size)] += max(np.trace(covariance) / size, np.finfo(np.float64).tiny)
    total = centred[accused].sum(axis=0)
    others = (total - centred * accused[:, None]) / (count - accused)[:, None]
    return np.asarray(np.einsum("nf,nf->n", centred, np.linalg.solve(covariance, others.T).T))


LIMIT: Final = 14.5
"""Score with segments from which a point is an outlier."""

MODEL_LIMIT: Final = 5.0
"""Score from which a point is an outlier, from the model's data alone."""

MOST: Final = 0.3
"""Largest share of outliers: with more, good points cannot be told from bad ones."""

SEGMENT_KINDS: Final = ("spectrum", "burst", "loud burst", "loud ring", "ring")
MODEL_KINDS: Final = ("spectrum", "level")

BLOW: Final = "blow"
LIKENESS: Final = "likeness"

_ROUNDS: Final = 20
_LOUD_RING: Final = 2  # its place among the bursts
# Weight of what outliers have in common, and what the score is divided by, so that the limit
# stays what it is.
_BLOW: Final = (2.0, 1.2)
_LIKENESS: Final = (1.0, 1.4)
_LEAST_SCALE: Final = 0.02  # of a logarithm: what differs by less is the same
_LEAST_SPREAD: Final = 1e-4  # mean square of the lengths' logarithms: less is nothing to go by
_SLOPE_ROUNDS: Final = 4
_FAR: Final = 2.0  # deviations from the line, beyond which a point pulls no more
_WORDS: Final = {
    "spectrum": "its spectrum has more than its neighbours'",
    "level": "it is louder than its neighbours",
    "burst": "a burst stands out of the rest of the segment",
    "loud burst": "a burst is louder than its neighbours allow",
    "loud ring": "something struck rings louder than its neighbours allow",
    "ring": "something struck rings out of the rest of the segment",
    BLOW: "it holds the blow that other outliers hold",
    LIKENESS: "its spectrum has what other outliers have in common",
}


class Evidence(NamedTuple):
    """``score`` (n,) and ``parts`` (n, kinds), in median deviations above the median."""

    kinds: tuple[str, ...]
    parts: FloatArray
    score: FloatArray
    limit: float


class Outliers(NamedTuple):
    """``outlier`` (n,), the last evidence on every point, and the last consensus."""

    outlier: BoolArray
    evidence: Evidence
    neighbours: NeighbourPrediction


def least_points(dimensions: int) -> int:
    """Return the least number of points for a prediction: twice those that determine a plane."""
    return 2 * (dimensions + 1)


def find_outliers(
    data: ModelPoints, limit: float | None = None, cache: SearchCache | None = None
) -> Outliers | None:
    """Return the points that contradict their neighbours; None where there are too few points.

    Parameters
    ----------
    data
        The points. With segments the evidence is the spectrum, two bursts and two rings, without
        them the spectrum and the level; where some are outliers also what those have in common.
    limit
        On the score; `LIMIT` or `MODEL_LIMIT` unless told.
    cache
        Results of earlier searches among mostly the same points. With it half as many
        neighbours are asked.

    Notes
    -----
    A round costs O(n (log n + k f)), and O(samples order) for the points whose neighbours
    have changed; a handful of rounds are run.
    """
    n = len(data)
    if n < least_points(data.points.shape[1]):
        return None
    few = cache is not None
    if cache is None:
        cache = SearchCache()
        cache.begin(range(n))
    source = _EvidenceSource(data, limit, cache, few=few)
    present = ~cache.suspects()
    for _ in range(_ROUNDS):
        neighbours = source.neighbours.predict_from(present)
        evidence = source.collect(neighbours)
        leaving = _worst(evidence, neighbours, present)
        if not leaving.any() or (present & ~leaving).sum() < (1.0 - MOST) * n:
            break
        present &= ~leaving
    outlier = ~present & (evidence.score > evidence.limit)
    if outlier.sum() >= LEAST:
        compared = source.compare(neighbours, evidence, outlier)
        alike = compared.score > compared.limit
        if alike.sum() <= MOST * n:
            outlier, evidence = alike, compared
    cache.put_outliers(outlier)
    return Outliers(outlier, evidence, neighbours)


class _EvidenceSource:
    """Computes evidence, and caches that of points whose neighbours stay the same."""

    def __init__(
        self, data: ModelPoints, limit: float | None, cache: SearchCache, *, few: bool
    ) -> None:
        self._data = data
        self._cache = cache
        self._logarithm = log_density_of(data.lsf, data.variance)
        self._kinds: tuple[str, ...]
        if data.segments is None:
            self._kinds, usual_limit = MODEL_KINDS, MODEL_LIMIT
        else:
            self._kinds, usual_limit = SEGMENT_KINDS, LIMIT
        self._limit = usual_limit if limit is None else limit
        self._variances = data.fit_variances()
        self._growth = -np.log(self._variances)  # but for a constant, of the lengths
        self.neighbours = NeighbourPredictor(data.points, self._variances, self._logarithm, few=few)

    def collect(self, neighbours: NeighbourPrediction) -> Evidence:
        """Return the evidence against every point, given the prediction by its neighbours."""
        predicted = neighbours.of(self._logarithm)
        excess = np.maximum(self._logarithm - predicted, 0.0)
        spread = neighbours.scatter(self._variances)
        spectrum = np.cbrt((excess**2).mean(axis=1) / spread)  # near normal
        if self._data.segments is None:
            level = np.log(np.exp(self._logarithm).mean(axis=1))
            raw = np.column_stack([spectrum, level - neighbours.of(level)])
        else:
            raw = np.column_stack([spectrum, self._burst_evidence(predicted, neighbours)])
        parts = _standardised(raw, self._growth)
        score = (np.maximum(parts, 0.0) ** 2).sum(axis=1)
        return Evidence(self._kinds, parts, score, self._limit)

    def compare(
        self, neighbours: NeighbourPrediction, evidence: Evidence, accused: BoolArray
    ) -> Evidence:
        """Return the evidence with what every point has in common with the accused."""
        predicted = neighbours.of(self._logarithm)
        if self._data.segments is None:
            kind, (weight, growth) = LIKENESS, _LIKENESS
            spread = neighbours.scatter(self._variances)
            excess = (self._logarithm - predicted) / np.sqrt(spread)[:, None]
            common = discriminant_scores(excess, accused)
        else:
            kind, (weight, growth) = BLOW, _BLOW
            common = self._wave_evidence(predicted, neighbours, accused)
        parts = _standardised(common[:, None], self._growth)
        score = (evidence.score + weight * np.maximum(parts[:, 0], 0.0) ** 2) / growth
        kinds = (*evidence.kinds, kind)
        return Evidence(kinds, np.hstack([evidence.parts, parts]), score, evidence.limit)

    def _wave_evidence(
        self, predicted: FloatArray, neighbours: NeighbourPrediction, accused: BoolArray
    ) -> FloatArray:
        assert self._data.segments is not None  # noqa: S101 - asked for with segments alone
        filters = whitening(np.exp(predicted), self._data.lsf.shape[1])
        heard = WhitenedSegments.through(self._data.segments, filters)
        rings = np.exp(self._burst_evidence(predicted, neighbours)[accused, _LOUD_RING])
        blow = learn_wave(
            heard.subset(np.flatnonzero(accused)), rings, self._cache.wave(len(rings))
        )
        self._cache.put_wave(blow.wave, len(rings))
        return knock_evidence(heard, accused, blow)

    def _burst_evidence(self, predicted: FloatArray, neighbours: NeighbourPrediction) -> FloatArray:
        assert self._data.segments is not None  # noqa: S101 - asked for with segments alone
        keys = self._cache.keys(neighbours.members)
        rows = [self._cache.get(key) for key in keys]
        again = [index for index, row in enumerate(rows) if row is None]
        filters = whitening(np.exp(predicted[again]), self._data.lsf.shape[1])
        found = bursts([self._data.segments[i] for i in again], filters)
        for index, row in zip(again, found, strict=True):
            rows[index] = row
            self._cache.put(keys[index], row)
        return np.array(rows)


def _standardised(raw: FloatArray, growth: FloatArray) -> FloatArray:
    """Centre and scale over all points: over those left, each round would narrow the scale.

    The centre follows a line over ``growth`` (n,), since the largest of more instants is larger:
    that of least squares, what is far from it brought near.
    """
    centre = np.median(raw, axis=0)
    scale = _deviation(raw - centre)
    offset = growth - growth.mean()
    squares = max(float(offset @ offset), _LEAST_SPREAD * len(growth))
    slope = np.zeros(raw.shape[1])
    for _ in range(_SLOPE_ROUNDS):
        left = raw - centre - np.multiply.outer(offset, slope)
        slope += offset @ np.clip(left, -_FAR * scale, _FAR * scale) / squares
    left = raw - np.multiply.outer(offset, slope)
    left -= np.median(left, axis=0)
    return np.asarray(left / _deviation(left))


def _deviation(centred: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(1.4826 * np.median(np.abs(centred), axis=0), _LEAST_SCALE))


def _worst(evidence: Evidence, neighbours: NeighbourPrediction, present: BoolArray) -> BoolArray:
    """Return the present points above the limit that no neighbour above it exceeds."""
    score = np.where(present & (evidence.score > evidence.limit), evidence.score, 0.0)
    highest = score[neighbours.members].max(axis=1)
    np.maximum.at(
        highest, neighbours.members.ravel(), np.repeat(score, neighbours.members.shape[1])
    )
    return np.asarray((score > 0.0) & (score >= highest))


def reasons(outliers: Outliers) -> list[str]:
    """Return a sentence for each point: the strongest evidence against it, "" for good ones."""
    evidence = outliers.evidence
    result = []
    for parts, bad in zip(evidence.parts, outliers.outlier, strict=True):
        strongest = int(np.argmax(parts))
        words = _WORDS[evidence.kinds[strongest]]
        result.append(f"{words} ({parts[strongest]:.1f} deviations)" if bad else "")
    return result
