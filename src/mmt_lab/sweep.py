"""Sweeps that can be resumed: many sessions evaluated with many settings, here or by Dask.

Every result is one JSON line, identified by a hash of its origin: the session's data, the settings
and the version. So an interrupted sweep, or one with more settings, computes only the results that
are missing. Runs here and by Dask call `evaluate_job` with the same arguments, and so give the same
numbers.
"""

import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

import mmt
from mmt.cli.options import value_of
from mmt.core.errors import InputError, MmtError
from mmt.core.extras import DISTRIBUTION, require
from mmt.core.files.existing import append_lines, write_file
from mmt.evaluation.evaluate import evaluate_session
from mmt.scene.leader_tables import TEXTURE_TABLE, Texture
from mmt.session.data import RecordedSession
from mmt_lab.harness.processes import in_processes

RESULTS: Final = "results.jsonl"
TABLE: Final = "texture"
"""The one table of a scene that an evaluation depends on."""

_TIMES: Final = ("processing_s", "times_real_time")

Value = str | int | float | bool
"""One value of a setting."""

Settings = Mapping[str, Value]
"""Values by ``"texture.key"``."""


@dataclass(frozen=True)
class Job:
    """One session with one choice of settings; `key` is the hash that identifies the job."""

    key: str
    path: str
    settings: dict[str, Value]
    texture: Texture
    step_s: float
    seed: int


@dataclass(frozen=True)
class JobOutcome:
    """Outcome of a job: its evaluation as a dictionary, or the error that ended it."""

    job: Job
    evaluation: dict[str, Any] | None
    error: str | None = None


def combinations(choices: Sequence[str]) -> list[dict[str, Value]]:
    """Return every combination of the values given as ``KEY=VALUE,VALUE``."""
    values: dict[str, list[Value]] = {}
    for text in choices:
        key, equals, listed = text.partition("=")
        if not equals or not listed or not all(part.strip() for part in listed.split(",")):
            raise InputError(f"--set {text}: give KEY=VALUE,VALUE such as texture.order=8,12")
        if key in values:
            raise InputError(f"--set {key} is given twice: give all its values in one")
        if key.partition(".")[0] != TABLE:
            raise InputError(f"--set {key}: an evaluation depends on the keys of [{TABLE}] alone")
        values[key] = [value_of(part.strip()) for part in listed.split(",")]
    return [
        dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())
    ]


def make_jobs(
    session: RecordedSession,
    base: Texture,
    settings: Sequence[Settings],
    *,
    step_s: float = 2.5,
    seed: int = 0,
) -> list[Job]:
    """Return a job for every choice of settings."""
    data = hashlib.sha256(session.frames.tobytes() + session.annotations).hexdigest()
    jobs = []
    for chosen in settings:
        texture = _texture(base, chosen)
        table = TEXTURE_TABLE.dump_python(texture, mode="json")
        origin = [data, table, step_s, seed, mmt.__version__]
        key = hashlib.sha256(json.dumps(origin, sort_keys=True).encode()).hexdigest()
        jobs.append(Job(key, str(session.path), dict(chosen), texture, step_s, seed))
    return jobs


def evaluate_job(session: RecordedSession, job: Job) -> dict[str, Any]:
    """Evaluate one session; return the evaluation as a dictionary, with the version."""
    evaluation = evaluate_session(
        session,
        job.texture.settings(),
        period_s=job.texture.update_period_s,
        step_s=job.step_s,
        seed=job.seed,
    )
    return {**evaluation.as_dict(), "version": mmt.__version__}


