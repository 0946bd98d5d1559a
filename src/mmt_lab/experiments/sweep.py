"""Recorded sessions evaluated with every combination of settings.

Results are appended to a file, so that an interrupted sweep can be resumed. Jobs run in local
processes or on a Dask cluster, with the same figures.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.cli.reporting import scene_of
from mmt.core.errors import InputError, MmtError
from mmt.evaluation.reports.document import ReportTable, table_of
from mmt.evaluation.texts import number, share
from mmt.scene import Texture
from mmt.session.data import RecordedSession
from mmt.session.files import read_session
from mmt_lab.harness.experiment import Seed, Workers
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import counting, processes
from mmt_lab.sweep import (
    Job,
    JobOutcome,
    Settings,
    SweepResults,
    combinations,
    make_jobs,
    run_locally,
    run_on_dask,
)

SHOWS: Final = "how recorded sessions fare with other settings of [texture]"
TAKES: Final = "1 s a session and choice"

MEANS = ("gfc", "gfc_ceiling", "truth_gfc", "power_error_db", "within_jnd", "samples")
"""Figures of the finished model; the mean over sessions is shown."""


def run(
    sessions: Annotated[list[Path], typer.Argument(metavar="SESSION...")],
    choices: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE,VALUE", help="Values of a key; repeatable."),
    ] = None,
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    step: Annotated[float, typer.Option(help="Seconds between the rows of an evaluation.")] = 2.5,
    seed: Seed = 0,
    workers: Workers = None,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="The scheduler of a Dask cluster.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Where the results are kept.")] = Path("mmt-sweep"),
) -> Findings:
    """Evaluate every session with every combination of settings; resume an interrupted sweep."""
    if workers is not None and dask is not None:
        raise InputError("--workers and --dask: give one, a cluster has its own workers")
    settings = combinations(choices or [])
    read = {str(path): _read(path) for path in dict.fromkeys(sessions)}
    jobs: list[Job] = []
    for session in read.values():
        base = scene_of(session, scene_file).texture or Texture()
        jobs += make_jobs(session, base, settings, step_s=step, seed=seed)
    results = SweepResults(out)
    missing = results.missing(jobs)
    outcomes = _outcomes(missing, read, workers, dask)
    failed = _collect(outcomes, results, len(missing), len(jobs))
    summary = _summary(jobs, settings, results)
    lines = [results.lines[key] for key in _done(jobs, results)]
    return Findings(
        "Sessions by settings",
        tables=[_table(summary)],
        sentences=[f"results: {results.path}"],
        data={"settings": summary, "results": lines},
        failures=[f"{each.job.path} {each.job.settings}: {each.error}" for each in failed],
    )


def _read(path: Path) -> RecordedSession:
    """Read a session without the parts that no evaluation needs, since a worker may get it."""
    return replace(read_session(path), models=(), events=(), outputs=())


def _outcomes(
    jobs: Sequence[Job], read: Mapping[str, RecordedSession], workers: int | None, dask: str | None
) -> Iterator[JobOutcome]:
    needed = {job.path: read[job.path] for job in jobs}
    if not jobs:
        return iter(())
    if dask is not None:
        return run_on_dask(jobs, needed, dask)
    return run_locally(jobs, needed, processes(workers, len(jobs)))


def _collect(
    outcomes: Iterator[JobOutcome], results: SweepResults, missing: int, count: int
) -> list[JobOutcome]:
    """Write results as they come, and show their number; return the failed ones."""
    failed = []
    with counting("evaluating", count, done=count - missing, stays=True) as show:
        try:
            for done, outcome in enumerate(outcomes, count - missing + 1):
                results.add(outcome)
                if outcome.error is not None:
                    failed.append(outcome)
                show(done)
        except KeyboardInterrupt as error:
            raise MmtError(
                f"interrupted: {len(results.lines)} results are kept in {results.path}; the "
                "same command goes on"
            ) from error
    return failed


def _done(jobs: Sequence[Job], results: SweepResults) -> list[str]:
    return list(dict.fromkeys(job.key for job in jobs if job.key in results.lines))


def _summary(
    jobs: Sequence[Job], settings: Sequence[Settings], results: SweepResults
) -> list[dict[str, Any]]:
    """Return, for each combination, means over its sessions."""
    rows = []
    for chosen in settings:
        keys = _done([job for job in jobs if job.settings == dict(chosen)], results)
        evaluations = [results.lines[key]["evaluation"] for key in keys]
        finals = [e["at_stop"] or e["at_end"] for e in evaluations]
        stops = [e["stop_s"] for e in evaluations if e["stop_s"] is not None]
        means = {name: _mean([final[name] for final in finals]) for name in MEANS}
        complete = {"complete": len(stops), "stop_s": _mean(stops)}
        rows.append({"settings": dict(chosen), "sessions": len(keys), **complete, **means})
    return rows


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None


def _table(summary: Sequence[dict[str, Any]]) -> ReportTable:
    rows = []
    for row in summary:
        name = ", ".join(f"{key.partition('.')[2]} {v}" for key, v in row["settings"].items())
        rows.append(
            {
                "settings": name or "as recorded",
                "sessions": str(row["sessions"]),
                "complete": str(row["complete"]),
                "stop (s)": number(row["stop_s"], 1),
                "samples": number(row["samples"], 1),
                "GFC": number(row["gfc"], 3),
                "ceiling": number(row["gfc_ceiling"], 3),
                "power error (dB)": number(row["power_error_db"], 2),
                "within JND": share(row["within_jnd"]),
            }
        )
    caption = "Means over sessions, at the stop criterion or at the end where it was never met."
    return table_of(rows, caption)
