"""Whoever writes waits for no reader, and what a reader takes is whole and in order."""

import os
import pty
import sys
import threading
from contextlib import closing, suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.output import streams
from mmt.core.output.streams import (
    QueuedStream,
    drain_output,
    finish_output,
    hurry_output,
    is_behind,
    queue_output,
)

LONGEST_S = 20.0
PIPE_BYTES = 1 << 16


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        with suppress(OSError):  # the test has closed it
            os.close(end)


def everything(reader):
    """What comes until the writer's end is closed."""
    return b"".join(iter(lambda: os.read(reader, PIPE_BYTES), b""))


@given(st.lists(st.text(max_size=100), max_size=50))
def test_what_is_read_is_what_was_written(texts):
    reader, writer = os.pipe()
    stream = QueuedStream(writer)
    for text in texts:
        assert stream.write(text) == len(text)
    stream.end()
    os.close(writer)
    assert everything(reader) == "".join(texts).encode("utf-8", "backslashreplace")
    os.close(reader)


def test_a_reader_that_takes_nothing_holds_up_nobody(pipe, monkeypatch):
    monkeypatch.setattr(streams, "MOST_WAITING", 100)
    reader, writer = pipe
    stream = QueuedStream(writer, told_of_loss=lambda count: f"lost {count}\n")
    lines = [f"{number:0{PIPE_BYTES // 50}}\n" for number in range(400)]
    for line in lines:
        stream.write(line)
    assert is_behind(stream)
    read = []
    reading = threading.Thread(target=lambda: read.append(everything(reader)))
    reading.start()
    stream.end()
    os.close(writer)
    reading.join(LONGEST_S)
    got = read[0].decode().splitlines(keepends=True)
    losses = [line for line in got if line.startswith("lost")]
    kept = [line for line in got if line not in losses]
    assert kept == sorted(kept)
    assert kept[-100:] == lines[-100:]
    assert sum(int(line.split()[1]) for line in losses) == len(lines) - len(kept) > 0


@pytest.mark.parametrize("while_it_waits", [False, True])
def test_a_reader_that_has_gone_is_no_problem(pipe, while_it_waits):
    reader, writer = pipe
    stream = QueuedStream(writer)
    if while_it_waits:
        stream.write("x" * 4 * PIPE_BYTES)
    os.close(reader)
    for _ in range(3):
        stream.write("more")
    stream.end()
    assert not is_behind(stream)
    assert stream.problem is None


def test_a_terminal_that_has_gone_is_no_problem():
    master, slave = pty.openpty()
    stream = QueuedStream(slave)
    assert stream.isatty()
    os.close(master)
    stream.write("nobody is there")
    stream.end()
    os.close(slave)
    assert stream.problem is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_said_once():
    problems = []
    with Path("/dev/full").open("w") as full:
        stream = QueuedStream(full.fileno(), on_problem=problems.append)
        for _ in range(5):
            stream.write("x")
        stream.end()
    assert [stream.problem] == problems
    assert "No space left" in str(problems[0])


def test_the_end_waits_a_moment_for_a_reader_that_takes_nothing(pipe, monkeypatch):
    monkeypatch.setattr(streams, "_PATIENCE_S", 0.05)
    reader, writer = pipe
    monkeypatch.setattr(QueuedStream, "patience_s", None)
    hurry_output()
    stream = QueuedStream(writer)
    stream.write("x" * 4 * PIPE_BYTES)
    ending = threading.Thread(target=stream.end)
    ending.start()
    ending.join(LONGEST_S)
    assert not ending.is_alive()
    assert is_behind(stream)
    os.close(reader)
    stream.end()  # before another test has a file of this number


def test_both_outputs_that_lead_to_one_file_keep_their_order(pipe, monkeypatch):
    reader, writer = pipe
    with closing(os.fdopen(writer, "w")) as out, os.fdopen(os.dup(writer), "w") as err:
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", err)
        queue_output()
        queue_output()  # harmless
        for number in range(100):
            (sys.stdout if number % 3 else sys.stderr).write(f"{number}\n")
        drain_output()
        finish_output()
        finish_output()  # harmless
        assert (sys.stdout, sys.stderr) == (out, err)
    assert [int(line) for line in everything(reader).split()] == list(range(100))
