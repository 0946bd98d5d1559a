"""Order and update period: what a model costs a second, and how far off it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.evaluation.levels import root_mean_square
from mmt.evaluation.truth import KnownTexture, known_texture
from mmt.session.data import RecordedSession
from mmt.texture.online.history import ModelHistory, build, stream_blocks
from mmt.texture.settings import ModellingSettings
from mmt_lab.bench.measuring import spread
from mmt_lab.bench.textures import session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import Axis, Curves, Findings, Panel, Spread

TIME: Final = Axis("time of the updates (ms per second of session)", "ms/s")
SHAPE: Final = Axis("error of the spectrum (1 - GFC)", "1 - GFC")
LEVEL: Final = Axis("error of the power (dB rms)", "dB")
_RATE_HZ: Final = 1000
_MILLISECONDS: Final = 1e3


@dataclass(frozen=True)
class Plan:
    """What is measured; the defaults are what ``mmt bench order`` does."""

    surfaces: tuple[str, ...] = ("plastic", "mesh", "wood")
    duration_s: float = 18.0
    orders: tuple[int, ...] = (4, 8, 12, 16, 24, 40)
    periods_s: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)
    moments_s: tuple[float, ...] = (4.4, 6.1, 7.8, 10.3, 12.9, 16.6)
    rounds: int = 3


@dataclass(frozen=True)
class Quality:
    """The mean errors over moments of a session and what the updates took, per second."""

    shape: float
    level: float
    seconds: float


def measure(plan: Plan) -> Findings:
    """Build models of every order with every period, and compare them with the truth."""
    sessions = [session(name, plan.duration_s) for name in plan.surfaces]
    shape, level = Curves(), Curves()
    for period_s in plan.periods_s:
        name = f"period {period_s:g} s"
        for order in plan.orders:
            found = [_quality(one, order, period_s, plan) for one in sessions]
            time = _time(found)
            shape.add(name, order, time, float(np.mean([q.shape for q in found])))
            level.add(name, order, time, float(np.mean([q.level for q in found])))
    return Findings(
        name="order",
        title="Order and update period",
        about=(
            f"Sessions of {plan.duration_s:g} s on {', '.join(plan.surfaces)}, modelled with "
            "every order and update period. Errors of the model that the leader has, against "
            "the known texture over the plane, the mean over textures and the moments "
            f"{', '.join(f'{moment:g}' for moment in plan.moments_s)} s: a longer period costs "
            "less, and its model is older. Time of all stages of all updates; the least of "
            f"{plan.rounds} runs."
        ),
        panels=(
            Panel("spectrum", "Spectrum, by order", "order", TIME, SHAPE, shape.done()),
            Panel("power", "Power, by order", "order", TIME, LEVEL, level.done()),
        ),
    )


def _quality(recorded: RecordedSession, order: int, period_s: float, plan: Plan) -> Quality:
    settings = ModellingSettings(order=order)
    blocks = list(stream_blocks([recorded.frames], round(period_s * _RATE_HZ)))
    seconds = []
    for _ in range(plan.rounds):
        history = build(blocks, settings, deferred=False)
        seconds.append(sum(sum(update.durations_s.values()) for update in history.updates))
    truth, reason = known_texture(recorded.annotations, settings)
    if truth is None:
        raise ValueError(reason)
    errors = [_errors(truth, history, moment) for moment in plan.moments_s]
    return Quality(
        shape=float(np.mean([error[0] for error in errors])),
        level=float(np.mean([error[1] for error in errors])),
        seconds=min(seconds) / plan.duration_s,
    )


def _errors(truth: KnownTexture, history: ModelHistory, moment_s: float) -> tuple[float, float]:
    """Return errors of spectrum and power; those of silence where there is no model yet."""
    model = history.model(history.number(moment_s))
    if model is None:
        return 1.0, 60.0
    grid = truth.plane.errors(model)
    return 1.0 - float(grid.gfc.mean()), root_mean_square(grid.power_error_db)


def _time(found: Sequence[Quality]) -> Spread:
    return spread(np.array([quality.seconds for quality in found])).times(_MILLISECONDS)


def run() -> Findings:
    """Build models of every order with every period, and compare them with the truth."""
    return measure(Plan())


EXPERIMENT = Experiment(
    shows="what order and update period cost a second, and how far off the model is",
    duration="1 min",
    run=run,
    group="bench",
)
