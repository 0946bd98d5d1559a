"""Run the jobs of a sweep: in processes of this machine, or on an existing Dask cluster.

Both call `mmt_lab.sweep.combinations.evaluate_job` with the same arguments, and so give the same
numbers.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from typing import Any, Final

import mmt
from mmt.core.errors import MmtError
from mmt.core.extras import DISTRIBUTION, require
from mmt.session.data import RecordedSession
from mmt_lab.harness.processes import in_processes
from mmt_lab.sweep.combinations import Job, JobOutcome, evaluate_job

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
