"""Outliers against the consensus of their neighbours, whatever the order of the points.

Evidence is gathered for every point, its own samples included where they are at hand, and each
kind is centred and scaled by the median and the median deviation over all points. What is above
is squared and added: knocks only add, and to which kind of evidence depends on the knock. Of the
points above the limit those leave that are worst among their neighbours, and the rest is asked
again without them, so that a knock does not drag its neighbours along. In the end every point
that left is asked once more, by those that stayed, and may come back. What those that are
outliers then have in common is the last kind of evidence, against all points.

Nothing in it looks at the number of a point: the same points in any order give the same set.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.selection.consensus import Consensus, consensus
from mmt.texture.selection.likeness import LEAST, likeness
from mmt.texture.selection.points import ModelPoints, log_density_of
from mmt.texture.selection.transients import bursts, whitening

LIMIT: Final = 13.5
"""Score with segments from which a point is an outlier."""

MODEL_LIMIT: Final = 5.0
"""The same from the model's data alone."""

MOST: Final = 0.3
"""No larger share of the points leaves: with more, nobody knows who is right."""

SEGMENT_KINDS: Final = ("spectrum", "burst", "loud burst", "loud ring", "ring")
MODEL_KINDS: Final = ("spectrum", "level")

LIKENESS: Final = "likeness"

