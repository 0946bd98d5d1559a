"""The evaluation of a session: how many times faster than real time it runs."""

import statistics
import time
from typing import Final

from mmt.evaluation.evaluate import evaluate_session
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.bench.textures import session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import Findings

DURATION_S: Final = 18.0
"""Length of the session."""

EVALUATIONS: Final = 5
"""Repetitions of the evaluation; the median counts."""


def run() -> Findings:
    """Evaluate a simulated session several times."""
    recorded = session("wood", DURATION_S)
    evaluate_session(recorded)
    times_s = []
    for _ in range(EVALUATIONS):
        started = time.perf_counter()
        evaluate_session(recorded)
        times_s.append(time.perf_counter() - started)
    median_s = statistics.median(times_s)
    times = DURATION_S / median_s
    figures: dict[str, Figure] = {
        "times_real_time": ("evaluation, times faster than real time", times, "at least", 50),
        "median_s": ("18 s session, median (s)", median_s),
        "spread_s": ("longest less shortest (s)", max(times_s) - min(times_s)),
    }
    about = f"An 18 s session, evaluated {EVALUATIONS} times as mmt evaluate does."
    return single_figures("Evaluation", about, figures)


EXPERIMENT = Experiment(
    shows="how many times faster than real time a session is evaluated",
    duration="10 s",
    run=run,
    group="bench",
)
