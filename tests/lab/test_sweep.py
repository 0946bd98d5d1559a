"""Sweeps: combinations, resuming, and the same numbers wherever they run."""

import copy
import dataclasses
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import pytest
from lab_runs import run_lab

from mmt.core.errors import InputError, MmtError
from mmt.scene import Texture
from mmt.session.data import RecordedSession
from mmt.session.files import write_session
from mmt_lab.experiments import sweep
from mmt_lab.sweep import (
    JobOutcome,
    SweepResults,
    combinations,
    evaluate_job,
    make_jobs,
    run_locally,
    run_on_dask,
)

CHOICES = ("texture.order=6,9", "texture.method=field")


@pytest.fixture(scope="module")
def session(stroked_session):
    return dataclasses.replace(stroked_session, frames=stroked_session.frames[:4000])


@pytest.fixture
def file(session, tmp_path):
    write_session(tmp_path / "even.npz", session.frames)
    return tmp_path / "even.npz"


@contextmanager
def dask_worker():
    """A cluster of one worker in this process, or a skipped test without Dask."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        host="127.0.0.1",
        protocol="tcp",
    ) as cluster:
        yield cluster.scheduler_address


def jobs_of(session, choices=CHOICES, **options):
    return make_jobs(session, Texture(), combinations(choices), **options)


def figures(outcomes):
    """Return what must not depend on where a job ran."""
    found = {}
    for outcome in outcomes:
        assert outcome.error is None
        content = dict(outcome.evaluation)
        for name in ("processing_s", "times_real_time"):
            assert content.pop(name) > 0
        found[outcome.job.key] = without_times(content)
    return found


def without_times(evaluation):
    """Return an evaluation without what its updates took."""
    kept = copy.deepcopy(evaluation)
    for score in (*kept["steps"], kept["at_start"], kept["at_stop"], kept["at_end"]):
        if score is not None:
            del score["update_ms"]
    return kept


@pytest.fixture(scope="module")
def by_processes(session):
    """What two processes of this machine find."""
    return figures(run_locally(jobs_of(session), {str(session.path): session}, 2))


def test_every_combination_is_made_once_with_the_types_of_toml():
    assert combinations(["texture.order=8,16", "texture.stationarity=0.1, 1e-1"]) == [
        {"texture.order": 8, "texture.stationarity": 0.1},
        {"texture.order": 8, "texture.stationarity": 0.1},
        {"texture.order": 16, "texture.stationarity": 0.1},
        {"texture.order": 16, "texture.stationarity": 0.1},
    ]
    assert combinations([]) == [{}]


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        (["texture.order"], "KEY=VALUE"),
        (["texture.order="], "KEY=VALUE"),
        (["texture.order=8,,9"], "KEY=VALUE"),
        (["texture.order=8", "texture.order=9"], "twice"),
        (["link.port=80"], r"\[texture\] alone"),
        (["texture.ordr=8"], "texture.ordr: no such key, allowed are method, axis"),
        (["texture.order=99"], "texture.order: .*less than or equal to 64"),
    ],
)
def test_a_choice_that_is_not_allowed_is_explained(session, choices, words):
    with pytest.raises(InputError, match=words):
        jobs_of(session, choices)


def test_a_job_is_known_by_its_data_and_settings_alone(session):
    first, second = jobs_of(session)
    assert first.key != second.key
    elsewhere = dataclasses.replace(session, path=Path("copy.mcap"))
    assert [job.key for job in jobs_of(elsewhere)] == [first.key, second.key]
    # A choice that says what holds anyway is the same job.
    assert jobs_of(session, ["texture.order=6"])[0].key == first.key
    frames = session.frames.copy()
    frames["force_n"][0, 2] += 1e-3
    for other in (
        jobs_of(dataclasses.replace(session, frames=frames))[0],
        jobs_of(session, seed=1)[0],
        jobs_of(session, step_s=2.0)[0],
    ):
        assert other.key != first.key


def test_a_line_that_was_cut_off_is_computed_again(session, tmp_path):
    first, second = jobs_of(session)
    results = SweepResults(tmp_path)
    for job in (first, second):
        results.add(JobOutcome(job, {"order": job.texture.order}))
    whole = results.path.read_text(encoding="utf-8")
    results.path.write_text(whole[:-20], encoding="utf-8")
    again = SweepResults(tmp_path)
    assert again.missing([first, second]) == [second]
    again.add(JobOutcome(second, {"order": 9}))
    assert len(SweepResults(tmp_path).lines) == 2


def test_a_file_that_is_no_sweep_is_refused(tmp_path):
    (tmp_path / "results.jsonl").write_text('{"key": 1}\nnonsense\n', encoding="utf-8")
    with pytest.raises(InputError, match="line 2"):
        SweepResults(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        SweepResults(tmp_path / "file")


def test_processes_give_the_numbers_of_this_one(session, by_processes):
    here = {job.key: evaluate_job(session, job) for job in jobs_of(session)}
    assert set(by_processes) == set(here)
    for key, content in by_processes.items():
        own = without_times(here[key])
        assert content == {name: own[name] for name in content}


def test_a_session_that_cannot_be_evaluated_fails_alone(session):
    empty = RecordedSession(session.frames[:0], path=Path("empty.mcap"))
    jobs = [*jobs_of(session, ["texture.order=6"]), *jobs_of(empty, ["texture.order=6"])]
    sessions = {str(one.path): one for one in (session, empty)}
    outcomes = {outcome.job.path: outcome for outcome in run_locally(jobs, sessions, 1)}
    assert outcomes[str(session.path)].error is None
    assert "no frames" in outcomes["empty.mcap"].error
    assert outcomes["empty.mcap"].evaluation is None


def test_a_dask_cluster_gives_the_numbers_of_local_processes(session, by_processes):
    with dask_worker() as address:
        on_dask = figures(run_on_dask(jobs_of(session), {str(session.path): session}, address))
    assert on_dask == by_processes


def test_a_worker_without_mmt_is_said(session, monkeypatch):
    def nowhere(name):
        raise metadata.PackageNotFoundError(name)

    words = r"the worker tcp.* has no mmt: install mmt-haptics\[lab"
    with dask_worker() as address:
        monkeypatch.setattr(metadata, "distribution", nowhere)
        with pytest.raises(MmtError, match=words):
            list(run_on_dask(jobs_of(session), {}, address))
        monkeypatch.undo()


def test_a_scheduler_that_does_not_answer_is_said(session, monkeypatch):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    monkeypatch.setattr("mmt_lab.sweep.CONNECT_S", 1)
    with pytest.raises(MmtError, match="no scheduler answers"):
        list(run_on_dask(jobs_of(session), {str(session.path): session}, "tcp://127.0.0.1:9"))


def test_without_distributed_the_extra_is_named(session, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"install it with: .*\[dask\]"):
        list(run_on_dask(jobs_of(session), {}, "tcp://127.0.0.1:9"))


def test_the_command_goes_on_where_it_stopped(file, tmp_path, monkeypatch):
    here = []

    def run_here(jobs, sessions, workers):
        for job in jobs:
            here.append(job.settings["texture.order"])
            yield JobOutcome(job, evaluate_job(sessions[job.path], job))

    monkeypatch.setattr(sweep, "run_locally", run_here)
    command = ("sweep", str(file), "--out", str(tmp_path / "out"))
    run_lab(tmp_path, *command, "--set", "texture.order=6")
    content, _ = run_lab(tmp_path, *command, "--set", "texture.order=6,9")
    assert here == [6, 9]
    assert [row["settings"] for row in content["settings"]] == [
        {"texture.order": 6},
        {"texture.order": 9},
    ]
    for row, result in zip(content["settings"], content["results"], strict=True):
        final = result["evaluation"]["at_stop"] or result["evaluation"]["at_end"]
        assert row["sessions"] == 1
        assert row["power_error_db"] == pytest.approx(final["power_error_db"])


def test_a_failed_job_is_named_and_ends_the_command_with_1(file, tmp_path, monkeypatch):
    def fail(jobs, sessions, workers):
        yield from (JobOutcome(job, None, "it broke") for job in jobs)

    monkeypatch.setattr(sweep, "run_locally", fail)
    run_lab(tmp_path, "sweep", str(file), "--out", str(tmp_path / "out"), code=1)
    assert not (tmp_path / "out" / "results.jsonl").exists()
