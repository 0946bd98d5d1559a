"""Score a session's models moment by moment."""

import math
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.held_out import (
    Approximation,
    HeldOutRecording,
    approximate,
    choose_held_out,
    level_errors_db,
)
from mmt.evaluation.model_errors import (
    GridErrors,
    HeadingErrors,
    Strokes,
    band_edges_hz,
    root_mean_square,
)
from mmt.evaluation.modelled import ModelledSession
from mmt.evaluation.results import Band, HeldOutSegment, Levels, PowerMap, Score, Worst
from mmt.texture.completion.distance import distance_sum
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.methods import method_of
from mmt.texture.settings import Inputs
from mmt.texture.signals.metrics import Spectra, within_jnd
from mmt.texture.space import InputSpace

MODEL_NAMES: Final[dict[Inputs, str]] = {
    "isotropic": "speed and force",
    "anisotropic": "velocity and force",
}
"""Names in errors by heading of a model of these inputs."""


class _Rebuilt(NamedTuple):
    """The model without the held-out segments, as rendered in place of each; none without it."""

    samples: int
    distance: float
    approximations: list[Approximation]


class Scorer:
    """Score the leader's and the rebuilt model at session times.

    The rebuilt model is rendered in a thread of its own: most of that is compiled code.

    Parameters
    ----------
    of
        The session. Unless its truth is known, the other method's model is scored without the
        held-out segments.
    seed
        Seed of the choice of held-out segments and of the synthesis.
    spectra
        Kind of spectra that the GFC of held-out segments compares.
    """

    def __init__(self, of: ModelledSession, seed: int, spectra: Spectra) -> None:
        leader, settings, strokes = of.leader, of.settings, of.made.strokes()
        held_out = choose_held_out(leader.finished, seed)
        spans = [segment.span for segment in held_out]
        self._leader = leader
        self._rebuilt = leader.log.without(spans)
        self._beside = of.other.log if of.truth is not None else of.other.log.without(spans)
        self._other = of.of_other_inputs
        self._recordings = [
            HeldOutRecording(segment, settings.vibration_rate_hz, spectra) for segment in held_out
        ]
        self._truth = truth = of.truth
        self._made = truth.at(strokes) if truth is not None and len(strokes.force_n) else None
        self._space = InputSpace(settings.inputs)
        self._rate_hz = settings.rate_hz
        self._vibration_rate_hz = settings.vibration_rate_hz
        self.seed = seed
        self._scores: dict[int, Score] = {}
        self._built_s: dict[int, float] = {}
        self._grids: dict[int, GridErrors | None] = {}
        self._of_rebuilt: dict[int, _Rebuilt] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="rebuilt")
        self._empty_distance = distance_sum(np.empty((0, self._space.dimensions)))
        self._empty = method_of(settings).criterion.progress.value

    def score(self, time_s: float) -> Score:
        """Return the figures at a session time: those of the last update up to then."""
        number = self._leader.number(time_s)
        if number not in self._scores:
            self._scores[number] = self._score(number)
        return replace(self._scores[number], time_s=time_s)

    def model(self, time_s: float) -> TextureModel | None:
        """Return the leader's model at a session time; keep it if it is needed again."""
        return self._model(self._leader.number(time_s))

    def errors(self, time_s: float) -> tuple[tuple[Worst, ...], PowerMap | None]:
        """Return the leader's worst points and its errors over the plane at a session time.

        Empty and None if the texture is not known, or there was no model yet.
        """
        number = self._leader.number(time_s)
        model, grid = self._model(number), self._grid(number)
        if self._truth is None or model is None or grid is None:
            return (), None
        return self._truth.worst(model, grid), self._truth.power_map(grid)

    def by_heading(self, time_s: float) -> tuple[HeadingErrors, ...]:
        """Return errors by heading at a session time; none if the texture has no heading.

        They are those of the leader's model, and of the other inputs' model of the same session.
        """
        grid = self._grid(self._leader.number(time_s))
        if self._truth is None or grid is None:
            return ()
        models = {MODEL_NAMES[self._space.name]: grid}
        other = None if self._other is None else self._other.model(self._other.number(time_s))
        if other is not None:
            models[MODEL_NAMES[other.space.name]] = self._truth.plane.errors(other)
        return self._truth.by_heading(models)

    def bands(self, time_s: float) -> tuple[Band, ...]:
        """Return the errors by bands at a session time.

        They are those of the leader's model over the plane if the texture is known, else those of
        the rendering of the held-out segments.
        """
        number = self._leader.number(time_s)
        grid, held_out = self._grid(number), self._approximate(number).approximations
        if grid is not None:
            errors_db = grid.bands_db
        elif self._truth is None and held_out:
            both = zip(self._recordings, held_out, strict=True)
            errors_db = np.array([recording.bands_db(one.amplitude) for recording, one in both])
        else:
            return ()
        edges_hz = band_edges_hz(self._vibration_rate_hz).tolist()
        found = np.sqrt(np.mean(np.square(errors_db), axis=0)).tolist()
        each = [None if math.isnan(error_db) else error_db for error_db in found]
        return tuple(map(Band, edges_hz, edges_hz[1:], each))

    def segments(self, time_s: float, first_sample: int) -> tuple[HeldOutSegment, ...]:
        """Return the held-out segments as they are approximated at a session time."""
        approximations = self._approximate(self._leader.number(time_s)).approximations
        return tuple(
            self._segment(recording, rendered, first_sample)
            for recording, rendered in zip_longest(self._recordings, approximations)
        )

    def _score(self, number: int) -> Score:
        leader = self._leader.updates[number] if number >= 0 else None
        model = self._model(number)  # alone, as its time is told
        approximated = self._thread.submit(self._approximate, number)
        grid = self._grid(number)
        against_truth, beside = self._against_truth(model, grid), self._of_beside(number)
        rebuilt = approximated.result()
        held_out = rebuilt.approximations
        of_held_out = _levels(np.array([each.power_error_db for each in held_out]))
        own = of_held_out if self._truth is None else against_truth
        return Score(
            time_s=0.0,
            samples=leader.samples if leader else 0,
            distance=leader.distance if leader else self._empty_distance,
            completion=leader.progress.value if leader else self._empty,
            update_ms=1e3 * (leader.spent_s + self._built_s[number]) if leader else None,
            gfc=float(np.mean([a.gfc for a in held_out])) if held_out else None,
            gfc_ceiling=float(np.mean([a.gfc_ceiling for a in held_out])) if held_out else None,
            **asdict(own),
            beside=beside,
            truth_gfc=float(grid.gfc.mean()) if grid else None,
            truth_log_spectral_db=float(grid.log_spectral_db.mean()) if grid else None,
            held_out_power_error_db=of_held_out.power_error_db,
            held_out_within_jnd=of_held_out.within_jnd,
            rebuilt_samples=rebuilt.samples,
            rebuilt_distance=rebuilt.distance,
        )

    def _against_truth(self, model: TextureModel | None, grid: GridErrors | None) -> Levels:
        """Return the errors of a model against the truth; over the plane from `grid` if given."""
        if self._truth is None or model is None:
            return Levels()
        plane = self._truth.plane.level_errors_db(model) if grid is None else grid.power_error_db
        made = self._made.level_errors_db(model) if self._made else np.empty(0)
        return _levels(made, plane)

    def _of_beside(self, number: int) -> Levels:
        """Return the errors of the other method's model after an update."""
        model = self._beside.model(number)
        if model is None or self._truth is not None:
            return self._against_truth(model, None)
        if not self._recordings:
            return Levels()
        return _levels(level_errors_db(model, self._recordings))

    def _model(self, number: int) -> TextureModel | None:
        """Return the leader's model, ready to render; it is built anew unless something holds it.

        The time of the first build counts for the leader, whose models are not deferred.
        """
        started = time.perf_counter()
        model = self._leader.model(number)
        if model is not None:
            model.prepared()
        self._built_s.setdefault(number, time.perf_counter() - started)
        return model

    def _grid(self, number: int) -> GridErrors | None:
        if number not in self._grids:
            model, truth = self._model(number), self._truth
            self._grids[number] = truth.plane.errors(model) if truth and model else None
        return self._grids[number]

    def _approximate(self, number: int) -> _Rebuilt:
        """Return one approximation for each held-out segment, none without a model."""
        if number not in self._of_rebuilt:
            model = self._rebuilt.model(number)
            rebuilt = _Rebuilt(0, self._empty_distance, [])
            if model is not None:
                made = approximate(model, self._recordings, self.seed)
                rebuilt = _Rebuilt(len(model.samples), distance_sum(model.points), made)
            self._of_rebuilt[number] = rebuilt
        return self._of_rebuilt[number]

    def _segment(
        self, recording: HeldOutRecording, rendered: Approximation | None, first_sample: int
    ) -> HeldOutSegment:
        segment = recording.segment
        truth = None
        if self._truth is not None and (self._truth.surface.isotropic or self._space.directed):
            heading = np.arctan2(segment.velocity_mm_s[1], segment.velocity_mm_s[0])
            moment = segment.speed_mm_s, segment.force_n, heading
            stroke = Strokes(*(np.array([value]) for value in moment))
            every_hz = np.arange(0.5 * self._vibration_rate_hz + 1.0)
            truth = np.sqrt(self._truth.spectrum(stroke, every_hz)[0])
        return HeldOutSegment(
            start_s=(segment.start - first_sample) / self._rate_hz,
            stop_s=(segment.stop - first_sample) / self._rate_hz,
            speed_mm_s=segment.speed_mm_s,
            force_n=segment.force_n,
            power=recording.power,
            gfc=rendered.gfc if rendered else None,
            power_error_db=rendered.power_error_db if rendered else None,
            frequencies_hz=recording.frequencies_hz,
            measured=recording.amplitude,
            synthesized=rendered.amplitude if rendered else None,
            truth=truth,
        )


def _levels(errors_db: FloatArray, plane_db: FloatArray | None = None) -> Levels:
    """Gather errors of the level at strokes (k,) and over the plane; None if there are none."""
    figures: list[float | None] = []
    for values in (errors_db, plane_db):
        if values is None or not len(values):
            figures += [None, None]
        else:
            figures += [root_mean_square(values), within_jnd(values)]
    return Levels(*figures)
