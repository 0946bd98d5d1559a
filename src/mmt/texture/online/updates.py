"""Work of one update of a model, its result, and changes of the surface under the tool."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Protocol

from mmt.texture.completion.criterion import Progress
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.aligned import AlignedBlock, SignalFaults

if TYPE_CHECKING:
    from mmt.texture.field.blocks import Blocks
    from mmt.texture.model.fits import Fit
    from mmt.texture.segmentation.segmenter import SampleRange, Segment
    from mmt.texture.touch_down.fitting import TouchDown


@dataclass(frozen=True)
class SurfaceChange:
    """A change of the surface under the tool.

    ``kind``: a ``"new"`` surface; one met before, ``"recalled"`` by a person; or the new one,
    ``"identified"`` by a person as one met before. ``before`` and ``surface`` are the numbers of
    the two surfaces. ``from_sample``: the first sample that is no longer the former one's;
    ``at_sample``: the sample at which it was detected or said. ``evidence``: natural logarithm
    of the Bayes factor, None if a person said it.
    """

    kind: Literal["new", "recalled", "identified"]
    before: int
    surface: int
    from_sample: int
    at_sample: int
    evidence: float | None = None


class SurfaceStatement(NamedTuple):
    """Statement of a person: from this sample (sequence number) on, the tool is on a surface."""

    sample: int
    surface: int


def surface_statements(events: Iterable[Mapping[str, Any]]) -> list[SurfaceStatement]:
    """Return the statements of persons from a recording's events of surface changes."""
    stated = [
        (event.get("at_sample"), event.get("surface"))
        for event in events
        if "evidence" in event and event["evidence"] is None
    ]
    return [
        SurfaceStatement(sample, surface)
        for sample, surface in stated
        if isinstance(sample, int) and isinstance(surface, int) and sample >= 0 < surface
    ]


class UpdateSteps(Protocol):
    """The steps of one update; see `mmt.texture.online.modeller.OnlineModeller`."""

    def fit(self, work: "UpdateWork") -> None:
        """Fit the new segments."""

    def build(self, work: "UpdateWork") -> None:
        """Build the model of the fits."""

    def judge(self, work: "UpdateWork") -> "ModelUpdate":
        """Judge the model; set and return ``work.update``."""


ModelSource = Callable[[], TextureModel | None]
"""Returns the model of an update, None before the first sample."""


DEFERRED: Final = "deferred"
"""Lap of building a deferred model to judge it; access builds it again."""


@dataclass(frozen=True)
class ReadyModel:
    """Source of a model that is already built."""

    model: TextureModel | None = None

    def __call__(self) -> TextureModel | None:
        """Return the model."""
        return self.model


@dataclass(frozen=True)
class ModelUpdate:
    """Result of one update.

    ``time_s`` is the session time of the newest frame, ``distance`` the completion sum,
    ``progress`` that of the criterion in use, ``durations_s`` the seconds spent on each stage.
    If surfaces are told apart, ``surface`` is the number of the surface modelled, ``changes``
    lists the changes of surface found in this update, in order, and ``left`` the last updates of
    the models of the surfaces left. ``source`` returns ``model``. ``faults`` are those of the
    stream's signals, from its first frame on.
    """

    time_s: float
    samples: int
    added: int
    removed: int
    distance: float
    progress: Progress
    order: int
    started: bool
    stopped: bool
    source: ModelSource
    durations_s: dict[str, float]
    surface: int | None = None
    changes: tuple[SurfaceChange, ...] = ()
    left: "tuple[ModelUpdate, ...]" = ()
    faults: SignalFaults = field(default_factory=SignalFaults)

    @property
    def model(self) -> TextureModel | None:
        """The model, None before the first sample."""
        return self.source()

    @property
    def spent_s(self) -> float:
        """Seconds of all stages, without building a deferred model."""
        return sum(self.durations_s.values()) - self.durations_s.get(DEFERRED, 0.0)


@dataclass
class UpdateWork:
    """Data of one update that each stage passes to the next.

    Each stage reads the results of the stages before it and keeps its own state private, so that
    segmenting can continue while an earlier update is still being fitted.

    Attributes
    ----------
    modeller
        Modeller whose model is updated.
    time_s
        Session time of the newest frame.
    observed
        Filtered frames, for the completion criterion.
    added, removed
        New segments, and the ranges of segments that are no longer valid.
    touched
        New touch-downs.
    noise_power
        Noise power of the sensor, in (m/s2)^2.
    faults
        As in `ModelUpdate`.
    forget_from
        The first sequence number of another surface: segments that reach beyond it are removed.
        None in a usual update.
    fits, new_fits, removed_fits
        Set by ``fit``: all fits of the model, the new ones, and the numbers of removed ones.
    touch_downs
        Set by ``fit``: all touch-downs of the model.
    removed_count
        Set by ``fit``: number of removed fits.
    blocks, made_anew, source
        Set by ``build``: new blocks of the field, whether the model differs from that of the last
        update, and the source of the model.
    announced
        Whether the update is reported; further updates of a surface that the tool leaves are not.
    surface, changes, left, session_time_s
        As in `ModelUpdate` if surfaces are told apart; ``session_time_s`` is its ``time_s``.
    update
        Set by ``judge``: the result.
    """

    modeller: UpdateSteps
    time_s: float
    observed: list[AlignedBlock]
    added: "list[Segment]"
    removed: "list[SampleRange]"
    noise_power: float
    faults: SignalFaults = field(default_factory=SignalFaults)
    forget_from: int | None = None
    touched: "list[TouchDown]" = field(default_factory=list)
    durations_s: dict[str, float] = field(default_factory=dict)
    fits: "tuple[Fit, ...]" = ()
    new_fits: "list[Fit]" = field(default_factory=list)
    removed_fits: set[int] = field(default_factory=set)
    touch_downs: "tuple[TouchDown, ...]" = ()
    removed_count: int = 0
    blocks: "Blocks | None" = None
    made_anew: bool = False
    source: ModelSource = ReadyModel()
    announced: bool = True
    surface: int | None = None
    changes: tuple[SurfaceChange, ...] = ()
    left: tuple[ModelUpdate, ...] = ()
    session_time_s: float | None = None
    update: ModelUpdate | None = None

    def copy_for(self, modeller: UpdateSteps) -> "UpdateWork":
        """Return a copy of new work for another modeller."""
        return replace(self, modeller=modeller, durations_s=self.durations_s.copy())

    @property
    def samples(self) -> "NewSamples":
        """Input of another method of modelling."""
        return NewSamples(self.time_s, self.observed, self.added, self.removed)

    def merge(self, earlier: "UpdateWork", *, segments: bool = True) -> None:
        """Add the work of an earlier update of the same model that was not carried out.

        Parameters
        ----------
        earlier
            Work of that update.
        segments
            Whether to add its new segments; its removals are always added.
        """
        gone = set(self.removed)
        kept = [s for s in earlier.added if s.span not in gone] if segments else []
        self.added = kept + self.added
        self.removed = earlier.removed + self.removed
        self.removed_count += earlier.removed_count
        self.observed = earlier.observed + self.observed
        self.touched = earlier.touched + self.touched


class NewSamples(NamedTuple):
    """Part of the `UpdateWork` of one update that is the input of another method of modelling."""

    time_s: float
    observed: list[AlignedBlock]
    added: "list[Segment]"
    removed: "list[SampleRange]"


class Stopwatch:
    """Stopwatch that records laps by name in ``laps``."""

    def __init__(self, laps: dict[str, float] | None = None) -> None:
        self.laps: dict[str, float] = {} if laps is None else laps
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Record the seconds since the last lap."""
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now
