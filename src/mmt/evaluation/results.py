"""The results of an evaluation: plain values for tables, figures and JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, is_dataclass
from typing import Any, Final, Literal

from mmt.core.arrays import FloatArray
from mmt.core.output.plottable import Plottable
from mmt.evaluation.model_errors import HeadingErrors
from mmt.evaluation.texts import DEFINITIONS
from mmt.session.operators import ControlPeriod, control_sentence
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import ModelHistory
from mmt.texture.settings import THRESHOLDS, ModellingSettings
from mmt.texture.signals.aligned import SignalFaults
from mmt.texture.synthesis.actuator import skin_sentence
from mmt.texture.touch_down.fitting import HeldOutErrors

Basis = Literal["truth", "held-out"]
"""The reference of the power error and of the share within one JND."""

Limit = Literal["beyond the samples", "heading", "sparse", "fit", "interpolation", "field"]
"""Cause of a model's error at its worst point."""


@dataclass(frozen=True)
class Levels:
    """Errors of a model's level over the strokes that were made, and over the plane.

    Power errors are root mean squares in dB, shares are of strokes within one JND. If the truth is
    not known, the strokes are those of the held-out segments and the plane's figures are None.
    """

    power_error_db: float | None = None
    within_jnd: float | None = None
    plane_power_error_db: float | None = None
    plane_within_jnd: float | None = None


@dataclass(frozen=True)
class Score:
    """The figures of one moment of a session.

    ``samples``, ``distance``, ``completion``, ``truth_gfc``, ``truth_log_spectral_db`` and, if the
    truth is known, the errors of the level (as in `Levels`) are those of the leader's model at that
    time. ``update_ms`` is the time of its update, until it was ready to render, ``beside`` the
    errors of the other method's model.
    ``gfc``, ``gfc_ceiling`` and the two ``held_out`` figures are those of the model rebuilt
    without the held-out segments. Figures are None if there was no model yet.
    """

    time_s: float
    samples: int
    distance: float
    completion: float
    update_ms: float | None
    gfc: float | None
    gfc_ceiling: float | None
    power_error_db: float | None
    within_jnd: float | None
    plane_power_error_db: float | None
    plane_within_jnd: float | None
    beside: Levels
    truth_gfc: float | None
    truth_log_spectral_db: float | None
    held_out_power_error_db: float | None
    held_out_within_jnd: float | None
    rebuilt_samples: int
    rebuilt_distance: float


@dataclass(frozen=True)
class Worst:
    """The point of the grid where the model is farthest from the known texture.

    ``measure`` is "power" or "gfc". ``nearest_sample`` is the distance to the nearest sample
    in the normalised plane, ``heading_deg`` None if the texture is the same in all
    directions, ``boundary_share`` the weight of boundary points there.
    ``limit`` names what limits the model, ``reason`` explains it in a sentence.
    """

    measure: Literal["power", "gfc"]
    speed_mm_s: float
    force_n: float
    heading_deg: float | None
    power_error_db: float
    gfc: float
    nearest_sample: float
    boundary_share: float
    limit: Limit
    reason: str


@dataclass(frozen=True)
class Band:
    """Error of the power in a band of frequency, root mean square in dB; None without a bin."""

    low_hz: float
    high_hz: float
    error_db: float | None


@dataclass(frozen=True)
class Cell:
    """One of the cells of the input space; `far` if it exceeds its share of the stop distance.

    ``heading_deg`` is None if the heading does not count, or the cell is around rest.
    """

    speed_mm_s: float
    force_n: float
    distance: float
    far: bool
    heading_deg: float | None = None


@dataclass(frozen=True)
class Coverage:
    """The part of the plane that the hand has covered.

    ``speed_mm_s`` and ``force_n`` are the 5th and 95th percentile while the tool stroked
    the surface, None if it never did; ``stroking_s`` is how long it did.
    """

    cells: tuple[Cell, ...]
    stroking_s: float
    speed_mm_s: tuple[float, float] | None
    force_n: tuple[float, float] | None
    remark: str


@dataclass(frozen=True)
class HeldOutSegment:
    """A recorded segment that the rebuilt model was built without, and its rendering of it.

    Spectra are amplitudes (roots of the power spectral density), m/s2 per root hertz:
    Welch's at ``frequencies_hz``, and exact at every Hz from 0 for
    ``truth``. ``synthesized``, ``gfc`` and the power error are None if the rebuilt model does
    not exist, ``truth`` if the texture is not known.
    """

    start_s: float
    stop_s: float
    speed_mm_s: float
    force_n: float
    power: float
    gfc: float | None
    power_error_db: float | None
    frequencies_hz: FloatArray = field(repr=False)
    measured: FloatArray = field(repr=False)
    synthesized: FloatArray | None = field(repr=False)
    truth: FloatArray | None = field(repr=False)


@dataclass(frozen=True)
class AtSkin:
    """Vibration that reaches the skin through the actuator of the session.

    From 10 to 500 Hz. ``played_share`` is the share of the texture's power that the actuator plays,
    over the strokes made. ``power_error_db`` is the root mean square of the level error, the
    model's own included, against the known texture, or against the model if there is none.
    """

    played_share: float
    low_hz: float
    power_error_db: float


@dataclass(frozen=True)
class PowerMap:
    """Power error (dB) of the leader's model over the grid, shape (forces, speeds)."""

    speed_mm_s: FloatArray
    force_n: FloatArray
    power_error_db: FloatArray
    gfc: FloatArray


