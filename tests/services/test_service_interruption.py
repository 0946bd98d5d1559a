"""Services that are interrupted, terminated, killed, or find nobody."""

import os
import signal
import time

import numpy as np
import psutil
import pytest
from service_processes import LONGEST_S, Service, follower_of, scene, session, streamed_s

from mmt.core.errors import InputError
from mmt.session.files import read_session
from mmt.session.recover import recover

SOON_S = 10.0
"""Loose bound of what takes a fraction of a second."""

ENDING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
RECORDED = {"MMT_RECORDING__FILE": "session.mcap"}


def assert_recorded(directory, leader, at_least):
    """Check that the recording is whole and holds every frame that the leader counted."""
    recording = read_session(directory / "session.mcap")
    assert recording.complete
    summary = leader.summary()
    assert len(recording.frames) == summary["link"]["frames"] == summary["recording"]["frames"]
    assert len(recording.frames) >= at_least
    return recording


def test_interrupting_both_ends_them_at_once_with_everything_kept(tmp_path):
    with session(tmp_path, "demo", **RECORDED) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 1.2)
        interrupted_s = leader.signal(signal.SIGINT)
        follower.signal(signal.SIGINT)
        assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
        assert time.monotonic() - interrupted_s < SOON_S
    assert leader.summary()["outcome"] == "stopped"
    assert follower.summary()["outcome"] in {"stopped", "leader stopped (stopped)"}
    assert leader.summary()["link"]["frames"] == follower.summary()["link"]["frames"]
    assert_recorded(tmp_path, leader, at_least=1200)
    assert (leader.stderr, follower.stderr) == ("", "")


@pytest.mark.parametrize(
    ("first", "number"), [("leader", signal.SIGTERM), ("follower", ENDING[-1])]
)
def test_terminating_one_ends_the_other(tmp_path, first, number):
    with session(tmp_path, "stream-only", **RECORDED) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 0.3)
        terminated_s = (leader if first == "leader" else follower).signal(number)
        assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
        assert time.monotonic() - terminated_s < SOON_S
    outcomes = (leader.summary()["outcome"], follower.summary()["outcome"])
    if first == "leader":
        assert outcomes == ("stopped", "leader stopped (stopped)")
    else:
        assert outcomes == ("source ended", "stopped")
        assert "follower ended: stopped" in leader.events()
    assert_recorded(tmp_path, leader, at_least=300)


NOBODY = "http://127.0.0.1:1"


@pytest.mark.parametrize(
    ("name", "address", "waits"),
    [
        ("leader", ("--port", 0), lambda one: one.lines("ready")),
        ("follower", ("--leader", NOBODY), lambda one: any(NOBODY in e for e in one.events())),
    ],
)
def test_one_that_waits_for_the_other_can_be_interrupted(tmp_path, name, address, waits):
    arguments = (scene("stream-only"), "--json-lines", *address)
    with Service(name, *arguments, cwd=tmp_path, **RECORDED) as service:
        service.wait_for(lambda: waits(service))
        interrupted_s = service.signal(signal.SIGINT)
        assert service.end() == 0, service.stderr
        assert time.monotonic() - interrupted_s < SOON_S
    assert service.summary()["outcome"] == "stopped"
    assert service.stderr == ""
    if name == "leader":
        assert service.summary()["session"]["duration_s"] == 0
        assert len(read_session(tmp_path / "session.mcap").frames) == 0


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="nothing stops a process here")
def test_both_go_on_after_eight_seconds_without_the_leader_and_it_holds_up_no_interruption(
    tmp_path,
):
    with session(tmp_path, "stream-only", "--duration", 60) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 0.2)
        leader.signal(signal.SIGSTOP)
        time.sleep(8.0)
        leader.signal(signal.SIGCONT)
        leader.wait_for(lambda: streamed_s(leader) > 9.0, 5.0)
        assert (leader.stderr, follower.stderr) == ("", "")
        leader.signal(signal.SIGSTOP)
        interrupted_s = follower.signal(signal.SIGINT)
        assert follower.end() == 0, follower.stderr
        assert time.monotonic() - interrupted_s < SOON_S
        leader.signal(signal.SIGCONT)
        leader.end()
    assert follower.summary()["outcome"] == "stopped"
    assert "the leader did not acknowledge the end of the session" in follower.stderr


def test_a_killed_follower_may_be_started_anew(tmp_path):
    patience = {"MMT_LINK__PATIENCE_S": "60"}
    with session(tmp_path, "stream-only", **RECORDED, **patience) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 0.5)
        follower.signal(signal.SIGKILL)
        leader.wait_for(lambda: any("follower lost" in event for event in leader.events()))
        with follower_of(leader, "stream-only", tmp_path, **RECORDED, **patience) as second:
            leader.wait_for(lambda: any("started anew" in event for event in leader.events()))
            leader.wait_for(lambda: leader.lines("status")[-1]["frames"] > 900)
            second.signal(signal.SIGINT)
            assert (leader.end(), second.end()) == (0, 0), leader.stderr + second.stderr
    assert leader.summary()["outcome"] == "source ended"
    assert leader.stderr == ""
    (waiting,) = [event for event in leader.events() if "follower lost" in event]
    assert waiting.endswith("waiting 60 s for its return")
    frames = assert_recorded(tmp_path, leader, at_least=900).frames
    steps = np.diff(frames["sequence"].astype(np.int64))
    assert (steps >= 1).all()
    assert (np.diff(frames["time_ns"]) > 0).all()
    (missing,) = steps[steps > 1] - 1
    assert f"the follower started anew, {missing} frames are missing before it" in leader.events()
    assert missing > 100


