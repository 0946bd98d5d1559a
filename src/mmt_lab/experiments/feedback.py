"""Force feedback over a delay by each method, in a closed loop and on recorded contacts.

In the loop a hand, a link with jitter and a simulated follower on a wall run tick by tick, so
that instability can show. On recordings the hand moves as it did without a delay, and the
displayed force is compared with that of the environment at the same instant.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.evaluation.model_errors import root_mean_square
from mmt.evaluation.reports.document import ReportTable, table_of
from mmt.evaluation.texts import number
from mmt_lab.feedback import recorded, simulated
from mmt_lab.feedback.recorded import RecordedResult, evaluate_run, find_runs, model_table, read_run
from mmt_lab.feedback.sides import METHODS, Method
from mmt_lab.feedback.simulated import CellResult, run_cell
from mmt_lab.harness.experiment import Seed, Workers
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.harness.processes import map_in_processes

SHOWS: Final = "which method of force feedback stays stable and true over a delay"
TAKES: Final = "1 min; 10 s a recording"

FREE: Final = "motion"
"""Last word of the names of runs that touch nothing."""

TARGET_DELAY_MS: Final = 100
TARGET_RATIO: Final = 1.0 / 3.0
"""Largest error of the method ``model`` at that delay, over that of the streamed force."""

_NO_ERROR_N: Final = 1e-3

DEFINITIONS: Final = {
    "delay_ms": "one way; the force of a motion comes back after twice this",
    "force_error_n": "recorded: root mean square of the displayed force less the force of the "
    "environment at the same instant of the hand, from the first round trip on, learning "
    "included. Simulated: the same against the force that the tool meets when the hand's "
    "motion has reached it, from the second touch on",
    "position_error_mm": "simulated: the handle's place less the tool's when the hand's motion "
    "has reached it, from the second touch on",
    "injected_mj": "most energy that the hand had got beyond what it had put in",
    "stable": "the handle rests (below 2 mm/s rms) at the end of a simulated run",
    "settled_s": "session time from which the model's stiffness stays within a fifth of its last",
}


def pooled(results: Sequence[RecordedResult]) -> list[dict[str, Any]]:
    """Return the recorded errors, root mean squares over the runs with the same contact.

    ``ratio`` is the error over that of the streamed force, None if that is 0: without a delay.
    """
    errors: dict[tuple[str, int], dict[str, list[float]]] = {}
    for one in results:
        if one.contact != FREE:
            methods = errors.setdefault((one.contact, one.delay_ms), {m: [] for m in METHODS})
            methods[one.method].append(one.force_error_n)
    rows: list[dict[str, Any]] = []
    for (contact, delay_ms), methods in errors.items():
        base_n = root_mean_square(np.array(methods["streamed"]))
        for method, found in methods.items():
            error_n = root_mean_square(np.array(found))
            ratio = _ratio(error_n, base_n)
            cell = {"contact": contact, "method": method, "delay_ms": delay_ms}
            rows.append({**cell, "force_error_n": error_n, "ratio": ratio})
    return rows


def _ratio(error_n: float, base_n: float) -> float | None:
    return error_n / base_n if base_n > _NO_ERROR_N else None


def good(cells: Sequence[CellResult], method: Method) -> tuple[list[CellResult], list[CellResult]]:
    """Return the simulated cells in which a method was stable and passive, and the others."""
    own = [cell for cell in cells if cell.method == method]
    held = [cell for cell in own if cell.stable and cell.passive]
    return held, [cell for cell in own if cell not in held]


def loop_tables(cells: Sequence[CellResult]) -> list[ReportTable]:
    """Return the results of each method by wall and delay: stability, then errors."""
    by_cell: dict[tuple[float, int], dict[str, CellResult]] = {}
    for cell in cells:
        by_cell.setdefault((cell.wall_n_mm, cell.delay_ms), {})[cell.method] = cell

    def table(caption: str, columns: Mapping[str, Callable[[CellResult], str]]) -> ReportTable:
        rows = [
            [f"{wall:g}", str(delay), *(of(found[m]) for of in columns.values() for m in METHODS)]
            for (wall, delay), found in by_cell.items()
        ]
        names = [f"{method} {name}" for name in columns for method in METHODS]
        return ReportTable(["wall (N/mm)", "delay (ms)", *names], rows, caption)

    return [
        table(
            "A light grip in a closed loop, delays with jitter.",
            {
                "stable": lambda cell: "yes" if cell.stable else "NO",
                "injected (mJ)": lambda cell: f"{cell.injected_mj:.2f}",
            },
        ),
        table(
            "Errors from the second touch on.",
            {
                "force (N)": lambda cell: f"{cell.force_error_n:.2f}",
                "position (mm)": lambda cell: f"{cell.position_error_mm:.2f}",
            },
        ),
    ]


def pooled_table(results: Sequence[RecordedResult]) -> ReportTable:
    """Return the recorded errors by contact and delay."""
    rows: dict[tuple[str, int], list[str]] = {}
    for row in pooled(results):
        key = row["contact"], row["delay_ms"]
        cells = rows.setdefault(key, [key[0], str(key[1])])
        cells.append(f"{row['force_error_n']:.3f}")
        if row["method"] == METHODS[-1]:
            cells.append(number(row["ratio"], 2))
    columns = ["contact", "delay (ms)", *(f"{m} error (N)" for m in METHODS), "model / streamed"]
    return ReportTable(
        columns, list(rows.values()), caption="Recorded contacts, pooled over the runs."
    )


def run_table(results: Sequence[RecordedResult]) -> ReportTable:
    """Return each recorded run at the delay of the target, with the contacts estimated."""
    runs: dict[str, dict[str, RecordedResult]] = {}
    for result in results:
        if result.delay_ms == TARGET_DELAY_MS:
            runs.setdefault(result.run, {})[result.method] = result
    rows = []
    for name, methods in runs.items():
        model, base = methods["model"], methods["streamed"].force_error_n
        surface, felt = (model_table(each) or {} for each in (model.surface, model.felt))
        rows.append(
            {
                "run": name,
                "force rms (N)": f"{model.force_n:.2f}",
                **{f"{m} (N)": f"{methods[m].force_error_n:.3f}" for m in METHODS},
                "model / streamed": number(_ratio(model.force_error_n, base), 2),
                "surface (N/m)": number(surface.get("stiffness_n_m"), 0),
                "damping (N s/m)": number(surface.get("damping_n_s_m"), 1),
                "felt (N/m)": number(felt.get("stiffness_n_m"), 0),
                "settled (s)": number(model.settled_s, 2),
            }
        )
    return table_of(rows, f"Recorded runs at {TARGET_DELAY_MS} ms each way.")


def remarks(cells: Sequence[CellResult]) -> list[str]:
    """Return a sentence on each method: the number of cells stable and passive, and the others."""
    sentences = []
    for method in METHODS[1:]:
        held, bad = good(cells, method)
        sentences.append(
            f"{method}: stable and passive in {len(held)} of {len(held) + len(bad)} cells"
            + "".join(f"; not at {c.wall_n_mm:g} N/mm, {c.delay_ms} ms" for c in bad)
        )
    return sentences


def targets(cells: Sequence[CellResult], results: Sequence[RecordedResult]) -> tuple[Target, ...]:
    """Return the targets: all cells stable and passive, and the model's error over the stream's."""
    found = []
    for method in METHODS[1:]:
        held, bad = map(len, good(cells, method))
        found.append(Target(f"{method}: cells stable and passive", held, "at least", held + bad))
    found += [
        Target(
            f"{row['contact']} at {TARGET_DELAY_MS} ms: model's error over streamed",
            row["ratio"],
            "at most",
            TARGET_RATIO,
        )
        for row in pooled(results)
        if row["delay_ms"] == TARGET_DELAY_MS and row["method"] == "model"
    ]
    return tuple(found)


def run(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RECORDING]...", help="Recorded contacts (.npz), or folders."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
) -> Findings:
    """Compare methods of force feedback over a delay."""
    runs = [read_run(path) for path in find_runs(recordings or [])]
    chosen = product(simulated.WALLS_N_MM, simulated.DELAYS_MS, METHODS)
    loops = [(method, wall, delay, seed) for wall, delay, method in chosen]
    cells = map_in_processes(run_cell, loops, workers=workers, what="closed loops")
    replays = [(one, m, delay) for one, delay, m in product(runs, recorded.DELAYS_MS, METHODS)]
    results: list[RecordedResult] = []
    tables = loop_tables(cells)
    if replays:
        what = "recorded contacts"
        results = map_in_processes(evaluate_run, replays, workers=workers, what=what)
        tables += [pooled_table(results), run_table(results)]
    return Findings(
        "Force feedback over a delay",
        tables=tables,
        sentences=remarks(cells),
        targets=targets(cells, results),
        definitions=DEFINITIONS,
        data={
            "simulated": [
                {**asdict(cell), "stable": cell.stable, "passive": cell.passive} for cell in cells
            ],
            "recorded": [
                {
                    **asdict(result),
                    "surface": model_table(result.surface),
                    "felt": model_table(result.felt),
                }
                for result in results
            ],
            "pooled": pooled(results),
        },
    )
