"""Contact integration: error of an impact against time, over step sizes."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.integrate import solve_ivp

from mmt.contact.normal import ContactLaw, Drive
from mmt.core.arrays import FloatArray
from mmt.testing.simulation.robot import tip_drive
from mmt_lab.bench.measuring import interleave
from mmt_lab.contact.integrators import INTEGRATORS, Step, accelerate
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    MICROSECONDS,
    Axis,
    Curve,
    Curves,
    Findings,
    FindingsTable,
    Panel,
)

TIME: Final = Axis("time of a simulated millisecond (µs)", "µs")
ERROR: Final = Axis("largest error of the height over the depth", "error")
RADAU: Final = "scipy Radau (knob: tolerance)"
TICK_S: Final = 0.001
HEIGHTS_M: Final = (0.00041, 0.00047, 0.00053, 0.00059)
"""Where the tip comes from: the surface is met at different parts of a step."""

SPEED_M_S: Final = 0.1

COMMAND_M: Final = -0.001
BANDWIDTH_HZ: Final = 15.0
DAMPING_RATIO: Final = 0.1
GOOD: Final = 0.01
"""An error that is small: a hundredth of the depth."""

_DIVERGED: Final = 10.0

Run = Callable[[float], FloatArray]
"""From the height at the start (m) to the height at the end of every tick, (ticks,)."""

STIFFNESSES_N_M: Final = (5_000.0, 50_000.0)
TICKS: Final = 40
DIVISIONS: Final = (1, 2, 4, 8, 16, 32, 64, 128)
TOLERANCES: Final = (1e-3, 1e-5, 1e-7)
REFERENCE: Final = 1e-11
ROUNDS: Final = 5


def run() -> Findings:
    """Measure every integrator on an impact and the contact that follows."""
    panels = [_panel(stiffness) for stiffness in STIFFNESSES_N_M]
    rows = [row for panel in panels for curve in panel.curves for row in _rows(panel, curve)]
    names = ", ".join(f"{stiffness / 1000:g}" for stiffness in STIFFNESSES_N_M)
    return Findings(
        title="Contact integration",
        about=(
            f"The simulated follower's tip comes at {SPEED_M_S:g} m/s onto walls of {names} "
            f"N/mm with a damping ratio of {DAMPING_RATIO:g}, and is held in contact: "
            f"{TICKS} ms. The largest error at any millisecond, the mean over "
            f"{len(HEIGHTS_M)} heights that it comes from, against scipy's Radau with a "
            f"relative tolerance of {REFERENCE:g}. All in plain Python, as the follower "
            "runs them."
        ),
        panels=tuple(panels),
        records=(
            FindingsTable(
                "coarsest", f"The coarsest step with an error below {GOOD:g}", tuple(rows)
            ),
        ),
    )


def _panel(stiffness_n_m: float) -> Panel:
    drive, _ = tip_drive(BANDWIDTH_HZ)
    law = ContactLaw(
        stiffness_n_m, damping_n_s_m=2 * DAMPING_RATIO * math.sqrt(stiffness_n_m * drive.mass_kg)
    )
    references = [_radau(drive, law, REFERENCE, height) for height in HEIGHTS_M]
    runs: dict[tuple[str, float], Run] = {}
    for division in DIVISIONS:
        for name, way in INTEGRATORS.items():
            knob = TICK_S / division * MICROSECONDS
            runs[name, knob] = partial(_stepped, way.step, drive, law, division)
    for tolerance in TOLERANCES:
        runs[RADAU, tolerance] = partial(_radau, drive, law, tolerance)
    curves = Curves()
    errors = {key: _error(run, references) for key, run in runs.items()}
    good = {key: error for key, error in errors.items() if error < _DIVERGED}
    tasks = {f"{name}/{knob}": partial(runs[name, knob], HEIGHTS_M[0]) for name, knob in good}
    times = interleave(tasks, ROUNDS)
    for (name, knob), error in errors.items():
        if (name, knob) in good:
            time = times[f"{name}/{knob}"].times(MICROSECONDS / TICKS)
            curves.add(name, knob, time, error)
        else:
            curves.fail(name, knob, "diverges")
    name = f"{stiffness_n_m / 1000:g} N/mm"
    title = f"Impact on {name}, by step"
    return Panel(f"wall_{stiffness_n_m:g}", title, "step (µs)", TIME, ERROR, curves.done())


def _error(run: Run, references: Sequence[FloatArray]) -> float:
    errors = [
        np.abs(run(height) - reference).max() / -reference.min()
        for height, reference in zip(HEIGHTS_M, references, strict=True)
    ]
    return float(np.mean(errors))


def _stepped(
    step: Step, drive: Drive, law: ContactLaw, division: int, start_m: float
) -> FloatArray:
    state = start_m, -SPEED_M_S
    heights = np.empty(TICKS)
    for tick in range(TICKS):
        for _ in range(division):
            state = step(drive, law, state, COMMAND_M, TICK_S / division)[:2]
        if not abs(state[0]) < 1.0:
            heights[tick:] = math.inf
            break
        heights[tick] = state[0]
    return heights


def _radau(drive: Drive, law: ContactLaw, tolerance: float, start_m: float) -> FloatArray:
    """Return the height at the end of every tick by scipy's Radau, (ticks,)."""

    def slope(_time: float, state: FloatArray) -> tuple[float, float]:
        height, velocity = float(state[0]), float(state[1])
        return velocity, accelerate(drive, law, (height, velocity), COMMAND_M)[1]

    moments = TICK_S * np.arange(1, TICKS + 1)
    solution = solve_ivp(
        slope,
        (0.0, float(moments[-1])),
        (start_m, -SPEED_M_S),
        method="Radau",
        t_eval=moments,
        rtol=tolerance,
        atol=tolerance * 1e-6,
        max_step=TICK_S,
    )
    return np.asarray(solution.y[0], dtype=np.float64)


def _rows(panel: Panel, curve: Curve) -> list[dict[str, str | float | None]]:
    if curve.method == RADAU:
        return []
    good = [point for point in curve.points if point.y.median < GOOD]
    coarsest = max(good, key=lambda point: point.knob, default=None)
    slopes = [
        math.log(after.y.median / before.y.median) / math.log(after.knob / before.knob)
        for before, after in pairwise(curve.points)
        if before.y.median > 0 and after.y.median > 0
    ]
    return [
        {
            "wall": panel.title.removeprefix("Impact on ").removesuffix(", by step"),
            "integrator": curve.method,
            "step (µs)": coarsest.knob if coarsest else None,
            "error": coarsest.y.median if coarsest else None,
            "µs a ms": coarsest.x.median if coarsest else None,
            "order seen": slopes[-1] if slopes else None,
            "diverges at (µs)": ", ".join(curve.failures) or "-",
        }
    ]


EXPERIMENT = Experiment(
    shows="how exact the integrators of contact are, by their cost",
    duration="20 s",
    run=run,
    group="bench",
)
