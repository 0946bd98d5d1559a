"""The evaluation of force feedback as tables, and its report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mmt.contact.estimation import ContactModel
from mmt.evaluation.document import Table
from mmt_lab.feedback.recorded import RecordedResult
from mmt_lab.feedback.results import (
    DEFINITIONS,
    TARGET_DELAY_MS,
    TARGET_RATIO,
    FeedbackEvaluation,
)
from mmt_lab.feedback.sides import METHODS
from mmt_lab.feedback.simulated import CellResult
from mmt_lab.judged_report import write_judged_report

TITLE: Final = "Force feedback over a delay"


def stability_table(cells: Sequence[CellResult]) -> Table:
    """Return, for each wall and delay, whether each method was stable and what it injected."""
    rows = []
    for (wall, delay), methods in _by_cell(cells).items():
        rows.append(
            [f"{wall:g}", str(delay)]
            + ["yes" if methods[m].stable else "NO" for m in METHODS]
            + [f"{methods[m].injected_mj:.2f}" for m in METHODS]
        )
    columns = ["wall (N/mm)", "delay (ms)"]
    columns += [f"{m} stable" for m in METHODS] + [f"{m} injected (mJ)" for m in METHODS]
    return Table(columns, rows, caption="A light grip in a closed loop, delays with jitter.")


def transparency_table(cells: Sequence[CellResult]) -> Table:
    """Return, for each wall and delay, the errors of each method."""
    rows = []
    for (wall, delay), methods in _by_cell(cells).items():
        rows.append(
            [f"{wall:g}", str(delay)]
            + [f"{methods[m].force_error_n:.2f}" for m in METHODS]
            + [f"{methods[m].position_error_mm:.2f}" for m in METHODS]
        )
    columns = ["wall (N/mm)", "delay (ms)"]
    columns += [f"{m} force (N)" for m in METHODS] + [f"{m} position (mm)" for m in METHODS]
    return Table(columns, rows, caption="Errors from the second touch on.")


def pooled_table(evaluation: FeedbackEvaluation) -> Table:
    """Return the recorded errors by what was touched and by delay."""
    rows: dict[tuple[str, int], list[str]] = {}
    for row in evaluation.pooled():
        cells = rows.setdefault((row.contact, row.delay_ms), [row.contact, str(row.delay_ms)])
        cells.append(f"{row.force_error_n:.3f}")
        if row.method == METHODS[-1]:
            cells.append("-" if row.ratio is None else f"{row.ratio:.2f}")
    columns = ["contact", "delay (ms)", *(f"{m} error (N)" for m in METHODS), "model / streamed"]
    return Table(columns, list(rows.values()), caption="Recorded contacts, pooled over the runs.")


def run_table(results: Sequence[RecordedResult]) -> Table:
    """Return each recorded run at the target's delay, with what was estimated."""
    rows = []
    chosen = [r for r in results if r.delay_ms == TARGET_DELAY_MS]
    streamed = {r.run: r.force_error_n for r in chosen if r.method == "streamed"}
    passive = {r.run: r.force_error_n for r in chosen if r.method == "passive"}
    for result in chosen:
        if result.method != "model":
            continue
        base = streamed[result.run]
        rows.append(
            [
                result.run,
                f"{result.force_n:.2f}",
                f"{base:.3f}",
                f"{passive[result.run]:.3f}",
                f"{result.force_error_n:.3f}",
                f"{result.force_error_n / base:.2f}",
                f"{result.least_error_n / base:.2f}",
                *_estimate(result.surface),
                *_estimate(result.felt)[:1],
                "-" if result.settled_s is None else f"{result.settled_s:.2f}",
            ]
        )
    columns = ["run", "force rms (N)", *(f"{m} (N)" for m in METHODS), "model / streamed"]
    columns += ["least / streamed", "surface (N/m)", "damping (N s/m)", "felt (N/m)", "settled (s)"]
    return Table(columns, rows, caption=f"Recorded runs at {TARGET_DELAY_MS} ms each way.")


def verdicts(evaluation: FeedbackEvaluation) -> list[str]:
    """Return in words which targets were met, and which cells or runs missed them."""
    sentences = []
    for method in METHODS[1:]:
        cells = [cell for cell in evaluation.simulated if cell.method == method]
        bad = [cell for cell in cells if not (cell.stable and cell.passive)]
        sentences.append(
            f"{method}: stable and passive in {len(cells) - len(bad)} of {len(cells)} cells"
            + "".join(f"; not at {c.wall_n_mm:g} N/mm, {c.delay_ms} ms" for c in bad)
        )
    pooled = [
        row
        for row in evaluation.pooled()
        if row.delay_ms == TARGET_DELAY_MS and row.method == "model"
    ]
    sentences += [
        f"{row.contact} at {TARGET_DELAY_MS} ms: the model's error is {row.ratio:.2f} of the "
        f"streamed force's, {'below' if row.ratio < TARGET_RATIO else 'NOT below'} a third"
        for row in pooled
        if row.ratio is not None
    ]
    return sentences


def feedback_tables(evaluation: FeedbackEvaluation) -> list[Table]:
    """Return the tables that there is something for."""
    tables = [stability_table(evaluation.simulated), transparency_table(evaluation.simulated)]
    if evaluation.recorded:
        tables.append(pooled_table(evaluation))
        if any(result.delay_ms == TARGET_DELAY_MS for result in evaluation.recorded):
            tables.append(run_table(evaluation.recorded))
    return tables


def write_feedback_report(directory: Path, evaluation: FeedbackEvaluation) -> Path:
    """Write ``report.html``, ``report.md`` and ``summary.json``; return the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    return write_judged_report(
        directory,
        TITLE,
        verdicts(evaluation),
        feedback_tables(evaluation),
        DEFINITIONS,
        evaluation.as_dict(),
    )


def _by_cell(cells: Sequence[CellResult]) -> dict[tuple[float, int], dict[str, CellResult]]:
    found: dict[tuple[float, int], dict[str, CellResult]] = {}
    for cell in cells:
        found.setdefault((cell.wall_n_mm, cell.delay_ms), {})[cell.method] = cell
    return found


def _estimate(model: ContactModel | None) -> list[str]:
    if model is None:
        return ["-", "-"]
    return [f"{model.stiffness_at(1.0):.0f}", f"{model.damping_n_s_m:.1f}"]