@dataclass(frozen=True, repr=False)
class Evaluation(Plottable):
    """One session, evaluated as in paper A; ``print`` shows its table.

    ``beside`` is the name of the other method, which is scored on the same session.
    ``start_s`` and ``stop_s`` are the session times at which the criteria were met, None
    if they were not. ``at_start``, ``at_stop`` and ``at_end`` are the figures at exactly
    these moments, ``bands`` those of `final`. ``models`` holds the leader's model after each update
    with its time; ``course`` (k, 2) time and value of the completion criterion of every update;
    ``by_heading`` is empty unless the texture depends on the heading.
    ``faults`` are the parts of its signals that were no measurement.
    ``control`` says who moved the robot when, in times of the whole session, and is empty if
    control was never handed over. No figure depends on it, as all follow from what the robot
    measured. ``at_skin`` is None if the recording does not hold the actuator's response,
    ``touch_downs`` if too few were found to hold one out.
    """

    name: str
    path: str
    surface: str | None
    duration_s: float
    complete: bool
    missing_frames: int
    faults: SignalFaults
    settings: ModellingSettings
    beside: str
    period_s: float
    step_s: float
    seed: int
    order: int
    basis: Basis
    basis_reason: str
    start_s: float | None
    stop_s: float | None
    steps: tuple[Score, ...]
    at_start: Score | None
    at_stop: Score | None
    at_end: Score
    worst: tuple[Worst, ...]
    bands: tuple[Band, ...]
    by_heading: tuple[HeadingErrors, ...]
    coverage: Coverage
    held_out: tuple[HeldOutSegment, ...]
    processing_s: float
    course: FloatArray = field(repr=False)
    models: ModelHistory = field(repr=False)
    power_map: PowerMap | None = field(repr=False)
    control: tuple[ControlPeriod, ...] = ()
    at_skin: AtSkin | None = None
    touch_downs: HeldOutErrors | None = None

    @property
    def times_real_time(self) -> float:
        """Seconds of session per second of processing."""
        return self.duration_s / max(self.processing_s, 1e-9)

    @property
    def update_ms(self) -> tuple[float, float] | None:
        """Mean and largest time of the updates that the steps show, None without any."""
        times = [float(step.update_ms) for step in self.steps if step.update_ms]
        return (sum(times) / len(times), max(times)) if times else None

    @property
    def final(self) -> Score:
        """The figures at the stop criterion, or at the end if it was never met."""
        return self.at_stop or self.at_end

    @property
    def remark(self) -> str:
        """Sentences on coverage, signal faults, changes of control, actuator and touch-downs."""
        fault = self.faults.sentence()
        sentences = [self.coverage.remark] + [f"Not measured: {fault}."] * bool(fault)
        if self.control:
            sentences.append(control_sentence(self.control))
            sentences.append("The figures are by the strokes of all of them.")
        if self.at_skin is not None:
            skin = self.at_skin
            sentence = skin_sentence(skin.played_share, skin.low_hz)
            sentences.append(
                f"{sentence[0].upper()}{sentence[1:]}; with the model's own error "
                f"{skin.power_error_db:.1f} dB there."
            )
        if self.touch_downs is not None:
            sentences.append(self.touch_downs.sentence)
        return " ".join(sentences)

    def model_at(self, time_s: float | None) -> TextureModel | None:
        """Return the model that the leader had at a session time, None before the first."""
        return self.models.model_at(time_s)

    def __repr__(self) -> str:
        met = [
            f"{name} {'never' if at_s is None else f'at {at_s:.1f} s'}"
            for name, at_s in (("started", self.start_s), ("stopped", self.stop_s))
        ]
        error = self.final.power_error_db
        level = "" if error is None else f", power error over its strokes {error:.2f} dB"
        return (
            f"<Evaluation of {self.name}: {len(self.steps)} steps over {self.duration_s:.1f} s, "
            f"{', '.join(met)}, {self.final.samples} samples{level}>"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the evaluation for a program; the keys are documented for `mmt evaluate`."""
        scale = self.settings.scale  # "auto" resolved
        own = THRESHOLDS[self.settings.method]
        other = {
            "session": self.name,
            "faults": self.faults.as_dict(),
            "method": self.settings.method,
            "control": [period.as_dict() for period in self.control],
            "held_out": [_held_out(segment) for segment in self.held_out],
            "settings": {**asdict(self.settings), own[0]: scale.start, own[1]: scale.stop},
            "times_real_time": round(self.times_real_time, 2),
        }
        return {key: other[key] if key in other else _plain(getattr(self, key)) for key in _KEYS}


_KEYS: Final = (
    *("session", "path", "surface", "duration_s", "complete", "missing_frames", "faults", "basis"),
    *("basis_reason", "order", "method", "beside", "start_s", "stop_s", "steps", "at_start"),
    *("at_stop", "at_end", "worst", "bands", "by_heading", "control", "coverage", "at_skin"),
    *("touch_downs", "held_out", "period_s", "step_s", "seed", "settings", "processing_s"),
    "times_real_time",
)
"""Keys of an evaluation for a program, in their order."""


def evaluations_as_dict(evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """Return what ``mmt evaluate --json`` writes.

    ``sessions`` lists every session. The keys of a single session are at the top level as
    well, so that a script can read ``start_s`` directly.
    """
    sessions = [evaluation.as_dict() for evaluation in evaluations]
    only = sessions[0] if len(sessions) == 1 else {}
    return {**only, "sessions": sessions, "definitions": dict(DEFINITIONS)}


def _held_out(segment: HeldOutSegment) -> Any:
    names = ("start_s", "stop_s", "speed_mm_s", "force_n", "power", "gfc", "power_error_db")
    return _plain({name: getattr(segment, name) for name in names})


def _plain(value: Any) -> Any:
    """Return a value for JSON: floats with six digits behind the point, None if not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
