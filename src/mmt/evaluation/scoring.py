"""Score a session's models moment by moment."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.evaluation.grid_errors import GridErrors, HeadingErrors, Strokes
from mmt.evaluation.held_out import Approximation, HeldOutRecording
from mmt.evaluation.levels import root_mean_square
from mmt.evaluation.results import HeldOutSegment, PowerMap, Score, Worst
from mmt.evaluation.truth import DENSITY_HZ, KnownTexture
from mmt.texture.completion.distance import cells_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.history import ModelHistory
from mmt.texture.online.methods import method_of
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.amplitude_spectra import Spectra
from mmt.texture.signals.metrics import within_jnd

MODEL_NAMES: Final[dict[Inputs, str]] = {
    "isotropic": "speed and force",
    "anisotropic": "velocity and force",
}
"""What errors by heading call a model of these inputs."""


class Scorer:
    """Score the leader's and the rebuilt model at session times.

    Parameters
    ----------
    leader
        Every state of the model that the leader had.
    rebuilt
        The same, built without the held-out segments.
    held_out
        These segments.
    other
        Every state of the model of the other inputs, None where it is not compared.
    truth
        The known texture, None where there is none.
    settings
        Settings of the leader's modelling.
    seed
        Seed of the synthesis.
    spectra
        What the GFC of held-out segments compares.
    """

    def __init__(
        self,
        *,
        leader: ModelHistory,
        rebuilt: ModelHistory,
        held_out: Sequence[Segment],
        other: ModelHistory | None,
        truth: KnownTexture | None,
        settings: ModellingSettings,
        seed: int,
        spectra: Spectra,
    ) -> None:
        self._leader = leader
        self._rebuilt = rebuilt
        self._other = other
        self._recordings = [
            HeldOutRecording(segment, settings.rate_hz, spectra) for segment in held_out
        ]
        self._truth = truth
        self._space = InputSpace(settings.inputs)
        self._rate_hz = settings.rate_hz
        self._seed = seed
        self._scores: dict[int, Score] = {}
        self._grids: dict[int, GridErrors | None] = {}
        self._approximations: dict[int, list[Approximation]] = {}
        self._empty_distance = cells_of(self._space.dimensions).empty
        self._empty = method_of(settings).criterion.progress.value

    def score(self, time_s: float) -> Score:
        """Return the figures at a session time: those of the last update up to then."""
        number = self._leader.number(time_s)
        if number not in self._scores:
            self._scores[number] = self._score(number)
        return replace(self._scores[number], time_s=time_s)

    def errors(self, time_s: float) -> tuple[tuple[Worst, ...], PowerMap | None]:
        """Return the leader's worst points and its errors over the plane at a session time.

        Empty and None where the texture is not known, or there was no model yet.
        """
        number = self._leader.number(time_s)
        model, grid = self._leader.model(number), self._grid(number)
        if self._truth is None or model is None or grid is None:
            return (), None
        return self._truth.worst(model, grid), self._truth.power_map(grid)

    def by_heading(self, time_s: float) -> tuple[HeadingErrors, ...]:
        """Return errors by heading at a session time, where the texture depends on it.

        Errors of the leader's model, and of the model of the other inputs, from the same session.
        """
        grid = self._grid(self._leader.number(time_s))
        if self._truth is None or grid is None:
            return ()
        models = {MODEL_NAMES[self._space.name]: grid}
        other = None if self._other is None else self._other.model(self._other.number(time_s))
        if other is not None:
            models[MODEL_NAMES[other.space.name]] = self._truth.compare(other)
        return self._truth.by_heading(models)

    def segments(self, time_s: float, first_sample: int) -> tuple[HeldOutSegment, ...]:
        """Return the held-out segments as they are approximated at a session time."""
        approximations = self._approximate(self._leader.number(time_s))
        return tuple(
            self._segment(
                recording,
                approximations[index] if approximations else None,
                first_sample,
            )
            for index, recording in enumerate(self._recordings)
        )

    def _score(self, number: int) -> Score:
        leader = self._leader.updates[number] if number >= 0 else None
        rebuilt = self._rebuilt.updates[number] if number >= 0 else None
        held_out = self._approximate(number)
        grid = self._grid(number)
        errors_db = np.array([approximation.power_error_db for approximation in held_out])
        held_out_error_db = root_mean_square(errors_db) if held_out else None
        held_out_jnd = within_jnd(errors_db) if held_out else None
        if self._truth is None:
            error_db, jnd = held_out_error_db, held_out_jnd
        else:
            error_db = root_mean_square(grid.power_error_db) if grid else None
            jnd = within_jnd(grid.power_error_db) if grid else None
        return Score(
            time_s=0.0,
            samples=leader.samples if leader else 0,
            distance=leader.distance if leader else self._empty_distance,
            completion=leader.progress.value if leader else self._empty,
            gfc=float(np.mean([a.gfc for a in held_out])) if held_out else None,
            gfc_ceiling=float(np.mean([a.gfc_ceiling for a in held_out])) if held_out else None,
            power_error_db=error_db,
            within_jnd=jnd,
            truth_gfc=float(grid.gfc.mean()) if grid else None,
            truth_gfc_fine=float(grid.gfc_fine.mean()) if grid else None,
            held_out_power_error_db=held_out_error_db,
            held_out_within_jnd=held_out_jnd,
            rebuilt_samples=rebuilt.samples if rebuilt else 0,
            rebuilt_distance=rebuilt.distance if rebuilt else self._empty_distance,
        )

    def _grid(self, number: int) -> GridErrors | None:
        if number not in self._grids:
            model, truth = self._leader.model(number), self._truth
            self._grids[number] = truth.compare(model) if truth and model else None
        return self._grids[number]

    def _approximate(self, number: int) -> list[Approximation]:
        """Return one approximation for each held-out segment, none without a model."""
        if number not in self._approximations:
            model = self._rebuilt.model(number)
            self._approximations[number] = (
                []
                if model is None
                else [
                    recording.approximate(model, self._seed + index)
                    for index, recording in enumerate(self._recordings)
                ]
            )
        return self._approximations[number]

    def _segment(
        self, recording: HeldOutRecording, rendered: Approximation | None, first_sample: int
    ) -> HeldOutSegment:
        segment = recording.segment
        truth = None
        if self._truth is not None and (self._truth.surface.isotropic or self._space.directed):
            heading = np.arctan2(segment.velocity_mm_s[1], segment.velocity_mm_s[0])
            moment = segment.speed_mm_s, segment.force_n, heading
            stroke = Strokes(*(np.array([value]) for value in moment))
            truth = np.sqrt(self._truth.spectrum(stroke, DENSITY_HZ)[0])
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
