"""The evaluation of sessions: how many times faster than real time it runs."""

import statistics
import time
from typing import Final

from mmt.evaluation.evaluate import evaluate_session
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.bench.textures import session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import Findings

EVALUATIONS: Final = {18.0: 5, 60.0: 3, 600.0: 1}
"""Repetitions of the evaluation, of which the median counts, by the length of the session in s."""

LEAST_TIMES: Final = 100.0
"""Target: how many times faster than real time each is evaluated."""


def run() -> Findings:
    """Evaluate simulated sessions several times."""
    figures: dict[str, Figure] = {}
    for duration_s, count in EVALUATIONS.items():
        recorded = session("wood", duration_s)
        if count > 1:
            evaluate_session(recorded)
        times_s = []
        for _ in range(count):
            started = time.perf_counter()
            evaluation = evaluate_session(recorded)
            times_s.append(time.perf_counter() - started)
        median_s, length = statistics.median(times_s), f"{duration_s:g} s"
        mean_ms, largest_ms = evaluation.update_ms or (None, None)
        figures |= {
            f"times_real_time_{duration_s:g}_s": (
                f"{length}: times faster than real time",
                duration_s / median_s,
                "at least",
                LEAST_TIMES,
            ),
            f"median_{duration_s:g}_s": (f"{length}: median (s)", median_s),
            f"spread_{duration_s:g}_s": (
                f"{length}: longest less shortest (s)",
                max(times_s) - min(times_s),
            ),
            f"update_ms_{duration_s:g}_s": (f"{length}: mean update (ms)", mean_ms),
            f"longest_update_ms_{duration_s:g}_s": (f"{length}: longest update (ms)", largest_ms),
        }
    about = "Sessions on wood, evaluated as mmt evaluate does, in memory."
    return single_figures("Evaluation", about, figures)


EXPERIMENT = Experiment(
    shows="how many times faster than real time sessions are evaluated",
    duration="1 min",
    run=run,
    group="bench",
)
