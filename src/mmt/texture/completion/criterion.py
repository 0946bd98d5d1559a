"""Base of the completion criteria: progress and thresholds.

A criterion says when a model is good enough to render from, and when modelling may stop. There are
two: the published sum of distances (`mmt.texture.completion.distance`) and the share of strokes
whose level is expected to be right (`mmt.texture.completion.uncertainty`). Each belongs to one
method (`mmt.texture.online.methods`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S, CriterionScale

_SAID_FALL: Final = 0.03
"""Least fall of the expected share between two updates for which a reason is given."""


@dataclass(frozen=True)
class Progress:
    """Progress of a model towards completion.

    Attributes
    ----------
    scale
        Name and thresholds of the criterion.
    value
        Value on that scale.
    cells
        Value of each cell of the input space, in the order of `distance.cells_of`: its expected
        share, or its part of the sum of distances.
    advice
        The inputs (d,), with units, of the stroke that helps most; None if nothing is known.
    """

    scale: CriterionScale
    value: float
    cells: tuple[float, ...]
    advice: tuple[float, ...] | None = None

    def __str__(self) -> str:
        if not self.scale.rises:
            return f"{self.scale.title} {self.value:.2f}"
        share = f"{100.0 * self.value:.0f} of {100.0 * self.scale.stop:.0f} %"
        if self.advice is None or self.value >= self.scale.stop:
            return share
        return f"{share}: {_strokes(self.advice)}"

    def why_less_than(self, before: "Progress") -> str:
        """Return why the expected share has fallen, "" if it fell by less than `_SAID_FALL`.

        The share is a mean over strokes, weighted by where the hand strokes. Either the cells have
        become less certain, or the weights have moved to less certain cells.
        """
        if not self.scale.rises or before.value - self.value < _SAID_FALL:
            return ""
        if sum(before.cells) - sum(self.cells) > _SAID_FALL * len(self.cells):
            return "the newest strokes differ from what the model expected"
        return "the hand now strokes where less is known"

    def as_dict(self) -> dict[str, Any]:
        """Return the name of the criterion and its value, for JSON."""
        return {"criterion": self.scale.criterion, "value": round(self.value, 4)}


def _strokes(inputs: Sequence[float]) -> str:
    """Describe strokes like one with these inputs, such as "fast strokes with 1 to 2 N"."""
    *velocity, force_n = inputs
    speed = min(int(3.0 * math.hypot(*velocity) / MAXIMUM_SPEED_MM_S), 2)
    least_n = min(int(3.0 * force_n / MAXIMUM_FORCE_N), 2) * MAXIMUM_FORCE_N / 3.0
    most_n = least_n + MAXIMUM_FORCE_N / 3.0
    return f"{('slow', 'medium', 'fast')[speed]} strokes with {least_n:.0f} to {most_n:.0f} N"


class Criterion:
    """Base class of the completion criteria, with the state after the newest update.

    Attributes
    ----------
    scale
        Name and thresholds of the criterion.
    progress
        Progress after the newest update.
    start_s, stop_s
        The session time at which each threshold was first met, None before.
    """

    progress: Progress

    def __init__(self, scale: CriterionScale) -> None:
        self.scale = scale
        self.start_s: float | None = None
        self.stop_s: float | None = None

    @property
    def started(self) -> bool:
        """Whether rendering from the model may start."""
        return self.start_s is not None

    @property
    def stopped(self) -> bool:
        """Whether modelling is to end."""
        return self.stop_s is not None

    def revoke_since(self, since_s: float) -> None:
        """Revoke thresholds met later than `since_s` that the present value does not meet."""
        value, scale = self.progress.value, self.scale
        if self.start_s is not None and self.start_s > since_s:
            self.start_s = self.start_s if scale.meets(value, scale.start) else None
        if self.stop_s is not None and self.stop_s > since_s:
            self.stop_s = self.stop_s if scale.meets(value, scale.stop) else None

    def record_value(self, value: float, time_s: float) -> None:
        """Record which thresholds a value meets at a session time (s)."""
        if self.start_s is None and self.scale.meets(value, self.scale.start):
            self.start_s = time_s
        if self.stop_s is None and self.scale.meets(value, self.scale.stop):
            self.stop_s = time_s
