"""When a model is good enough to render from, and when to stop modelling: what criteria share.

Two stand behind the one protocol here: the published sum of distances
(`mmt.texture.completion.distance`) and the share of strokes whose level is expected to be right
(`mmt.texture.completion.uncertainty`). Which one runs is known to
`mmt.texture.completion.criteria` alone.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from mmt.texture.settings import CriterionScale
from mmt.texture.signals.aligned import AlignedBlock

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel


@dataclass(frozen=True)
class Progress:
    """How far a model is.

    Attributes
    ----------
    scale
        What is measured, and the thresholds.
    value
        On that scale.
    cells
        Of each cell of the input space, in the order of `completion.cells_of`: on the same
        scale, or its part of it.
    advice
        The inputs (d,), with units, of the stroke that helps most; None where nothing is known.
    """

    scale: CriterionScale
    value: float
    cells: tuple[float, ...]
    advice: tuple[float, ...] | None = None

    def __str__(self) -> str:
        return f"{self.scale.title} {self.value:.2f}"

    def as_dict(self) -> dict[str, Any]:
        """Return which criterion it is and its value, for a program."""
        return {"criterion": self.scale.criterion, "value": round(self.value, 4)}


class Criterion(Protocol):
    """Judges the model after each update.

    Attributes
    ----------
    progress
        After the newest update.
    start_s, stop_s
        The session time at which each threshold was first met, None before.
    """

    progress: Progress
    start_s: float | None
    stop_s: float | None

    def observe(self, block: AlignedBlock) -> None:
        """Take the newest of the stream: how the operator moves."""

    def update(self, model: "TextureModel | None", time_s: float) -> None:
        """Take the model, None where there is none, at a session time in seconds."""

    def revoke_since(self, since_s: float) -> None:
        """Count a threshold that was met later than `since_s` as not met where it is not."""

    @property
    def started(self) -> bool:
        """Whether rendering from the model may start."""

    @property
    def stopped(self) -> bool:
        """Whether modelling is to end."""


class Thresholds:
    """When the thresholds of a scale were first met; the base of criteria."""

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
        """Count a threshold that was met later than `since_s` as not met where it is not."""
        value, scale = self.progress.value, self.scale
        if self.start_s is not None and self.start_s > since_s:
            self.start_s = self.start_s if scale.meets(value, scale.start) else None
        if self.stop_s is not None and self.stop_s > since_s:
            self.stop_s = self.stop_s if scale.meets(value, scale.stop) else None

    def meet(self, value: float, time_s: float) -> None:
        """Note what a value meets at a session time."""
        if self.start_s is None and self.scale.meets(value, self.scale.start):
            self.start_s = time_s
        if self.stop_s is None and self.scale.meets(value, self.scale.stop):
            self.stop_s = time_s