class SweepResults:
    """The results of a sweep, a JSON line each, in one file that only grows.

    Parameters
    ----------
    directory
        Created if it does not exist.
    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / RESULTS
        self.lines: dict[str, dict[str, Any]] = {}
        try:
            directory.mkdir(parents=True, exist_ok=True)
            text = self.path.read_text(encoding="utf-8") if self.path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"--out {directory}: {error}") from error
        whole, _, torn = text.rpartition("\n")
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                content = json.loads(line)
                self.lines[content["key"]] = content
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(f"{self.path}: line {number} is no result of a sweep") from error
        if torn:  # the last line was cut off while it was written
            write_file(self.path, whole + "\n" if whole else "")

    def add(self, outcome: JobOutcome) -> None:
        """Append a result to the file; a failed job is not written, so that it is tried again."""
        if outcome.evaluation is None:
            return
        job = outcome.job
        times = {name: outcome.evaluation.get(name) for name in _TIMES}
        figures = {n: v for n, v in outcome.evaluation.items() if n not in {*_TIMES, "path"}}
        line = {
            "key": job.key,
            "path": job.path,
            "settings": job.settings,
            "evaluation": figures,
            "times": times,
        }
        append_lines(self.path, json.dumps(line) + "\n")
        self.lines[job.key] = line

    def missing(self, jobs: Sequence[Job]) -> list[Job]:
        """Return the jobs that have no result yet, each once."""
        return list({job.key: job for job in jobs if job.key not in self.lines}.values())


def _texture(base: Texture, chosen: Settings) -> Texture:
    values = {key.partition(".")[2]: value for key, value in chosen.items()}
    try:
        return TEXTURE_TABLE.validate_python({**TEXTURE_TABLE.dump_python(base), **values})
    except ValidationError as error:
        problems: dict[str, list[str]] = {}
        for problem in error.errors():
            place = str(problem["loc"][0]) if problem["loc"] else ""
            problems.setdefault(place, []).append(_explain(place, problem["type"], problem["msg"]))
        told = [f"--set {TABLE}.{key}: {' or '.join(why)}" for key, why in problems.items()]
        raise InputError("; ".join(told).replace(f"{TABLE}.: ", "")) from error


def _explain(key: str, kind: str, message: str) -> str:
    if kind == "unexpected_keyword_argument":
        return f"no such key, allowed are {', '.join(field.name for field in fields(Texture))}"
    return message.removeprefix("Value error, ") if key else message.partition(", ")[2]


CONNECT_S: Final = 10


def run_locally(
    jobs: Sequence[Job], sessions: Mapping[str, RecordedSession], workers: int
) -> Iterator[JobOutcome]:
    """Evaluate jobs in processes of this machine; yield each outcome when it is ready."""
    calls = {number: (sessions[job.path], job) for number, job in enumerate(jobs)}
    for number, future in in_processes(evaluate_job, calls, workers):
        yield _outcome(jobs[number], future.result)


def run_on_dask(
    jobs: Sequence[Job], sessions: Mapping[str, RecordedSession], address: str
) -> Iterator[JobOutcome]:
    """Evaluate jobs on a Dask cluster; yield each outcome when it is ready.

    Sessions are sent to the workers, which need no files, but this package in this version.
    """
    require("distributed")
    import distributed

    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise MmtError(f"--dask {address}: no scheduler answers: {error}") from error
    with client:
        _check_installed(client)
        placed = {path: client.scatter(session) for path, session in sessions.items()}
        futures = {
            client.submit(evaluate_job, placed[job.path], job, key=f"mmt-{job.key}"): job
            for job in jobs
        }
        for future in distributed.as_completed(futures, loop=client.loop):
            outcome = _outcome(futures[future], future.result)
            version = (outcome.evaluation or {}).get("version", mmt.__version__)
            if version != mmt.__version__:
                raise MmtError(f"--dask: a worker has mmt {version}, this is {mmt.__version__}")
            yield outcome


def _outcome(job: Job, result: Callable[[], dict[str, Any]]) -> JobOutcome:
    """Return a job's outcome; an `MmtError` becomes its error."""
    try:
        return JobOutcome(job, result())
    except MmtError as error:
        return JobOutcome(job, None, str(error))


def _check_installed(client: Any) -> None:
    """Ask each worker for this package, by a function of the standard library."""
    for worker, found in client.run(metadata.version, DISTRIBUTION, on_error="return").items():
        if isinstance(found, Exception):
            raise MmtError(
                f"--dask: the worker {worker} has no mmt: install {DISTRIBUTION}[lab] "
                f"{mmt.__version__} where it runs"
            )
