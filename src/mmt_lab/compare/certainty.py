"""What a model says of its own error against what that error is, and what its thresholds leave.

At every update the share of strokes whose level is expected to be right is compared with the true
one, and each error with the standard deviation that was predicted for it. At the start and the stop
it is told what time it took and what error is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.evaluation.grid_errors import Strokes
from mmt.evaluation.truth import KnownTexture
from mmt.testing.simulation.textures import get_surface
from mmt.texture.completion.uncertainty import (
    CompletionGrid,
    Outlook,
    StrokingDensity,
    completion_grid,
    outlook,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import ModelHistory, build
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.just_noticeable import JND_DB
from mmt.texture.signals.metrics import within_jnd
from mmt_lab.compare.cases import Case
from mmt_lab.compare.judging import METHODS

DEVIATIONS_DB: Final = (0.0, 0.25, 0.5, 1.0, 2.0, float("inf"))
"""Edges of the bands of predicted standard deviations."""


@dataclass(frozen=True)
class Update:
    """One update of a model: shares within one JND that are expected and true.

    ``even`` over the grid of `mmt.texture.completion.uncertainty`, otherwise weighted by the
    operator's motion up to then.
    """

    time_s: float
    expected: float
    true: float
    expected_even: float
    true_even: float


@dataclass(frozen=True)
class Outcome:
    """A session at one threshold; figures are None where it was not met.

    Attributes
    ----------
    threshold
        ``start`` or ``stop``.
    time_s, samples
        When it was met, and samples of the model.
    within_jnd
        Share of the evaluation's grid within one JND.
    expected, weighted
        Share expected and true, weighted by the operator's motion up to then.
    to_come
        True share weighted by the motion from then on, None where there is none.
    gfc, log_spectral_db
        Agreement of the spectra's shape, and difference of the whole spectra, over the
        evaluation's grid.
    """

    threshold: str
    time_s: float | None = None
    samples: int = 0
    within_jnd: float | None = None
    expected: float | None = None
    weighted: float | None = None
    to_come: float | None = None
    gfc: float | None = None
    log_spectral_db: float | None = None


@dataclass(frozen=True)
class Certainty:
    """One session of one method.

    ``squares`` and ``counts`` (by `DEVIATIONS_DB`) are the sum of squared errors, each over its
    predicted standard deviation, and how many they are, over all updates and nodes.
    """

    group: str
    name: str
    texture: str
    seed: int
    method: str
    updates: tuple[Update, ...]
    outcomes: tuple[Outcome, ...]
    squares: tuple[float, ...]
    counts: tuple[int, ...]


def has_certainty(method: str) -> bool:
    """Say whether models of a method know how sure their level is."""
    return METHODS[method] == METHODS["field"]


def judge_certainty(case: Case, method: str, blocks: Sequence[RecordArray]) -> Certainty:
    """Compare what a method's models say of their error with the known texture.

    Parameters
    ----------
    case
        The session.
    method
        One of `METHODS` for which `has_certainty`.
    blocks
        The session's frames, one for each update.
    """
    settings = ModellingSettings(inputs=case.inputs, **METHODS[method])
    judge = _Judge(case, blocks, settings)
    history = build(blocks, settings)
    updates, squares, counts = judge.calibration(history)
    outcomes = [judge.outcome(threshold, history) for threshold in ("start", "stop")]
    return Certainty(
        **case.labels,
        method=method,
        updates=tuple(updates),
        outcomes=tuple(outcomes),
        squares=tuple(squares.tolist()),
        counts=tuple(counts.astype(int).tolist()),
    )


class _Judge:
    """The known texture of a session, and where its operator strokes."""

    def __init__(
        self, case: Case, blocks: Sequence[RecordArray], settings: ModellingSettings
    ) -> None:
        self._truth = KnownTexture(get_surface(case.texture))
        self._grid: CompletionGrid = completion_grid(3 if case.inputs == "anisotropic" else 2)
        inputs = self._grid.inputs
        heading = np.arctan2(inputs[:, 1], inputs[:, 0]) if inputs.shape[1] == 3 else 0.0
        speed = np.hypot(*inputs[:, :-1].T) if inputs.shape[1] == 3 else inputs[:, 0]
        self._strokes = Strokes(speed, inputs[:, -1], np.broadcast_to(heading, speed.shape))
        self._weights, self._seconds = _motion(blocks, self._grid, settings)

    def calibration(self, history: ModelHistory) -> tuple[list[Update], FloatArray, FloatArray]:
        """Return every update, and squares and counts of standardised errors by band."""
        updates = []
        squares, counts = np.zeros(len(DEVIATIONS_DB) - 1), np.zeros(len(DEVIATIONS_DB) - 1)
        for number, update in enumerate(history.updates):
            model = update.model
            if model is None or model.level_field is None:
                continue
            weights = self._weights[number]
            said, error_db = self._look(model, weights)
            right = np.abs(error_db) <= JND_DB
            updates.append(
                Update(
                    time_s=update.time_s,
                    expected=said.share(weights),
                    true=float(right @ weights),
                    expected_even=float(said.right.mean()),
                    true_even=float(right.mean()),
                )
            )
            band = np.digitize(said.deviation_db, DEVIATIONS_DB[1:-1])
            standardised = np.square(error_db / said.deviation_db)
            squares += np.bincount(band, standardised, minlength=len(squares))
            counts += np.bincount(band, minlength=len(counts))
        return updates, squares, counts

    def outcome(self, threshold: str, history: ModelHistory) -> Outcome:
        """Say what a threshold took, and what it leaves."""
        nothing = Outcome(threshold)
        time_s = history.start_s if threshold == "start" else history.stop_s
        if time_s is None:
            return nothing
        number = history.number(time_s)
        model = history.model(number)
        if model is None or model.level_field is None:
            return nothing
        weights = self._weights[number]
        said, error_db = self._look(model, weights)
        right = np.abs(error_db) <= JND_DB
        rest = self._seconds[-1] - self._seconds[number]
        errors = self._truth.compare(model)
        return replace(
            nothing,
            time_s=time_s,
            samples=len(model.samples),
            within_jnd=within_jnd(errors.power_error_db),
            expected=said.share(weights),
            weighted=float(right @ weights),
            to_come=float(right @ rest / rest.sum()) if rest.sum() > 0.0 else None,
            gfc=float(errors.gfc.mean()),
            log_spectral_db=float(errors.log_spectral_db.mean()),
        )

    def _look(self, model: TextureModel, weights: FloatArray) -> tuple[Outlook, FloatArray]:
        """Return what a model with a field says of the grid's nodes, and its errors there."""
        field = model.level_field
        assert field is not None  # noqa: S101 - the caller has looked
        error_db = self._truth.compare_at(model, self._strokes).power_error_db
        return outlook(field, self._grid, weights), error_db


def _motion(
    blocks: Sequence[RecordArray], grid: CompletionGrid, settings: ModellingSettings
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return weights and seconds of the grid's nodes after each block."""
    stream = StreamFilter.of(settings)
    density = StrokingDensity(
        grid, settings.least_speed_mm_s, settings.least_force_n, settings.rate_hz
    )
    weights, seconds = [], []
    for block in blocks:
        density.add(stream.process(block))
        weights.append(density.weights)
        seconds.append(density.seconds)
    return weights, seconds