_ROUNDS: Final = 20
# Weight of likeness, and what the score is divided by, so that the limit stays what it is.
_LIKENESS: Final = (2.0, 1.2)
_MODEL_LIKENESS: Final = (1.0, 1.4)
_LEAST_SCALE: Final = 0.02  # of a logarithm: what differs by less is the same
_WORDS: Final = {
    "spectrum": "its spectrum has more than its neighbours'",
    "level": "it is louder than its neighbours",
    "burst": "a burst stands out of the rest of the segment",
    "loud burst": "a burst is louder than its neighbours allow",
    "loud ring": "something struck rings louder than its neighbours allow",
    "ring": "something struck rings out of the rest of the segment",
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
    neighbours: Consensus


class Memory:
    """What earlier searches found: outliers, and bursts by a segment and its neighbours.

    A search begins with the last one's outliers left out; they are asked in its end. `name`
    gives the points of the next search their numbers; what two searches in a row have not
    asked for is forgotten.
    """

    def __init__(self) -> None:
        self._numbers: IntArray = np.zeros(0, dtype=np.int64)
        self._accused: IntArray = np.zeros(0, dtype=np.int64)
        self._old: dict[bytes, FloatArray] = {}
        self._new: dict[bytes, FloatArray] = {}

    def name(self, numbers: Sequence[int]) -> None:
        """Begin a search among points of these numbers."""
        self._numbers = np.asarray(numbers, dtype=np.int64)
        self._old, self._new = self._new, {}

    def suspects(self) -> BoolArray:
        """Return which points were outliers in the last search, shape (n,)."""
        return np.isin(self._numbers, self._accused)

    def accuse(self, outlier: BoolArray) -> None:
        """Remember the outliers of this search, shape (n,)."""
        self._accused = self._numbers[outlier]

    def keys(self, members: IntArray) -> list[bytes]:
        """Return what stands for each point with its neighbours (n, k)."""
        rows = np.column_stack([self._numbers, self._numbers[members]])
        return [row.tobytes() for row in rows]

    def get(self, key: bytes) -> FloatArray | None:
        """Return what is remembered, None where nothing is."""
        row = self._new.get(key)
        if row is None:
            row = self._old.get(key)
            if row is not None:
                self._new[key] = row
        return row

    def put(self, key: bytes, row: FloatArray) -> None:
        """Remember."""
        self._new[key] = row


def least_points(dimensions: int) -> int:
    """Return how many points there must be for a consensus: a plane and as many again."""
    return 2 * (dimensions + 1)


def find_outliers(
    data: ModelPoints, limit: float | None = None, memory: Memory | None = None
) -> Outliers | None:
    """Say which points contradict their neighbours; None where there are too few to say.

    Parameters
    ----------
    data
        The points. With segments the evidence is the spectrum, two bursts and two rings, without
        them the spectrum and the level; where some are outliers also what those have in common.
    limit
        On the score; `LIMIT` or `MODEL_LIMIT` unless told.
    memory
        Of earlier searches among mostly the same points, which it has named.

    Notes
    -----
    A round costs O(n (log n + k f)), and O(samples order) for the points whose neighbours
    have changed; a handful of rounds are run.
    """
    n = len(data)
    if n < least_points(data.points.shape[1]):
        return None
    if memory is None:
        memory = Memory()
        memory.name(range(n))
    witness = _Witness(data, limit, memory)
    present = ~memory.suspects()
    for _ in range(_ROUNDS):
        neighbours = consensus(data.points, present)
        evidence = witness.hear(neighbours)
        leaving = _worst(evidence, neighbours, present)
        if not leaving.any() or (present & ~leaving).sum() < (1.0 - MOST) * n:
            break
        present &= ~leaving
    outlier = ~present & (evidence.score > evidence.limit)
    if outlier.sum() >= LEAST:
        compared = witness.compare(neighbours, evidence, outlier)
        alike = compared.score > compared.limit
        if alike.sum() <= MOST * n:
            outlier, evidence = alike, compared
    memory.accuse(outlier)
    return Outliers(outlier, evidence, neighbours)


class _Witness:
    """Gathers evidence, and remembers that of points whose neighbours stay the same."""

    def __init__(self, data: ModelPoints, limit: float | None, memory: Memory) -> None:
        self._data = data
        self._memory = memory
        self._logarithm = log_density_of(data.lsf, data.variance)
        self._kinds: tuple[str, ...]
        if data.segments is None:
            self._kinds, usual_limit = MODEL_KINDS, MODEL_LIMIT
            self._variances = np.ones(len(data))
        else:
            self._kinds, usual_limit = SEGMENT_KINDS, LIMIT
            self._variances = np.array([1.0 / max(1, len(s)) for s in data.segments])
        self._limit = usual_limit if limit is None else limit

    def hear(self, neighbours: Consensus) -> Evidence:
        """Return the evidence against every point from its neighbours."""
        predicted = neighbours.of(self._logarithm)
        excess = np.maximum(self._logarithm - predicted, 0.0)
        spread = neighbours.scatter(self._variances)
        spectrum = np.cbrt((excess**2).mean(axis=1) / (2.0 * spread))  # near normal
        if self._data.segments is None:
            level = np.log(np.exp(self._logarithm).mean(axis=1))
            raw = np.column_stack([spectrum, level - neighbours.of(level)])
        else:
            raw = np.column_stack([spectrum, self._heard_bursts(predicted, neighbours)])
        parts = _standardised(raw)
        score = (np.maximum(parts, 0.0) ** 2).sum(axis=1)
        return Evidence(self._kinds, parts, score, self._limit)

    def compare(self, neighbours: Consensus, evidence: Evidence, accused: BoolArray) -> Evidence:
        """Return the evidence with what every point has in common with the accused."""
        excess = self._logarithm - neighbours.of(self._logarithm)
        excess /= np.sqrt(neighbours.scatter(self._variances))[:, None]
        parts = _standardised(likeness(excess, accused)[:, None])
        weight, growth = _MODEL_LIKENESS if self._data.segments is None else _LIKENESS
        score = (evidence.score + weight * np.maximum(parts[:, 0], 0.0) ** 2) / growth
        kinds = (*evidence.kinds, LIKENESS)
        return Evidence(kinds, np.hstack([evidence.parts, parts]), score, evidence.limit)

    def _heard_bursts(self, predicted: FloatArray, neighbours: Consensus) -> FloatArray:
        assert self._data.segments is not None  # noqa: S101 - asked for with segments alone
        keys = self._memory.keys(neighbours.members)
        rows = [self._memory.get(key) for key in keys]
        again = [index for index, row in enumerate(rows) if row is None]
        filters = whitening(np.exp(predicted[again]), self._data.lsf.shape[1])
        found = bursts([self._data.segments[i] for i in again], filters)
        for index, row in zip(again, found, strict=True):
            rows[index] = row
            self._memory.put(keys[index], row)
        return np.array(rows)


def _standardised(raw: FloatArray) -> FloatArray:
    """Centre and scale over all points: over those left, each round would narrow the scale."""
    centre = np.median(raw, axis=0)
    scale = 1.4826 * np.median(np.abs(raw - centre), axis=0)
    return np.asarray((raw - centre) / np.maximum(scale, _LEAST_SCALE))


def _worst(evidence: Evidence, neighbours: Consensus, present: BoolArray) -> BoolArray:
    """Return the present points above the limit that no neighbour above it exceeds."""
    score = np.where(present & (evidence.score > evidence.limit), evidence.score, 0.0)
    highest = score[neighbours.members].max(axis=1)
    np.maximum.at(
        highest, neighbours.members.ravel(), np.repeat(score, neighbours.members.shape[1])
    )
    return np.asarray((score > 0.0) & (score >= highest))


def reasons(outliers: Outliers) -> list[str]:
    """Return a sentence for each point: what speaks against it most, "" for the good ones."""
    evidence = outliers.evidence
    result = []
    for parts, bad in zip(evidence.parts, outliers.outlier, strict=True):
        strongest = int(np.argmax(parts))
        words = _WORDS[evidence.kinds[strongest]]
        result.append(f"{words} ({parts[strongest]:.1f} deviations)" if bad else "")
    return result
