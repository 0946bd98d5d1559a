"""Evaluate a recorded session as paper A does.

Awan et al., Model-Mediated Teleoperation for Remote Haptic Texture Sharing, section VII: the
model is built as the live leader builds it; five random samples of the finished model are
held out, the model is built again without them, and every 2.5 s of session time their
recorded vibration is compared with what the model renders in their place. Where the texture
is known, the leader's model is compared with it as well: over the strokes that were made, and over
the whole plane. The level of the other method's model is scored beside it.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, printable
from mmt.evaluation.recorded_surfaces import SurfaceParts, part_by_surface
from mmt.evaluation.results import Evaluation
from mmt.evaluation.scoring import Scorer, method_to_compare
from mmt.evaluation.strokes_made import StrokesMade, at_skin, coverage
from mmt.evaluation.truth import KnownTexture, known_texture
from mmt.scene import Scene, Texture
from mmt.scene.files import scene_of_recording
from mmt.session.data import RecordedSession, missing_frames
from mmt.session.operators import control_periods
from mmt.session.stream import Recording, blocks_of, in_memory
from mmt.texture.online.history import ModelHistory, build, build_together, stream_blocks
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.metrics import Spectra
from mmt.texture.touch_down.fitting import held_out_errors

USUAL_STEP_S: Final = 2.5
MOST_STEPS: Final = 40
"""Largest number of scores if no step is given: rows that fit on a screen."""


class SessionEvaluation(Evaluation):
    """An evaluation that prints as the table of ``mmt evaluate``."""

    def __str__(self) -> str:
        """Return the table of the steps, as ``mmt evaluate`` prints it."""
        from mmt.evaluation.reports.document import as_text
        from mmt.evaluation.reports.tables import levels, overview, steps

        return f"{as_text(steps(self))}\n{as_text(overview([self]), levels([self]))}"


def evaluate_session(
    session: Recording,
    settings: ModellingSettings | None = None,
    *,
    period_s: float | None = None,
    step_s: float | None = None,
    seed: int = 0,
    spectra: str = Spectra.WELCH,
    on_progress: Callable[[float], None] | None = None,
) -> Evaluation:
    """Evaluate one session; the same session, settings and seed give the same figures.

    Parameters
    ----------
    session
        With position, force and acceleration; one that stays in its file is read once or twice.
    settings
        Settings of the modelling; None takes those of the recorded scene, or the defaults if
        there is none. The number of samples per frame is always the session's own.
    period_s
        Time between two updates of the model; None as for `settings`. At any moment the leader
        has the model of its last update: with updates every second, at 2.5 s the one of 2 s.
    step_s
        Time between two scores; None takes 2.5 s, and in a recording of over 100 s the
        multiple of it that gives at most 40 scores.
    seed
        Seeds the choice of held-out segments and the synthesis.
    spectra
        Spectra that the GFC of held-out segments compares: ``"welch"``, or ``"fourier"`` for raw
        amplitudes, by which two realisations of one process score 0.79 on average.
    on_progress
        Called after each update with the session time (s) that is modelled.

    Returns
    -------
    Evaluation
        Its ``steps`` are the rows that ``mmt evaluate`` prints; ``print(evaluation)`` prints
        them too. A session over several surfaces is evaluated as one: `evaluate_surfaces`
        tells them apart.

    Raises
    ------
    InputError
        The session has no frames, or lacks a channel; a period or step is not positive; there
        are no such spectra.

    Notes
    -----
    Costs a pass over the session, another one on a texture that depends on the heading, and some
    20 ms for every moment scored, three times that at 10 kHz.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=6.0)
    >>> result = mmt.evaluate_session(mmt.RecordedSession(frames, annotations=truth))
    >>> [step.time_s for step in result.steps]
    [2.5, 5.0]
    """
    for name, value in (("period_s", period_s), ("step_s", step_s)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: it must be positive and finite")
    if spectra not in list(Spectra):
        raise InputError(f"spectra is {spectra!r}, allowed are {', '.join(Spectra)}")
    samples = session.samples_per_frame
    recorded, recorded_period_s = modelling_of(recorded_scene(session), samples)
    settings = replace(settings or recorded, samples_per_frame=samples)
    period_s = recorded_period_s if period_s is None else period_s
    modelled = _Modelled(session, settings, period_s, on_progress)
    scorer = modelled.scorer(seed, Spectra(spectra))
    if step_s is None:
        most_s = MOST_STEPS * USUAL_STEP_S
        step_s = USUAL_STEP_S * max(1, math.ceil(modelled.duration_s / most_s))
    return _evaluation(modelled, scorer, step_s, seed)


def _evaluation(of: "_Modelled", scorer: Scorer, step_s: float, seed: int) -> SessionEvaluation:
    """Return the evaluation of a session that was modelled."""
    session, leader, truth = of.session, of.leader, of.truth
    steps = np.arange(1, int(of.duration_s / step_s + 1e-9) + 1) * step_s
    model = scorer.model(of.final_s)  # kept, so that it is built only once
    worst, power_map = scorer.errors(of.final_s)
    return SessionEvaluation(
        name=printable(session.path.stem) or "session",
        path=str(session.path),
        surface=truth.surface.name if truth is not None else None,
        duration_s=of.duration_s,
        complete=session.complete,
        missing_frames=of.missing,
        faults=leader.updates[-1].faults,
        settings=of.settings,
        beside=of.beside,
        period_s=of.period_s,
        step_s=step_s,
        seed=seed,
        order=leader.updates[-1].order,
        basis="held-out" if truth is None else "truth",
        basis_reason=of.basis_reason,
        start_s=leader.start_s,
        stop_s=leader.stop_s,
        steps=tuple(scorer.score(float(at_s)) for at_s in steps),
        at_start=None if leader.start_s is None else scorer.score(leader.start_s),
        at_stop=None if leader.stop_s is None else scorer.score(leader.stop_s),
        at_end=scorer.score(of.duration_s),
        worst=worst,
        bands=scorer.bands(of.final_s),
        by_heading=scorer.by_heading(of.final_s),
        coverage=coverage(of.made, model, of.settings, stopped=leader.stop_s is not None),
        held_out=scorer.segments(of.final_s, of.first),
        course=np.array([(u.time_s, u.progress.value) for u in leader.updates]),
        models=leader,
        power_map=power_map,
        control=control_periods(of.control_events, of.duration_s),
        at_skin=at_skin(session, model, truth, of.made.strokes()),
        touch_downs=held_out_errors(leader.log.touch_downs, of.settings.vibration_rate_hz),
        processing_s=time.perf_counter() - of.started,
    )


def evaluate_surfaces(
    session: Recording,
    scene: Scene | None = None,
    *,
    step_s: float | None = None,
    seed: int = 0,
) -> tuple[list[Evaluation], SurfaceParts | None]:
    """Evaluate a session; if its scene tells surfaces apart, the model of each.

    Parameters
    ----------
    session
        With position, force and acceleration.
    scene
        Scene with the modelling; None takes the scene that the session was recorded with.
    step_s, seed
        As of `evaluate_session`.

    Returns
    -------
    evaluations
        One, or one for each surface in the order of their numbers.
    parts
        Stays on the surfaces; None if surfaces are not told apart.

    Raises
    ------
    InputError
        As of `evaluate_session`.
    """
    scene = recorded_scene(session) if scene is None else scene
    settings, period_s = modelling_of(scene, session.samples_per_frame)

    def evaluate(part: Recording) -> Evaluation:
        return evaluate_session(part, settings, period_s=period_s, step_s=step_s, seed=seed)

    if settings.surfaces is None:
        return [evaluate(session)], None
    session = in_memory(session)
    if not len(session.frames):
        return [evaluate(session)], None
    parts = part_by_surface(session, settings)
    name = printable(session.path.stem) or "session"
    evaluations = [
        replace(
            found := evaluate(part),
            name=f"{name}, surface {number}",
            missing_frames=parts.missing[number],
            faults=replace(found.faults, missing_s=parts.missing[number] / settings.rate_hz),
            control=control_periods(session.events, session.duration_s),
        )
        for number, part in parts.sessions.items()
    ]
    return evaluations, parts


def recorded_scene(session: Recording) -> Scene:
    """Return the scene that a session was recorded with, or the default if it holds none.

    Raises
    ------
    InputError
        The recorded scene is not valid.
    """
    if session.scene is None:
        return Scene()
    return scene_of_recording(session.scene, f"the scene recorded in {session.path}")


def modelling_of(scene: Scene, samples_per_frame: int) -> tuple[ModellingSettings, float]:
    """Return a scene's settings of the modelling, or the defaults, and the update period (s)."""
    texture = scene.texture or Texture()
    return texture.settings(samples_per_frame), texture.update_period_s


