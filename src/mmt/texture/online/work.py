"""One update of a model on its way through the stages, and what comes of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from mmt.texture.completion.criterion import Progress
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.faults import SignalFaults

if TYPE_CHECKING:
    from mmt.texture.field.blocks import Blocks
    from mmt.texture.model.fits import Fit
    from mmt.texture.online.surface_changes import SurfaceChange
    from mmt.texture.segmentation.segments import SampleRange, Segment
    from mmt.texture.signals.aligned import AlignedBlock
    from mmt.texture.touch_down.finding import TouchDown


class UpdateSteps(Protocol):
    """The steps of one update; see `mmt.texture.online.modeller.OnlineModeller`."""

    def fit(self, work: "Work") -> None:
        """Fit the new segments."""

    def build(self, work: "Work") -> None:
        """Build the model of the fits."""

    def judge(self, work: "Work") -> None:
        """Judge the model and set ``work.update``."""


ModelSource = Callable[[], TextureModel | None]
"""Gives the model of an update, None before the first sample."""


DEFERRED: Final = "deferred"
"""Lap of what is built of a deferred model to judge it, and built again for whoever asks for it."""


@dataclass(frozen=True)
class Made:
    """A model that there is already."""

    model: TextureModel | None = None

    def __call__(self) -> TextureModel | None:
        """Return it."""
        return self.model


@dataclass(frozen=True)
class ModelUpdate:
    """What one update did.

    ``time_s`` is the session time of the newest frame, ``distance`` the completion sum,
    ``progress`` what the criterion in use says, ``durations_s`` the seconds spent on each stage.
    Where surfaces are told apart, ``surface`` is the number of the one that all this is of,
    ``changes`` says which changes this update brings to light, in order, and ``left`` what
    has become of the models of the surfaces that were left by them. ``source`` gives ``model``.
    ``faults`` is what of the stream was no measurement, from its first frame on.
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
    changes: "tuple[SurfaceChange, ...]" = ()
    left: "tuple[ModelUpdate, ...]" = ()
    faults: SignalFaults = field(default_factory=SignalFaults)

    @property
    def model(self) -> TextureModel | None:
        """The model, None before the first sample."""
        return self.source()

    @property
    def spent_s(self) -> float:
        """Seconds of all stages, without building the model if that is deferred."""
        return sum(self.durations_s.values()) - self.durations_s.get(DEFERRED, 0.0)


@dataclass
class Work:
    """What the stages hand on from one to the next for one update.

    Each stage reads what the stages before it have set, and keeps its own state to itself, so
    that segmenting may go on while an earlier update is still fitted.

    Attributes
    ----------
    modeller
        Whose model is updated.
    time_s
        Session time of the newest frame.
    observed
        Filtered frames, for the completion criterion.
    added, removed
        Segments that are new, and the ranges of those that no longer hold.
    touched
        Touch-downs that are new.
    noise_power
        Noise power of the sensor, in (m/s2)^2.
    faults
        As in `ModelUpdate`.
    forget_from
        The first sequence number of another surface: what reaches beyond leaves the model; None
        in a usual update.
    fits
        By the fitting: all fits of the model as they are now.
    touch_downs
        By the fitting: all that the model is made of.
    removed_count
        By the fitting: how many fits have left.
    blocks, made_anew, source
        By the building: blocks that the field has gathered, whether the model is another one than
        after the last update, and what gives it.
    announced
        Whether the update is one that others hear of; where the tool leaves a surface, its model is
        also updated in between.
    surface, changes, left, session_time_s
        As in `ModelUpdate`, where surfaces are told apart.
    update
        What has come of it, once it is judged.
    """

    modeller: UpdateSteps
    time_s: float
    observed: "list[AlignedBlock]"
    added: "list[Segment]"
    removed: "list[SampleRange]"
    noise_power: float
    faults: SignalFaults = field(default_factory=SignalFaults)
    forget_from: int | None = None
    touched: "list[TouchDown]" = field(default_factory=list)
    durations_s: dict[str, float] = field(default_factory=dict)
    fits: "tuple[Fit, ...]" = ()
    touch_downs: "tuple[TouchDown, ...]" = ()
    removed_count: int = 0
    blocks: "Blocks | None" = None
    made_anew: bool = False
    source: ModelSource = Made()
    announced: bool = True
    surface: int | None = None
    changes: "tuple[SurfaceChange, ...]" = ()
    left: tuple[ModelUpdate, ...] = ()
    session_time_s: float | None = None
    update: ModelUpdate | None = None

    def of(self, modeller: UpdateSteps) -> "Work":
        """Return the same new work for another modeller."""
        return replace(self, modeller=modeller, durations_s=self.durations_s.copy())

    @property
    def samples(self) -> "NewSamples":
        """What another method learns from."""
        return NewSamples(self.time_s, self.observed, self.added, self.removed)

    def absorb(self, earlier: "Work", *, segments: bool = True) -> None:
        """Do also what an earlier update of the same model has left to do.

        Parameters
        ----------
        earlier
            The one that is not carried out.
        segments
            Whether its new segments count; what it removes always does.
        """
        gone = set(self.removed)
        kept = [s for s in earlier.added if s.span not in gone] if segments else []
        self.added = kept + self.added
        self.removed = earlier.removed + self.removed
        self.removed_count += earlier.removed_count
        self.observed = earlier.observed + self.observed
        self.touched = earlier.touched + self.touched


class NewSamples(NamedTuple):
    """What another method learns from in one update of our model: that part of its `Work`."""

    time_s: float
    observed: "list[AlignedBlock]"
    added: "list[Segment]"
    removed: "list[SampleRange]"


class Stopwatch:
    """Laps by name in ``laps``."""

    def __init__(self, laps: dict[str, float] | None = None) -> None:
        self.laps: dict[str, float] = {} if laps is None else laps
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Note the seconds since the last lap."""
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now
