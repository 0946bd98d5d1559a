"""Speed of the evaluation of sessions, in times faster than real time."""

import statistics
import time
from typing import Final

from mmt.evaluation.evaluate import evaluate_session
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.compare.cases import session
from mmt_lab.harness.findings import Findings

SHOWS: Final = "how many times faster than real time sessions are evaluated"
TAKES: Final = "1 min"
GROUP: Final = "bench"

EVALUATIONS: Final = {
    (18.0, 1): (5, 100.0),
    (60.0, 1): (3, 100.0),
    (600.0, 1): (1, 100.0),
    (18.0, 10): (3, 30.0),
}
"""By the length of a session in s and the rate of its acceleration in kHz: number of evaluations,
of which the median counts, and the target in times faster than real time."""


def run() -> Findings:
    """Evaluate simulated sessions several times."""
    figures: dict[str, Figure] = {}
    for (duration_s, rate_khz), (count, least_times) in EVALUATIONS.items():
        recorded = session("wood", duration_s, acceleration_rate_hz=1000 * rate_khz)
        if count > 1:
            evaluate_session(recorded)
        times_s = []
        for _ in range(count):
            started = time.perf_counter()
            evaluation = evaluate_session(recorded)
            times_s.append(time.perf_counter() - started)
        median_s = statistics.median(times_s)
        key, length = f"{duration_s:g}_s", f"{duration_s:g} s"
        if rate_khz > 1:
            key, length = f"{key}_{rate_khz}_khz", f"{length} at {rate_khz} kHz"
        mean_ms, largest_ms = evaluation.update_ms or (None, None)
        figures |= {
            f"times_real_time_{key}": (
                f"{length}: times faster than real time",
                duration_s / median_s,
                "at least",
                least_times,
            ),
            f"median_{key}": (f"{length}: median (s)", median_s),
            f"spread_{key}": (
                f"{length}: longest less shortest (s)",
                max(times_s) - min(times_s),
            ),
            f"update_ms_{key}": (f"{length}: mean update (ms)", mean_ms),
            f"longest_update_ms_{key}": (f"{length}: longest update (ms)", largest_ms),
        }
    about = "Sessions on wood, evaluated as mmt evaluate does, in memory."
    return single_figures("Evaluation", about, figures)
