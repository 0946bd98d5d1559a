"""A reader of what a service prints that stops, or goes, holds up no robot.

A terminal that is closed ends the session in order.
"""

import fcntl
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import pytest
from service_processes import LONGEST_S, Service, scene

from mmt.session.files import read_session

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="sets the length of a pipe")

STALLED_S = 4.0
PATIENT = {"MMT_LINK__SILENCE_MS": "1000"}
"""A follower that holds for a leader that has stalled, and not for a machine that is busy."""

CONTROLLED = (
    "import fcntl, os, sys, termios\n"
    "fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "os.execv(sys.argv[1], sys.argv[1:])\n"
)
"""Makes the terminal that is standard input the one whose Ctrl-C and end are told."""


@contextmanager
def leader_heard_by(kind, cwd):
    """A leader, and the end of a pipe or a terminal where what it prints comes out."""
    if kind == "pipe":
        ours, theirs = os.pipe()
        fcntl.fcntl(theirs, fcntl.F_SETPIPE_SZ, 4096)
    else:
        ours, theirs = pty.openpty()
    arguments = ["leader", scene("demo"), "--port", "0", "--json", "leader.json", "--verbose"]
    arguments += ["--record", "session.mcap", "--duration", "60"]
    command = [sys.executable, "-m", "mmt.cli.entry", *arguments]
    if kind == "pipe":
        command += ["--json-lines"]
    else:
        command = [sys.executable, "-c", CONTROLLED, *command]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL if kind == "pipe" else theirs,
        stdout=theirs,
        stderr=theirs,
        cwd=cwd,
        start_new_session=True,
    )
    os.close(theirs)
    try:
        yield process, ours
    finally:
        process.kill()
        process.wait(LONGEST_S)
        with suppress(OSError):  # the test has closed it
            os.close(ours)


def port_from(reader):
    """Read until a leader says where it listens."""
    text = ""
    while not (found := re.search(r'"port": (\d+)|ready after [^\n]*:(\d+)\r?\n', text)):
        text += os.read(reader, 100).decode(errors="replace")
    return int(found[1] or found[2])


@pytest.mark.parametrize(
    ("kind", "number"), [("pipe", signal.SIGINT), ("terminal", signal.SIGTERM)]
)
def test_a_reader_that_stops_holds_up_neither_the_robot_nor_the_end(kind, number, tmp_path):
    with leader_heard_by(kind, tmp_path) as (leader, reader):
        url = f"http://127.0.0.1:{port_from(reader)}"
        if kind == "terminal":
            os.write(reader, b"\x13")  # Ctrl-S
        arguments = (scene("demo"), "--json-lines", "--leader", url)
        with Service("follower", *arguments, cwd=tmp_path, **PATIENT) as follower:
            follower.wait_for(lambda: "connected to the leader" in follower.events())
            time.sleep(STALLED_S)
            assert leader.poll() is None
            leader.send_signal(number)
            assert leader.wait(LONGEST_S) == 0
            assert follower.end() == 0, follower.stderr
    assert follower.summary()["commands"]["silences"] == 0
    assert_stopped_in_order(tmp_path, follower, at_least=1000)


def assert_stopped_in_order(directory, follower, at_least):
    """Check that the leader's summary, its recording and the follower's last words are there."""
    assert follower.summary()["outcome"] == "leader stopped (stopped)"
    summary = json.loads((directory / "leader.json").read_text())
    assert summary["outcome"] == "stopped"
    recording = read_session(directory / "session.mcap")
    assert recording.complete
    assert len(recording.frames) == summary["link"]["frames"] >= at_least


@pytest.mark.parametrize("ends", ["closed", "interrupted"])
def test_a_terminal_that_is_closed_ends_the_session_as_its_ctrl_c_does(ends, tmp_path):
    with leader_heard_by("terminal", tmp_path) as (leader, terminal):
        url = f"http://127.0.0.1:{port_from(terminal)}"
        arguments = (scene("demo"), "--json-lines", "--leader", url)
        with Service("follower", *arguments, cwd=tmp_path) as follower:
            follower.wait_for(lambda: "connected to the leader" in follower.events())
            time.sleep(1.0)
            if ends == "closed":
                os.close(terminal)
                leader.send_signal(signal.SIGHUP)  # a shell tells its jobs as well
            else:
                os.write(terminal, b"\x03")
            assert leader.wait(LONGEST_S) == 0
            assert follower.end() == 0, follower.stderr
    assert_stopped_in_order(tmp_path, follower, at_least=1)


def test_a_reader_that_goes_ends_no_session(tmp_path):
    arguments = ("leader", scene("demo"), "--json-lines", "--port", 0, "--duration", 2)
    with Service(
        *(*arguments, "--json", "leader.json", "--log", "log"),
        cwd=tmp_path,
        within=("sh", "-c", '"$@" | head -3; echo \'{"kind": "gone"}\'', "sh"),
    ) as leader:
        url = f"http://127.0.0.1:{leader.port()}"
        with Service("follower", scene("demo"), "--leader", url, cwd=tmp_path) as follower:
            assert follower.end() == 0, follower.stderr
        assert leader.end() == 0
    assert leader.stderr == ""
    assert len(leader.stdout.splitlines()) == 4
    assert json.loads((tmp_path / "leader.json").read_text())["outcome"] == "completed"


def test_a_demo_whose_terminal_is_stopped_ends_with_its_report(tmp_path):
    ours, theirs = pty.openpty()
    demo = subprocess.Popen(
        [sys.executable, "-m", "mmt.cli.entry", "main", "demo", scene("stream-only")],
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
        cwd=tmp_path,
        start_new_session=True,
    )
    os.close(theirs)
    try:
        text = b""
        while not re.search(rb"[1-9]\.\d s.{0,20}streamed", text):
            text += os.read(ours, 1000)
        os.write(ours, b"\x13")
        time.sleep(STALLED_S)
        demo.send_signal(signal.SIGTERM)
        assert demo.wait(LONGEST_S) == 0
    finally:
        demo.kill()
        demo.wait(LONGEST_S)
        os.close(ours)
    assert len(read_session(tmp_path / "mmt-demo" / "session.mcap").frames) > 4000
    assert (tmp_path / "mmt-demo" / "report.html").exists()
