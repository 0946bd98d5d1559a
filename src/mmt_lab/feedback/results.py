"""The evaluation of force feedback: all cells, pooled by what was touched, and for programs."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from mmt_lab.feedback import recorded, simulated
from mmt_lab.feedback.recorded import RecordedResult, evaluate_run, model_table, read_run
from mmt_lab.feedback.sides import METHODS, Method
from mmt_lab.feedback.simulated import CellResult, run_cell

FREE: Final = "motion"
"""Last word of the names of runs that touch nothing."""

TARGET_DELAY_MS: Final = 100
TARGET_RATIO: Final = 1.0 / 3.0
"""Largest error of the model at that delay, over that of the streamed force."""

_NO_ERROR_N: Final = 1e-3

DEFINITIONS: Final = {
    "delay_ms": "one way; the force of a motion comes back after twice this",
    "force_error_n": "recorded: root mean square of the displayed force less the force of the "
    "environment at the same instant of the hand, from the first round trip on, learning "
    "included. Simulated: the same against the force that the tool meets when the hand's "
    "motion has reached it, from the second touch on",
    "least_error_n": "recorded: the least force error of a passive display that knows the whole "
    "recording from the moment when the first contact has arrived, and shows nothing before",
    "position_error_mm": "simulated: the handle's place less the tool's when the hand's motion "
    "has reached it, from the second touch on",
    "injected_mj": "most energy that the hand had got beyond what it had put in",
    "stable": "the handle rests (below 2 mm/s rms) at the end of a simulated run",
    "settled_s": "session time from which the model's stiffness stays within a fifth of its last",
}


@dataclass(frozen=True)
class Pooled:
    """Root mean square over the runs that touched the same."""

    contact: str
    method: Method
    delay_ms: int
    force_error_n: float
    ratio: float | None
    """To the streamed force's; None where that has no error, as without a delay."""


@dataclass(frozen=True)
class FeedbackEvaluation:
    """Every cell of both parts; ``recorded`` is empty where no recording was named."""

    simulated: Sequence[CellResult]
    recorded: Sequence[RecordedResult]

    def pooled(self) -> list[Pooled]:
        """Return the recorded errors, pooled by what was touched."""
        keys = dict.fromkeys((r.contact, r.delay_ms) for r in self.recorded if r.contact != FREE)
        rows: list[Pooled] = []
        for contact, delay_ms in keys:
            errors = {m: self._pooled_n(contact, delay_ms, m) for m in METHODS}
            base_n = errors["streamed"]
            rows += [
                Pooled(
                    contact, m, delay_ms, error, error / base_n if base_n > _NO_ERROR_N else None
                )
                for m, error in errors.items()
            ]
        return rows

    def _pooled_n(self, contact: str, delay_ms: int, method: Method) -> float:
        squares = [
            r.force_error_n**2
            for r in self.recorded
            if (r.contact, r.delay_ms, r.method) == (contact, delay_ms, method)
        ]
        return float((sum(squares) / len(squares)) ** 0.5)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        return {
            "simulated": [
                {**asdict(cell), "stable": cell.stable, "passive": cell.passive}
                for cell in self.simulated
            ],
            "recorded": [
                {
                    **asdict(result),
                    "surface": model_table(result.surface),
                    "felt": model_table(result.felt),
                }
                for result in self.recorded
            ],
            "pooled": [asdict(row) for row in self.pooled()],
            "definitions": DEFINITIONS,
        }


def evaluate_feedback(
    paths: Sequence[Path],
    *,
    walls_n_mm: Sequence[float] = simulated.WALLS_N_MM,
    delays_ms: Sequence[int] = simulated.DELAYS_MS,
    recorded_delays_ms: Sequence[int] = recorded.DELAYS_MS,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> FeedbackEvaluation:
    """Run every method in every cell; about 2 s a wall and delay, and as much a run and delay.

    Parameters
    ----------
    paths
        Recorded runs; none leaves that part out.
    walls_n_mm, delays_ms
        Cells of the closed loop.
    recorded_delays_ms
        Delays of the recorded runs.
    seed
        Of the jitter.
    progress
        Called with the number of cells done and of all.

    Raises
    ------
    InputError
        A recording cannot be used.
    """
    runs = [read_run(path) for path in paths]
    loops = [(m, w, d) for w in walls_n_mm for d in delays_ms for m in METHODS]
    replays = [(run, m, d) for run in runs for d in recorded_delays_ms for m in METHODS]
    count = len(loops) + len(replays)
    cells, results = [], []
    for method, wall_n_mm, delay_ms in loops:
        cells.append(run_cell(method, wall_n_mm, delay_ms, seed=seed))
        progress(len(cells), count)
    for run, method, delay_ms in replays:
        results.append(evaluate_run(run, method, delay_ms))
        progress(len(cells) + len(results), count)
    return FeedbackEvaluation(cells, results)
