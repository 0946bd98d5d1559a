"""Results of methods over sessions: usual and worst values, paired differences, and falls."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from typing import Any, Final

import numpy as np

from mmt.evaluation.model_errors import PooledFigure, across
from mmt_lab.compare.judging import (
    FIGURES,
    LARGER_IS_BETTER,
    MOMENTS,
    SHARES,
    Certainty,
    JudgedMethod,
)

STANDARD_ERRORS: Final = 3.0
"""A mean difference of more than so many standard errors counts as beyond noise. By chance alone
about 0.3 % of the comparisons would."""

RUN_TO_RUN_DB: Final = 0.89
"""Scatter of the level of one of nine bands between slides over one real material, root mean
square over the bands, dB.

Measured by `mmt_lab.surfaces.slides.scatter_db`; the source is in the page on error measures."""


@dataclass(frozen=True)
class MethodRow:
    """Results of one method at one moment, over the sessions of a texture or group.

    ``sessions`` is the number of all sessions. The other values are over the sessions that reached
    the moment: ``time_s`` and ``samples`` are medians, ``figures`` summaries.
    """

    name: str
    spoil: str
    method: str
    moment: str
    sessions: int
    time_s: float
    samples: float
    figures: dict[str, PooledFigure]


@dataclass(frozen=True)
class MethodDifference:
    """Mean difference of a figure between a method and the first one, paired by session."""

    name: str
    method: str
    moment: str
    figure: str
    sessions: int
    mean: float
    standard_error: float

    @property
    def verdict(self) -> str:
        """Return ``better`` or ``worse`` if the difference is beyond noise, else ``same``."""
        gain = self.mean if self.figure in LARGER_IS_BETTER else -self.mean
        if abs(gain) <= STANDARD_ERRORS * self.standard_error:
            return "same"
        return "better" if gain > 0.0 else "worse"


@dataclass(frozen=True)
class Fall:
    """Fall of a share when sessions are spoilt, over all sessions.

    ``before`` and ``after`` are means; ``mean``, ``percentile_95`` and ``most`` are of the fall.
    ``samples`` is the mean number of samples of the model afterwards.
    """

    spoil: str
    method: str
    moment: str
    figure: str
    sessions: int
    before: float
    after: float
    mean: float
    percentile_95: float
    most: float
    samples: float


@dataclass(frozen=True)
class MethodComparison:
    """All that was judged, with summaries."""

    methods: tuple[str, ...]
    judged: tuple[JudgedMethod, ...]
    certainties: tuple[Certainty, ...] = ()

    @cached_property
    def groups(self) -> list[str]:
        """Groups of textures, in their order."""
        return list(dict.fromkeys(one.group for one in self.judged))

    @cached_property
    def spoils(self) -> list[str]:
        """Names of the disturbances that spoil sessions, in their order."""
        return [spoil for spoil in dict.fromkeys(one.spoil for one in self.judged) if spoil]

    @cached_property
    def sure(self) -> dict[str, list[Certainty]]:
        """What methods state of their own error in sessions that are not spoilt, by method."""
        found: dict[str, list[Certainty]] = {one.method: [] for one in self.certainties}
        for one in self.certainties:
            if not one.spoil:
                found[one.method].append(one)
        return found

    @property
    def several_rates(self) -> bool:
        """Whether a session has another acceleration rate than 1 kHz."""
        return any(one.acceleration_rate_hz != 1000 for one in self.judged)

    def names(self, group: str) -> list[str]:
        """Return the textures of a group."""
        return list(dict.fromkeys(one.name for one in self.judged if one.group == group))

    def rows(self, name: str, spoil: str = "") -> list[MethodRow]:
        """Return the rows of a texture, or of a whole group."""
        whole = len({_key(one) for one in self._chosen(name, spoil)})
        rows = []
        for moment, method in product(MOMENTS, self.methods):
            if chosen := self._chosen(name, spoil, method, moment):
                time_s = float(np.median([one.time_s for one in chosen]))
                samples = float(np.median([one.samples for one in chosen]))
                figures = {
                    figure: across(values, larger_is_better=figure in LARGER_IS_BETTER)
                    for figure in FIGURES
                    if (values := [o.figures[figure] for o in chosen if figure in o.figures])
                }
                rows.append(MethodRow(name, spoil, method, moment, whole, time_s, samples, figures))
        return rows

    def differences(self, name: str) -> list[MethodDifference]:
        """Return how much every other method differs from the first, at the same moments."""
        found = []
        for moment in MOMENTS:
            base = {_key(one): one for one in self._chosen(name, "", self.methods[0], moment)}
            for method, figure in product(self.methods[1:], FIGURES):
                gains = [
                    one.figures[figure] - base[_key(one)].figures[figure]
                    for one in self._chosen(name, "", method, moment)
                    if _key(one) in base and figure in one.figures
                    if figure in base[_key(one)].figures
                ]
                if count := len(gains):
                    error = np.std(gains, ddof=1) / np.sqrt(count) if count > 1 else np.inf
                    mean, error = float(np.mean(gains)), float(error)
                    found.append(MethodDifference(name, method, moment, figure, count, mean, error))
        return found

    def falls(self, moment: str = "30 s") -> list[Fall]:
        """Return the falls of both shares at a moment, over all sessions."""
        found = []
        for spoil in self.spoils:
            for method in self.methods:
                before = self._chosen(None, "", method, moment)
                after = {_key(one): one for one in self._chosen(None, spoil, method, moment)}
                if before and after:
                    found += [_fall(spoil, figure, before, after) for figure in SHARES]
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return all results as a dictionary for JSON."""
        every = [n for group in self.groups for n in (group, *self.names(group))]
        ways = ("", *self.spoils)
        rows = [row for name in every for spoil in ways for row in self.rows(name, spoil)]
        return {
            "methods": list(self.methods),
            "rows": [
                {**asdict(row), "figures": {key: of._asdict() for key, of in row.figures.items()}}
                for row in rows
            ],
            "differences": [
                {**asdict(each), "verdict": each.verdict}
                for name in every
                for each in self.differences(name)
            ],
            "falls": [asdict(fall) for fall in self.falls()],
            "sessions": [asdict(one) for one in self.judged],
            "certainty": [asdict(one) for one in self.certainties],
        }

    def _chosen(
        self, name: str | None, spoil: str, method: str | None = None, moment: str | None = None
    ) -> list[JudgedMethod]:
        """Return the matching results; None matches all."""
        return [
            one
            for one in self.judged
            if one.spoil == spoil
            and name in {None, one.name, one.group}
            and method in {None, one.method}
            and moment in {None, one.moment}
        ]


def _key(one: JudgedMethod) -> tuple[str, str, int]:
    return one.name, one.texture, one.seed


def _fall(
    spoil: str,
    figure: str,
    before: Sequence[JudgedMethod],
    after: dict[tuple[str, str, int], JudgedMethod],
) -> Fall:
    pairs = [(one, after[_key(one)]) for one in before]
    whole = np.array([one.figures[figure] for one, _ in pairs])
    spoilt = np.array([other.figures[figure] for _, other in pairs])
    return Fall(
        spoil=spoil,
        method=before[0].method,
        moment=before[0].moment,
        figure=figure,
        sessions=len(pairs),
        before=float(whole.mean()),
        after=float(spoilt.mean()),
        mean=float((whole - spoilt).mean()),
        percentile_95=float(np.percentile(whole - spoilt, 95.0)),
        most=float((whole - spoilt).max()),
        samples=float(np.mean([other.samples for _, other in pairs])),
    )
