"""A child process and its parent: messages, how each learns that the other has ended."""

import os
import pickle
import select
import signal
import subprocess
import time

import psutil
import pytest

from mmt.core.running.child_process import ChildProcess
from mmt.core.running.programs import import_path, python_command

LONGEST_S = 20.0
ECHO = """
from mmt.core.running.child_process import Parent
parent = Parent()
print("what a library prints")
for message in parent:
    parent.send(message)
print("the last words")
"""
SLEEPER = "import time; time.sleep(1000)"
ENDS_WITH_PARENT = """
import os, time
from mmt.core.running.programs import when_parent_ends
when_parent_ends(lambda: os._exit(7))
print(flush=True)
time.sleep(1000)
"""
FAMILY = f"""
import time
from mmt.core.running.child_process import ChildProcess
child = ChildProcess("-c", {ECHO!r})
child.ask(None)
print(child.pid, flush=True)
time.sleep(1000)
"""


@pytest.fixture
def child(monkeypatch):
    """Start a child that runs a program, and end it after the test."""
    monkeypatch.setenv("PYTHONPATH", import_path())
    made = []

    def start(program, **options):
        made.append(ChildProcess("-c", program, keeps_errors=True, **options))
        return made[-1]

    yield start
    for each in made:
        each.close()
        assert each.close() == ""
        assert each.returncode is not None


def test_messages_pass_and_printed_text_does_not_mix_with_them(child):
    process = child(ECHO)
    for message in (None, {"a": (1, 2.5)}, b"x" * 1_000_000):
        assert process.ask(message, LONGEST_S) == message
    process.stdin.write(pickle.dumps(b"as by a parent that is killed")[:-9])
    process.end(LONGEST_S)
    assert process.returncode == 0
    assert process.close() == "the last words"


def test_an_ended_child_is_an_end_of_the_messages_and_its_last_line_is_kept(child):
    process = child("import sys; sys.exit('first\\nwhy')")
    with pytest.raises(EOFError):
        process.ask(b"x" * 1_000_000)
    assert process.wait(LONGEST_S) == 1
    assert process.close() == "why"


ON_POSIX = pytest.mark.skipif(os.name != "posix", reason="pipes, sessions and signals of POSIX")


@ON_POSIX
def test_a_silent_child_is_given_up_and_a_stubborn_one_killed(child):
    process = child(SLEEPER)
    with pytest.raises(EOFError):
        process.ask(None, 0.05)
    process.end(0.05)
    assert process.returncode == -signal.SIGKILL


@ON_POSIX
def test_a_child_that_does_not_read_does_not_hold_its_end_up(child):
    process = child(SLEEPER)
    os.set_blocking(process.stdin.fileno(), False)
    with pytest.raises(BlockingIOError):
        process.send(b"x" * 1_000_000)
    os.set_blocking(process.stdin.fileno(), True)
    started_s = time.monotonic()
    process.close()
    assert time.monotonic() - started_s < LONGEST_S


def test_a_child_is_told_that_its_input_is_closed(child):
    process = child(ENDS_WITH_PARENT)
    process.stdout.readline()
    process.end(LONGEST_S)
    assert process.returncode == 7


@ON_POSIX
@pytest.mark.parametrize("own_session", [True, False])
def test_signals_of_the_terminal_do_not_end_it(child, own_session):
    process = child(ECHO, own_session=own_session)
    assert process.ask(1) == 1
    assert (os.getsid(process.pid) == process.pid) == own_session
    assert os.getpgid(process.pid) == process.pid
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        process.send_signal(number)
    assert process.ask(2) == 2


@ON_POSIX
def test_it_ends_however_its_parent_ends(child):
    with subprocess.Popen(python_command("-c", FAMILY), stdout=subprocess.PIPE) as parent:
        assert select.select([parent.stdout], [], [], LONGEST_S)[0]
        orphan = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    orphan.wait(LONGEST_S)
