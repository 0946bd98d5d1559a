"""Judge methods on one session: build a model by each, and compare it with the known texture.

All models, also those of spoilt sessions, are judged over the strokes of the unspoilt session. The
error that a model states is checked at every update. Such a model expects a share of the coming
strokes to be within one JND, if these are like the strokes so far mixed with `PRIOR_S` seconds over
the whole plane. This share is compared with the same mixture of the true shares over the strokes so
far and over the plane.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from mmt.core.arrays import BoolArray, RecordArray
from mmt.evaluation.model_errors import GridErrors, root_mean_square
from mmt.evaluation.strokes_made import StrokesMade
from mmt.evaluation.truth import KnownTexture, TruthAt
from mmt.texture.completion.uncertainty import PRIOR_S
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import ModelHistory, build, stream_blocks
from mmt.texture.settings import JND_DB, ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.metrics import within_jnd
from mmt_lab.compare.ablations import INGREDIENTS, without
from mmt_lab.compare.cases import ComparisonCase
from mmt_lab.compare.spoiling import spoilt
from mmt_lab.harness.experiment import chosen_names

METHODS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {"published": {"method": "published"}, "field": {"method": "field"}}
)
"""Keys of ``[texture]`` by the method's name; ``field-NAME`` is the field without one of
`mmt_lab.compare.ablations.INGREDIENTS`."""

TIMES_S: Final = (3.0, 10.0, 20.0, 30.0)

MOMENTS: Final = (*(f"{time_s:g} s" for time_s in TIMES_S), "start", "stop")
"""Moments at which methods are compared; start and stop are those of each method's criteria."""

SHARES: Final = ("within_jnd", "plane_within_jnd")

FIGURES: Final = (
    *("within_jnd", "plane_within_jnd", "power_error_db", "plane_power_error_db"),
    *("gfc", "log_spectral_db", "band_error_db"),
)
"""Names of the figures that are compared, over the strokes made or over the plane."""

LARGER_IS_BETTER: Final = frozenset({*SHARES, "gfc"})

PERIOD_S: Final = 1.0


@dataclass(frozen=True)
class JudgedMethod:
    """Figures of one method at one moment of one session.

    Attributes
    ----------
    group, name, texture, seed, acceleration_rate_hz
        As in the `ComparisonCase`.
    spoil
        Name of the disturbance that spoils the session, empty if there is none.
    method, moment
        Name of the method, and one of `MOMENTS`.
    time_s, samples
        Session time, and samples of the model.
    figures
        Values by the names in `FIGURES`. Without a model only the shares, which are then 0.
    expected, true, standardised
        For a model that states its error: expected and true share of the same strokes, and root
        mean square over the strokes made of the level's error, each divided by its predicted
        standard deviation. None for other models.
    bands_db
        Errors of the power in each band, root mean square over the strokes made; empty without a
        model.
    above_500_hz
        Share of the texture's power over these strokes that is above 500 Hz: 1 kHz lacks it.
    """

    group: str
    name: str
    texture: str
    seed: int
    spoil: str
    method: str
    moment: str
    time_s: float
    samples: int
    figures: dict[str, float]
    expected: float | None = None
    true: float | None = None
    standardised: float | None = None
    acceleration_rate_hz: int = 1000
    bands_db: tuple[float, ...] = ()
    above_500_hz: float = 0.0


@dataclass(frozen=True)
class Certainty:
    """Expected and true shares of the models of one method in one session.

    ``updates`` has time (s), expected share and true share of each update with a model.
    """

    group: str
    name: str
    spoil: str
    method: str
    updates: tuple[tuple[float, float, float], ...]


def chosen_methods(listed: str) -> list[str]:
    """Return the methods between the commas of ``--methods``; errors as of `chosen_names`."""
    return chosen_names("--methods", listed, [*METHODS, *(f"field-{n}" for n in INGREDIENTS)])


def settings_of(case: ComparisonCase, method: str) -> ModellingSettings:
    """Return the settings of a method for a session; an ingredient in its name is ignored."""
    return ModellingSettings(
        inputs=case.inputs,
        samples_per_frame=case.samples_per_frame,
        **METHODS[method.partition("-")[0]],
    )


def blocks_of(frames: RecordArray) -> list[RecordArray]:
    """Return the frames of a session, one block for each update."""
    return list(stream_blocks([frames], round(PERIOD_S * 1000.0)))


def judge(
    case: ComparisonCase, methods: Sequence[str], spoils: Sequence[str] = ()
) -> tuple[list[JudgedMethod], list[Certainty]]:
    """Judge methods on one session, as it is and spoilt in each of some ways.

    This costs a pass of modelling for each method and way.
    """
    frames = case.session()
    judge = SessionJudge(case, frames)
    for spoil in ("", *spoils):
        blocks = blocks_of(spoilt(frames, spoil, case.seed) if spoil else frames)
        for method in methods:
            with without(method.partition("-")[2]):
                judge.add(method, spoil, blocks)
    return judge.judged, judge.certainties


