"""The whole pipeline: how good the leader's model is, by session time and by processing time."""

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Final

import numpy as np

from mmt.evaluation.model_errors import root_mean_square
from mmt.evaluation.truth import KnownTexture, known_texture
from mmt.session.data import RecordedSession
from mmt.texture.online.history import ModelHistory, build, stream_blocks
from mmt.texture.settings import Method, ModellingSettings
from mmt.texture.signals.metrics import within_jnd
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.bench.measuring import interleave, spread
from mmt_lab.compare.cases import session
from mmt_lab.harness.findings import Axis, Curves, Findings, FindingsTable, Panel, Target

SHOWS: Final = "how good the leader's model is, by session time and by processing time"
TAKES: Final = "2 min"
GROUP: Final = "bench"

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

SURFACES: Final = ("plastic", "mesh", "wood", "sandpaper", "ribbed")
DURATION_S: Final = 18.0
MOMENTS_S: Final = (3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 18.0)
PERIODS_S: Final = (0.25, 0.5, 1.0, 2.0)
ROUNDS: Final = 3
RATES_KHZ: Final = (1, 2, 5, 10)


def run() -> Findings:
    """Build every session's model as the leader does, and compare each state with the truth."""
    sessions = [session(name, DURATION_S) for name in SURFACES]
    by_session = {name: Curves() for name in MEASURES}
    by_processing = {name: Curves() for name in MEASURES}
    rows = []
    for method, period_s in product(METHODS, PERIODS_S):
        settings = ModellingSettings(method=method)
        runs = [ModelRun(one, settings, period_s, ROUNDS) for one in sessions]
        _add_points(runs, by_session, by_processing)
        rows += [_row(run) for run in runs]
    rates = tuple(_rate_row(*one) for one in product(RATES_KHZ, METHODS))
    return Findings(
        title="Whole pipeline",
        about=(
            f"Simulated sessions of {DURATION_S:g} s on {', '.join(SURFACES)}; an "
            "update at several periods, every setting at its default but the method. The "
            "leader's model against the known texture over the plane, 12 x 12 points, the mean "
            "over textures: goodness of fit at the resolution of Welch's estimate, power, and "
            "the share of points whose power is within one just noticeable difference (1.36 "
            "dB). Processing time: filtering, segmenting, fitting and triangulating up to "
            f"then; the least of {ROUNDS} runs, its quartiles over textures, and of an update "
            "the mean and the longest of the session."
        ),
        panels=(
            *_panels("session", "by session time", SESSION, by_session),
            *_panels("processing", "by processing time", PROCESSING, by_processing),
        ),
        records=(
            FindingsTable("textures", "At the end of the session, by texture", tuple(rows)),
            FindingsTable(
                "rates",
                f"By the rate of the acceleration, on {SURFACES[0]}, an update every second",
                rates,
            ),
        ),
        targets=_targets(rates),
    )


def _add_points(
    runs: Sequence["ModelRun"], by_session: dict[str, Curves], by_processing: dict[str, Curves]
) -> None:
    """Add the errors at each moment, means over the textures, of a method and a period."""
    curve = f"{runs[0].method}, every {runs[0].period_s:g} s"
    for moment in MOMENTS_S:
        found = np.mean([run.at(moment) for run in runs], axis=0).tolist()
        time = spread(np.array([run.spent_ms(moment) for run in runs]))
        for name, value in zip(MEASURES, found, strict=True):
            by_session[name].add(curve, moment, moment, value)
            if time.median > 0.0:  # not before the first update
                by_processing[name].add(curve, moment, time, value)


def _panels(kind: str, words: str, x: Axis, curves: dict[str, Curves]) -> list[Panel]:
    return [
        Panel(f"{name}_{kind}", f"{title}, {words}", "session time (s)", x, y, curves[name].build())
        for name, (title, y) in MEASURES.items()
    ]


class ModelRun:
    """One session, modelled `rounds` times, and its known texture.

    The time of an update is the least of all rounds.
    """

    def __init__(
        self, recorded: RecordedSession, settings: ModellingSettings, period_s: float, rounds: int
    ) -> None:
        self.method, self.period_s = settings.method, period_s
        blocks = list(stream_blocks([recorded.frames], round(period_s * settings.rate_hz)))
        histories = [build(blocks, settings, deferred=False) for _ in range(rounds)]
        self.history: ModelHistory = histories[0]
        update_s = np.min(
            [[update.spent_s for update in history.updates] for history in histories], axis=0
        )
        self._spent_s = np.cumsum(update_s)
        self.update_ms = update_s * _MILLISECONDS
        truth, reason = known_texture(recorded.annotations, settings)
        if truth is None:
            raise ValueError(reason)
        self.truth: KnownTexture = truth

    def at(self, moment_s: float) -> tuple[float, float, float]:
        """Return 1 - GFC, power error (dB) and share within one JND, of silence if no model."""
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
        """Return the time that all updates up to a session time took."""
        number = self.history.number(moment_s)
        return float(self._spent_s[number]) * _MILLISECONDS if number >= 0 else 0.0


def _row(run: ModelRun) -> dict[str, str | float | None]:
    shape, level, jnd = run.at(DURATION_S)
    return {
        "method": run.method,
        "update every (s)": run.period_s,
        "texture": run.truth.surface.name,
        "GFC": 1.0 - shape,
        "power error (dB)": level,
        "within JND": jnd,
        "complete after (s)": run.history.stop_s,
        "processing (ms)": run.spent_ms(DURATION_S),
        "an update (ms)": float(run.update_ms.mean()),
        "longest update (ms)": float(run.update_ms.max()),
    }


def _rate_row(rate_khz: int, method: Method) -> dict[str, str | float | None]:
    """Return the cost of an update and of a second of rendered vibration at a rate."""
    recorded = session(SURFACES[0], DURATION_S, acceleration_rate_hz=1000 * rate_khz)
    settings = ModellingSettings(method=method, samples_per_frame=rate_khz)
    run = ModelRun(recorded, settings, 1.0, ROUNDS)
    rendered_ms = None
    model = run.history.model(len(run.history.updates) - 1)
    if model is not None:
        motion = (np.full(1000 * rate_khz, value) for value in (100.0, 1.0))
        render = partial(Synthesizer(model, seed=1).render, *motion)
        rendered_ms = interleave({"render": render}, ROUNDS)["render"].median * _MILLISECONDS
    return {
        "acceleration (kHz)": rate_khz,
        "method": method,
        "order": run.history.updates[-1].order,
        "an update (ms)": float(run.update_ms.mean()),
        "longest update (ms)": float(run.update_ms.max()),
        "a second rendered (ms)": rendered_ms,
    }


def _targets(rates: Sequence[dict[str, str | float | None]]) -> tuple[Target, ...]:
    """Return the targets for the times of the slower method at 1 kHz."""
    at_1_khz = [row for row in rates if row["acceleration (kHz)"] == 1]
    bounds = {"a second rendered (ms)": 20.0, "longest update (ms)": 50.0}
    return tuple(
        Target(
            f"acceleration at 1 kHz: {what}",
            max((value for row in at_1_khz if isinstance(value := row[what], float)), default=None),
            "at most",
            bound,
        )
        for what, bound in bounds.items()
    )
