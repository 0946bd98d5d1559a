"""The whole pipeline: how good the leader's model is, by session time and by processing time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from mmt.evaluation.levels import root_mean_square
from mmt.evaluation.truth import KnownTexture, known_texture
from mmt.session.data import RecordedSession
from mmt.texture.online.history import ModelHistory, build, stream_blocks
from mmt.texture.settings import Method, ModellingSettings
from mmt.texture.signals.metrics import within_jnd
from mmt_lab.bench.measuring import spread
from mmt_lab.bench.textures import session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    Axis,
    Curves,
    Findings,
    Panel,
    Records,
    Spread,
)

SESSION: Final = Axis("session time (s)", "s", logarithmic=False)
PROCESSING: Final = Axis("processing time (ms)", "ms")
MEASURES: Final = {
    "gfc": ("Goodness of fit", Axis("1 - GFC", "1 - GFC")),
    "power": ("Power", Axis("error of the power (dB rms)", "dB")),
    "jnd": (
        "Within one just noticeable difference",
        Axis("share of the plane", "share", logarithmic=False),
    ),
}
METHODS: Final[tuple[Method, ...]] = ("field", "published")
_MILLISECONDS: Final = 1e3


@dataclass(frozen=True)
class Plan:
    """What is measured; the defaults are what ``mmt bench pipeline`` does."""

    surfaces: tuple[str, ...] = ("plastic", "mesh", "wood", "sandpaper", "ribbed")
    duration_s: float = 18.0
    moments_s: tuple[float, ...] = (3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 18.0)
    periods_s: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0)
    rounds: int = 3


def measure(plan: Plan) -> Findings:
    """Build every session's model as the leader does, and compare each state with the truth."""
    sessions = [session(name, plan.duration_s) for name in plan.surfaces]
    by_session = {name: Curves() for name in MEASURES}
    by_processing = {name: Curves() for name in MEASURES}
    rows = []
    for method, period_s in product(METHODS, plan.periods_s):
        runs = [_Run(one, method, period_s, plan) for one in sessions]
        curve = f"{method}, every {period_s:g} s"
        for moment in plan.moments_s:
            found = [run.at(moment) for run in runs]
            time = _time([run.spent_ms(moment) for run in runs])
            for index, name in enumerate(MEASURES):
                value = float(np.mean([errors[index] for errors in found]))
                by_session[name].add(curve, moment, moment, value)
                if time.median > 0.0:  # not before the first update
                    by_processing[name].add(curve, moment, time, value)
        rows += [_row(run, plan) for run in runs]
    return Findings(
        name="pipeline",
        title="Whole pipeline",
        about=(
            f"Simulated sessions of {plan.duration_s:g} s on {', '.join(plan.surfaces)}; an "
            "update at several periods, every setting at its default but the method. The "
            "leader's model against the known texture over the plane, 12 x 12 points, the mean "
            "over textures: goodness of fit at the resolution of Welch's estimate, power, and "
            "the share of points whose power is within one just noticeable difference (1.36 "
            "dB). Processing time: filtering, segmenting, fitting and triangulating up to "
            f"then; the least of {plan.rounds} runs, its quartiles over textures, and of an update "
            "the mean and the longest of the session."
        ),
        panels=(
            *_panels("session", "by session time", SESSION, by_session),
            *_panels("processing", "by processing time", PROCESSING, by_processing),
        ),
        records=(Records("textures", "At the end of the session, by texture", tuple(rows)),),
    )


def _panels(kind: str, words: str, x: Axis, curves: dict[str, Curves]) -> list[Panel]:
    return [
        Panel(f"{name}_{kind}", f"{title}, {words}", "session time (s)", x, y, curves[name].done())
        for name, (title, y) in MEASURES.items()
    ]


class _Run:
    """One session, modelled a few times over, and its truth."""

    def __init__(
        self, recorded: RecordedSession, method: Method, period_s: float, plan: Plan
    ) -> None:
        settings = ModellingSettings(method=method)
        self.method, self.period_s = method, period_s
        blocks = list(stream_blocks([recorded.frames], round(period_s * settings.rate_hz)))
        histories = [build(blocks, settings, deferred=False) for _ in range(plan.rounds)]
        self.history: ModelHistory = histories[0]
        update_s = np.min([_durations(history) for history in histories], axis=0)
        self._spent_s = np.cumsum(update_s)
        self.update_ms = update_s * _MILLISECONDS
        truth, reason = known_texture(recorded.annotations, settings)
        if truth is None:
            raise ValueError(reason)
        self.truth: KnownTexture = truth

    def at(self, moment_s: float) -> tuple[float, float, float]:
        """Return 1 - GFC, power error (dB) and share within one JND; silence before a model."""
        model = self.history.model(self.history.number(moment_s))
        if model is None:
            return 1.0, 60.0, 0.0
        errors = self.truth.plane.errors(model)
        return (
            1.0 - float(errors.gfc.mean()),
            root_mean_square(errors.power_error_db),
            within_jnd(errors.power_error_db),
        )

    def spent_ms(self, moment_s: float) -> float:
        """Return what all updates up to a session time took."""
        number = self.history.number(moment_s)
        return float(self._spent_s[number]) * _MILLISECONDS if number >= 0 else 0.0


def _durations(history: ModelHistory) -> list[float]:
    return [update.spent_s for update in history.updates]


def _time(values: Sequence[float]) -> Spread:
    return spread(np.array(values))


def _row(run: _Run, plan: Plan) -> dict[str, str | float | None]:
    shape, level, jnd = run.at(plan.duration_s)
    return {
        "method": run.method,
        "update every (s)": run.period_s,
        "texture": run.truth.surface.name,
        "GFC": 1.0 - shape,
        "power error (dB)": level,
        "within JND": jnd,
        "complete after (s)": run.history.stop_s,
        "processing (ms)": run.spent_ms(plan.duration_s),
        "an update (ms)": float(run.update_ms.mean()),
        "longest update (ms)": float(run.update_ms.max()),
    }


def run() -> Findings:
    """Build every session's model as the leader does, and compare each state with the truth."""
    return measure(Plan())


EXPERIMENT = Experiment(
    shows="how good the leader's model is, by session time and by processing time",
    duration="2 min",
    run=run,
    group="bench",
)
