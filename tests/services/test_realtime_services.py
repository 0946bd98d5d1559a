"""``--realtime``: the ticking threads alone, and a sentence where it is not permitted."""

import os
import sys
from pathlib import Path

import pytest
from service_processes import session, streamed_s

from mmt.cli import follower, leader, main
from mmt.cli.common import run_app
from mmt.cli.running.scene_services import DemoRun
from mmt.core.errors import MmtError
from mmt.core.running.process import require_real_time
from mmt_lab.experiments.bench import services

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux's scheduler is asked")


@pytest.fixture
def permitted():
    try:
        require_real_time()
    except MmtError:
        pytest.skip("this user may not schedule in real time")


def policies(service):
    """The policy of a service's first thread, and those of all others."""
    pid = service.process.pid
    threads = [int(task.name) for task in Path(f"/proc/{pid}/task").iterdir()]
    others = {os.sched_getscheduler(thread) for thread in threads if thread != pid}
    return os.sched_getscheduler(pid), others


@pytest.mark.usefixtures("permitted")
def test_the_ticking_threads_alone_are_real_time(tmp_path):
    arguments = ("--record", "session.mcap", "--duration", 30, "--realtime")
    with session(tmp_path, "demo", *arguments) as (first, ordinary):
        first.wait_for(lambda: streamed_s(first) > 0.3)
        real_time = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        ticking, others = policies(first)
        assert ticking == real_time
        assert others == {os.SCHED_OTHER}
        assert policies(ordinary)[0] != real_time
        first.process.terminate()
        assert first.end() == 0
        ordinary.end()


@pytest.mark.parametrize(
    "words", ["mmt-leader demo", "mmt-follower demo", "mmt demo", "mmt bench link"]
)
def test_where_it_is_not_permitted_nothing_starts(words, tmp_path, monkeypatch, capsys):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    name, *arguments = words.split()
    app = {"mmt": main.app, "mmt-leader": leader.app, "mmt-follower": follower.app}[name]
    monkeypatch.setattr(sys, "argv", [name, *arguments, "--realtime"])
    with pytest.raises(SystemExit) as exit_:
        run_app(app, name)
    assert exit_.value.code == 1
    assert "real-time scheduling is not permitted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("permitted")
def test_the_gain_is_a_median_over_turns(monkeypatch):
    turns = []

    async def run(duration_s, *, realtime):
        turns.append(realtime)
        figure = len(turns) * (1.0 if realtime else 10.0)
        ticks = {"period_p99_ms": figure, "late_share_1ms": 0.5}
        link = {"latency_p50_ms": None, "latency_p99_ms": figure}
        summary = {"ticks": ticks, "link": link}
        assert duration_s == 5.0
        return DemoRun(leader=summary, follower=summary)

    monkeypatch.setattr(services, "run_demo_services", run)
    result = services.compare(15.0)
    assert turns == [False, True] * 3
    assert result.figures["leader_period_p99_ms_ordinary"] == 30.0
    assert result.figures["leader_period_p99_ms_realtime"] == 4.0
    assert result.figures["follower_latency_p50_ms_realtime"] is None
    (records,) = result.records
    assert records.rows[0]["what"] == "leader's tick, p99 period (ms)"
