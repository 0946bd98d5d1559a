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
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.core.errors import InputError, printable
from mmt.evaluation.modelled import ModelledSession
from mmt.evaluation.recorded_surfaces import SurfaceParts, part_by_surface
from mmt.evaluation.results import Evaluation
from mmt.evaluation.scoring import Scorer
from mmt.evaluation.strokes_made import at_skin, coverage
from mmt.scene import Scene, Texture
from mmt.scene.files import scene_of_recording
from mmt.session.data import check_recording
from mmt.session.operators import control_periods
from mmt.session.stream import Recording, in_memory
from mmt.texture.settings import ModellingSettings
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
    check_recording(session)
    for name, value in (("period_s", period_s), ("step_s", step_s)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: it must be positive and finite")
    if spectra not in list(Spectra):
        raise InputError(f"spectra is {spectra!r}, allowed are {', '.join(Spectra)}")
    samples = session.samples_per_frame
    recorded, recorded_period_s = modelling_of(recorded_scene(session), samples)
    settings = replace(settings or recorded, samples_per_frame=samples)
    period_s = recorded_period_s if period_s is None else period_s
    modelled = ModelledSession(session, settings, period_s, on_progress)
    if step_s is None:
        most_s = MOST_STEPS * USUAL_STEP_S
        step_s = USUAL_STEP_S * max(1, math.ceil(modelled.duration_s / most_s))
    return _evaluation(modelled, Scorer(modelled, seed, Spectra(spectra)), step_s)


def _evaluation(of: ModelledSession, scorer: Scorer, step_s: float) -> SessionEvaluation:
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
        seed=scorer.seed,
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
    check_recording(session)
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