class _Modelled:
    """A session that was modelled by both methods, and what its frames say of it."""

    def __init__(
        self,
        session: Recording,
        settings: ModellingSettings,
        period_s: float,
        on_progress: Callable[[float], None] | None,
    ) -> None:
        self.started = time.perf_counter()
        self.session, self.settings, self.period_s = session, settings, period_s
        self.truth, self.basis_reason = known_texture(session.annotations, settings)
        self.beside, other_method = method_to_compare(settings)
        self.made = StrokesMade(settings)
        self.first = self._highest = -1
        self.missing = 0
        self._last: RecordArray | None = None
        self.leader, self._other = build_together(
            map(self._count, self._blocks()),
            [settings, other_method],
            observe=self.made.add,
            on_progress=on_progress,
        )
        if not self.leader.updates:
            raise InputError(
                f"session {session.path}: it holds no frames, nothing can be evaluated"
            )
        self.duration_s = (self._highest + 1 - self.first) / settings.rate_hz
        self.final_s = self.duration_s if self.leader.stop_s is None else self.leader.stop_s

    @property
    def control_events(self) -> Sequence[Mapping[str, Any]]:
        """The events, if control may have changed hands: a file is read again for them."""
        session = self.session
        known = isinstance(session, RecordedSession) or "control" in (session.scene or {})
        return session.events if known else ()

    def scorer(self, seed: int, spectra: Spectra) -> Scorer:
        """Return what scores the models; on a texture with a grain, model the other inputs too."""
        return Scorer(
            leader=self.leader,
            beside=self._other,
            other=_of_other_inputs(self._blocks(), self.settings, self.truth),
            truth=self.truth,
            strokes=self.made.strokes(),
            settings=self.settings,
            seed=seed,
            spectra=spectra,
        )

    def _blocks(self) -> Iterator[RecordArray]:
        period_frames = max(1, round(self.period_s * self.settings.rate_hz))
        return stream_blocks(blocks_of(self.session), period_frames)

    def _count(self, block: RecordArray) -> RecordArray:
        """Count the next frames (n,), n > 0, and return them."""
        if self._last is None:
            self.first = int(block["sequence"][0])
        joined = block if self._last is None else np.concatenate([self._last, block])
        self.missing += missing_frames(joined)
        self._highest = max(self._highest, int(block["sequence"].max()))
        self._last = block[-1:]
        return block


def _of_other_inputs(
    blocks: Iterable[RecordArray], settings: ModellingSettings, truth: KnownTexture | None
) -> ModelHistory | None:
    """Build the model of the other inputs; None if the texture does not depend on the heading."""
    if truth is None or truth.surface.isotropic:
        return None
    inputs: Inputs = "isotropic" if settings.inputs == "anisotropic" else "anisotropic"
    others = replace(settings, inputs=inputs, start_distance="auto", stop_distance="auto")
    return build(blocks, others)