class SessionJudge:
    """Judge the models of methods on one session, over the strokes that its hand made.

    Parameters
    ----------
    case
        The session.
    frames
        Its frames (n,), before anything spoils them.
    """

    def __init__(self, case: ComparisonCase, frames: RecordArray) -> None:
        self.case = case
        self.truth = KnownTexture(case.surface)
        settings = ModellingSettings(samples_per_frame=case.samples_per_frame)
        made, stream = StrokesMade(settings), StreamFilter(settings)
        self._stroked_s = []
        for block in blocks_of(frames):
            made.add(stream.process(block))
            self._stroked_s.append(made.total_s)
        strokes = made.strokes()
        self.made: TruthAt = self.truth.at(strokes)
        self._above_500_hz = self.made.share_above(500.0)
        count = len(strokes.force_n)
        self._place_s = (np.arange(count) + 0.5) * made.total_s / count
        self.judged: list[JudgedMethod] = []
        self.certainties: list[Certainty] = []

    def add(self, method: str, spoil: str, blocks: Sequence[RecordArray]) -> None:
        """Build the models of a method, and judge them."""
        history = build(blocks, settings_of(self.case, method))
        labels = {**self.case.labels, "spoil": spoil, "method": method}
        certain = history.updates[-1].progress.scale.rises
        shares: dict[int, tuple[float, float, float]] = {}
        for number, update in enumerate(history.updates if certain else ()):
            if (model := update.model) is not None:
                true = self._mixed_share(model, update.time_s)
                shares[number] = (update.time_s, update.progress.value, true)
        for moment, time_s in moments_of(history).items():
            number = history.number(time_s)
            model = history.model(number)
            judged = JudgedMethod(
                **labels,
                moment=moment,
                time_s=time_s,
                above_500_hz=self._above_500_hz,
                **self._figures(model),
            )
            if number in shares and model is not None:
                _, expected, true = shares[number]
                _, deviation_db = model.level_db(*self.made.strokes.inputs(model.space).T)
                standardised = root_mean_square(self.made.level_errors_db(model) / deviation_db)
                judged = replace(judged, expected=expected, true=true, standardised=standardised)
            self.judged.append(judged)
        if certain:
            own = {name: labels[name] for name in ("group", "name", "spoil", "method")}
            self.certainties.append(Certainty(**own, updates=tuple(shares.values())))

    def _figures(self, model: TextureModel | None) -> dict[str, Any]:
        """Return the number of samples of a model, its figures and its errors by bands."""
        if model is None:
            return {"samples": 0, "figures": dict.fromkeys(SHARES, 0.0)}
        plane_db = self.truth.plane.level_errors_db(model)
        errors = self.made.errors(model)
        figures = {
            **figures_of(errors),
            "plane_within_jnd": within_jnd(plane_db),
            "plane_power_error_db": root_mean_square(plane_db),
        }
        bands_db = np.sqrt(np.mean(np.square(errors.bands_db), axis=0))
        return {
            "samples": len(model.samples),
            "figures": figures,
            "bands_db": tuple(bands_db.tolist()),
        }

    def _mixed_share(self, model: TextureModel, time_s: float) -> float:
        """Return the true share over the strokes up to a time, mixed with that over the plane."""
        number = min(int(time_s / PERIOD_S + 1e-9), len(self._stroked_s)) - 1
        stroked_s = self._stroked_s[max(number, 0)]
        so_far: BoolArray = self._place_s <= stroked_s
        plane = within_jnd(self.truth.plane.level_errors_db(model))
        if not so_far.any():
            return plane
        right: BoolArray = np.abs(self.made.level_errors_db(model)[so_far]) <= JND_DB
        return float((stroked_s * right.mean() + PRIOR_S * plane) / (stroked_s + PRIOR_S))


def moments_of(history: ModelHistory) -> dict[str, float]:
    """Return the session time of each of `MOMENTS` that the session reached."""
    at = dict(zip(MOMENTS, (*TIMES_S, history.start_s, history.stop_s), strict=True))
    end_s = history.updates[-1].time_s + PERIOD_S  # the newest frames may be lost
    return {name: time_s for name, time_s in at.items() if time_s is not None and time_s < end_s}


def figures_of(errors: GridErrors) -> dict[str, float]:
    """Return the figures over strokes, without those over the plane."""
    return {
        "within_jnd": within_jnd(errors.power_error_db),
        "power_error_db": root_mean_square(errors.power_error_db),
        "gfc": float(errors.gfc.mean()),
        "log_spectral_db": float(errors.log_spectral_db.mean()),
        "band_error_db": root_mean_square(errors.bands_db),
    }
