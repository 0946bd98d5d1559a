"""The pipes between a driver and the process that talks to its device."""

import os
import struct
import sys
import textwrap
import time
from collections import Counter
from collections.abc import Callable

import pytest

from mmt.devices.driver_process import DriverPipes, DriverProcess

PATIENCE_S = 20.0
NUMBER = struct.Struct("<cd")

Run = Callable[[str], DriverProcess]


@pytest.fixture
def counts():
    """What a process survives is added to what others have survived before it."""
    return Counter(already=1)


@pytest.fixture
def run(tmp_path, monkeypatch, counts):
    """Start a process that runs these lines with `arguments` and `pipes`."""
    made = []
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))

    def start(lines):
        body = textwrap.indent(textwrap.dedent(lines), "    ")
        (tmp_path / "a_device.py").write_text(
            "import struct, time\n"
            "from mmt.core.errors import MmtError\n"
            "from mmt.devices.driver_process import COUNT, run_process\n"
            "NUMBER = struct.Struct('<cd')\n"
            f"def run(arguments, pipes):\n{body}\n"
            "run_process(run, 'the device')\n",
            encoding="utf-8",
        )
        why = "it has ended without a word"
        made.append(DriverProcess("a_device", {"first": 2.5}, why, counts, bytes))
        made[-1].start()
        return made[-1]

    yield start
    for each in made:
        each.end("the test is over")
        each.end("likewise")
        assert each.receive() == []


def taken(process, number):
    """Return the next messages, fewer where it has ended."""
    messages = []
    deadline = time.monotonic() + PATIENCE_S
    while len(messages) < number and process.ended is None:
        assert time.monotonic() < deadline, "nothing more has come"
        messages += process.receive()
        time.sleep(0.001)
    return messages


def test_commands_messages_and_counts_pass_in_their_order(run, counts):
    process = run(
        """
        print("what a library prints")
        pipes.send(b"F", str(arguments["first"]))
        while (commands := pipes.receive(NUMBER)) is not None:
            for kind, number in commands:
                pipes.send(COUNT, "commands")
                pipes.send(kind, str(number))
            time.sleep(0.001)
        """
    )
    assert taken(process, 1) == [(b"F", b"2.5")]
    for number in range(200):
        process.send(NUMBER.pack(b"A", number))
    assert taken(process, 200) == [(b"A", str(float(number)).encode()) for number in range(200)]
    assert counts == {"already": 1, "commands": 200}
    assert process.ended is None


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ("raise MmtError('it is not there: plug it in')", "it is not there: plug it in"),
        ("{}['a']", "the process of the device failed: 'a'"),
        ("raise MmtError('x' * 100_000)", "x" * 4000),
        ("pass", "it has ended without a word"),
    ],
)
def test_why_it_has_ended_is_told(run, lines, reason):
    process = run(lines)
    assert taken(process, 1) == []
    assert process.ended == reason
    process.send(NUMBER.pack(b"A", 0.0))  # to nobody
    process.end("closed")
    assert process.ended == reason


def test_silence_is_seen_by_reads_that_find_nothing_not_by_time_alone(run):
    process = run("pipes.send(b'F')\nwhile pipes.receive(NUMBER) is not None: time.sleep(0.001)")
    taken(process, 1)
    time.sleep(0.01)
    assert process.silent_ns == 0
    for _ in range(20):
        process.receive()
    assert process.silent_ns > 10_000_000


@pytest.fixture
def pipe():
    """Two ends of a pipe, which the test may close."""
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    os.set_blocking(theirs, False)
    with os.fdopen(ours, "rb", 0) as reader, os.fdopen(theirs, "wb", 0) as writer:
        yield reader, writer


def test_a_message_for_which_there_is_no_room_is_known_not_to_be_sent(pipe):
    pipes = DriverPipes(-1, pipe[1].fileno())
    while pipes.send(b"S", bytes(4000)):
        pass
    assert not pipes.send(b"S", bytes(4000))
    os.read(pipe[0].fileno(), 1 << 16)
    assert pipes.send(b"L", "it is gone")


def test_commands_come_out_whole_however_they_were_cut(pipe):
    pipes, found = DriverPipes(pipe[0].fileno(), -1), []
    for byte in NUMBER.pack(b"A", 1.0) + NUMBER.pack(b"B", -2.0):
        pipe[1].write(bytes((byte,)))
        found += pipes.receive(NUMBER) or []
    assert found == [(b"A", 1.0), (b"B", -2.0)]
    assert pipes.receive(NUMBER) == []
    pipe[1].close()
    assert pipes.receive(NUMBER) is None