def test_a_killed_leader_is_given_up_and_its_recording_recovered(tmp_path):
    variables = {**RECORDED, "MMT_LINK__PATIENCE_S": "0.5"}
    with session(tmp_path, "stream-only", **variables) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 1.0)
        received = leader.lines("status")[-1]["frames"]
        leader.signal(signal.SIGKILL)
        assert follower.end() == 1
    assert follower.summary()["outcome"] == "leader lost"
    assert follower.stderr == "error: leader lost\n"
    assert any("trying again for 0.5 s" in event for event in follower.events())
    with pytest.raises(InputError, match="mmt session recover"):
        read_session(tmp_path / "session.mcap")
    saved = recover(tmp_path / "session.mcap", tmp_path / "saved.mcap")
    assert saved.frames >= received - 1000
    frames = read_session(tmp_path / "saved.mcap").frames
    np.testing.assert_array_equal(frames["sequence"], np.arange(saved.frames))


@pytest.mark.parametrize("number", [*ENDING, signal.SIGKILL])
def test_a_demo_that_is_ended_leaves_a_whole_recording_and_no_service_and_reports_if_it_can(
    tmp_path, number
):
    with Service("main", "demo", scene("stream-only"), "--verbose", cwd=tmp_path) as demo:
        demo.wait_for(lambda: "leader: follower connected" in demo.stderr)
        services = psutil.Process(demo.process.pid).children()
        assert len(services) == 2
        time.sleep(0.5)
        demo.signal(number)
        _, left = psutil.wait_procs(services, timeout=LONGEST_S)
        assert not left
        code = demo.end()
    killed = number == signal.SIGKILL
    assert code == (-number if killed else 0), demo.stderr
    assert read_session(tmp_path / "mmt-demo" / "session.mcap").complete
    assert (tmp_path / "mmt-demo" / "report.html").exists() != killed


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminal is closed here")
def test_a_hangup_that_is_ignored_as_under_nohup_stays_ignored(tmp_path):
    with Service(
        *("leader", scene("stream-only"), "--json-lines", "--port", 0),
        cwd=tmp_path,
        within=("sh", "-c", "trap '' HUP; exec \"$@\"", "sh"),
    ) as leader:
        leader.port()
        statuses = len(leader.lines("status"))
        leader.signal(signal.SIGHUP)
        leader.wait_for(lambda: len(leader.lines("status")) > statuses + 3)
        leader.signal(signal.SIGTERM)
        assert leader.end() == 0, leader.stderr
    assert leader.summary()["outcome"] == "stopped"


WHILE_IT_IS_LOADED = """
import os, signal, sys
class Interrupt:
    def find_spec(self, name, path, target=None):
        if name == 'mmt.scene':
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
"""
WHILE_IT_CLOSES = "import atexit, os\natexit.register(os.kill, os.getpid(), {})\n"


@pytest.mark.parametrize(
    ("module", "program", "code", "said"),
    [
        ("leader", WHILE_IT_IS_LOADED, 130, "stopped\n"),
        ("follower", WHILE_IT_IS_LOADED, 130, "stopped\n"),
        ("main", WHILE_IT_IS_LOADED, 130, "stopped\n"),
        *(("main", WHILE_IT_CLOSES.format(int(number)), 0, "") for number in ENDING),
    ],
)
def test_a_quick_person_sees_no_traceback_and_a_late_one_the_same_exit_code(
    tmp_path, module, program, code, said
):
    """An interruption while the program is loaded, and one while its interpreter closes."""
    (tmp_path / "sitecustomize.py").write_text(program)
    path = f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"
    with Service(module, "--help", cwd=tmp_path, PYTHONPATH=path) as service:
        assert service.end() == code
    assert service.stderr == said
    assert (service.stdout == "") == (code != 0)


def test_a_demo_that_is_interrupted_before_it_has_begun_has_nothing_to_report(tmp_path):
    with Service("main", "demo", scene("stream-only"), cwd=tmp_path) as demo:
        while not psutil.Process(demo.process.pid).children():
            time.sleep(0.01)
        demo.signal(signal.SIGINT)
        assert demo.end() == 130
    assert demo.stderr == "stopped\n"


def test_a_second_leader_does_not_touch_the_recording_of_the_first(tmp_path):
    with session(tmp_path, "stream-only", **RECORDED) as (leader, follower):
        leader.wait_for(lambda: streamed_s(leader) > 0.3)
        with Service(
            "leader", scene("stream-only"), *("--port", 0, "--force"), cwd=tmp_path, **RECORDED
        ) as second:
            assert second.end() == 2
        assert "session.mcap: another leader records into it" in second.stderr
        leader.signal(signal.SIGINT)
        assert (leader.end(), follower.end()) == (0, 0)
    assert_recorded(tmp_path, leader, at_least=300)
