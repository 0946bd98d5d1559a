"""What methods gave over seeds: medians, spreads, and paired differences with their noise."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt_lab.compare.certainty import Certainty
from mmt_lab.compare.judging import FIGURES, LARGER_IS_BETTER, MOMENTS, Judged

STANDARD_ERRORS: Final = 3.0
"""Standard errors from which on a mean difference counts as beyond noise: of about a
hundred comparisons of one run a tenth is then expected to do so by chance."""

LEAST: Final = {
    "within_jnd": 0.005,
    "power_error_db": 0.02,
    "gfc": 0.0005,
    "log_spectral_db": 0.02,
    "band_error_db": 0.02,
}
"""Differences below these count as none."""

RUN_TO_RUN_DB: Final = (0.87, 0.93, 0.93, 0.80, 0.74, 0.64, 0.63, 1.18, 1.14)
"""How the level of each of nine bands scatters between slides over one real material, dB.

Measured by `mmt_lab.surfaces.slides.scatter_db`; the source is in the page on error measures."""

ALL_RUN_TO_RUN_DB: Final = float(np.sqrt(np.mean(np.square(RUN_TO_RUN_DB))))
"""The same, root mean square over the bands."""


@dataclass(frozen=True)
class Spread:
    """Median of one figure over seeds, and its 10th and 90th percentile."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Row:
    """One method on one texture, stroke or group of them at one moment.

    ``spread`` is by figure, ``bands_db`` the median error of each band over the seeds.
    """

    name: str
    method: str
    moment: str
    sessions: int
    time_s: float
    samples: float
    spread: dict[str, Spread]
    bands_db: tuple[float, ...]


@dataclass(frozen=True)
class Difference:
    """A method less the first one, session by session.

    ``mean`` and ``standard_error`` are over sessions; ``verdict`` says whether it is better or
    worse beyond noise, or the same.
    """

    name: str
    method: str
    moment: str
    figure: str
    sessions: int
    mean: float
    standard_error: float

    @property
    def verdict(self) -> str:
        """Return ``better``, ``worse`` or ``same``."""
        noise = max(STANDARD_ERRORS * self.standard_error, LEAST[self.figure])
        gain = self.mean if self.figure in LARGER_IS_BETTER else -self.mean
        if gain > noise:
            return "better"
        return "worse" if gain < -noise else "same"


@dataclass(frozen=True)
class MethodComparison:
    """Everything that was judged."""

    methods: tuple[str, ...]
    judged: tuple[Judged, ...]
    remarks: tuple[str, ...] = ()
    certainties: tuple[Certainty, ...] = ()

    @property
    def groups(self) -> list[str]:
        """Groups of textures and strokes, in their order."""
        return list(dict.fromkeys(one.group for one in self.judged))

    def names(self, group: str) -> list[str]:
        """Return the textures or strokes of a group."""
        return list(dict.fromkeys(one.name for one in self.judged if one.group == group))

    def rows(self, name: str) -> list[Row]:
        """Return the rows of a texture or stroke, or of a whole group."""
        return [
            _row(name, method, moment, chosen)
            for moment in MOMENTS
            for method in self.methods
            if (chosen := self._chosen(name, method, moment))
        ]

    def differences(self, name: str) -> list[Difference]:
        """Return how much every other method differs from the first."""
        found = []
        for moment in MOMENTS:
            base = {_key(one): one for one in self._chosen(name, self.methods[0], moment)}
            for method in self.methods[1:]:
                pairs = [
                    (one, base[_key(one)])
                    for one in self._chosen(name, method, moment)
                    if _key(one) in base
                ]
                if pairs:
                    found += [_difference(name, method, moment, f, pairs) for f in FIGURES]
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        every = [n for group in self.groups for n in (group, *self.names(group))]
        return {
            "methods": list(self.methods),
            "run_to_run_db": list(RUN_TO_RUN_DB),
            "rows": [asdict(row) for name in every for row in self.rows(name)],
            "differences": [
                {**asdict(each), "verdict": each.verdict}
                for name in every
                for each in self.differences(name)
            ],
            "sessions": [asdict(one) for one in self.judged],
            "certainty": [asdict(one) for one in self.certainties],
            "remarks": list(self.remarks),
        }

    def sure(self, name: str | None = None) -> dict[str, list[Certainty]]:
        """Return what methods say of their error, by method; of one group or texture alone."""
        found: dict[str, list[Certainty]] = {}
        for one in self.certainties:
            if name in {None, one.name, one.group}:
                found.setdefault(one.method, []).append(one)
        return found

    def _chosen(self, name: str, method: str, moment: str) -> list[Judged]:
        return [
            one
            for one in self.judged
            if name in {one.name, one.group} and (one.method, one.moment) == (method, moment)
        ]


def _key(one: Judged) -> tuple[str, str, int]:
    return one.name, one.texture, one.seed


def _row(name: str, method: str, moment: str, chosen: Sequence[Judged]) -> Row:
    return Row(
        name=name,
        method=method,
        moment=moment,
        sessions=len(chosen),
        time_s=float(np.median([one.time_s for one in chosen])),
        samples=float(np.median([one.samples for one in chosen])),
        spread={figure: _spread(one.figures[figure] for one in chosen) for figure in FIGURES},
        bands_db=tuple(np.median([one.bands_db for one in chosen], axis=0).tolist()),
    )


def _spread(values: Iterable[float]) -> Spread:
    low, median, high = np.percentile(list(values), (10.0, 50.0, 90.0)).tolist()
    return Spread(median, low, high)


def _difference(
    name: str, method: str, moment: str, figure: str, pairs: Sequence[tuple[Judged, Judged]]
) -> Difference:
    gains: FloatArray = np.array([a.figures[figure] - b.figures[figure] for a, b in pairs])
    count = len(gains)
    error = float(gains.std(ddof=1) / np.sqrt(count)) if count > 1 else float("inf")
    return Difference(name, method, moment, figure, count, float(gains.mean()), error)
