"""The pipes between a driver and the process that talks to its device."""

import itertools
import os
import pickle
import sys
import textwrap
import time
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.driver_process import DriverPipes, DriverProcess

PATIENCE_S = 20.0


class Listening(DriverProcess):
    """Also keeps the messages of other kinds."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.heard = []

    def keep(self, kind, body):
        super().keep(kind, body)
        if len(kind) == 1:
            self.heard.append((kind, body))


Run = Callable[[str], Listening]


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
            "import time\n"
            "from mmt.core.errors import MmtError\n"
            "from mmt.devices.driver_process import COUNT, run_process\n"
            f"def run(arguments, pipes):\n{body}\n"
            "run_process(run, 'the device')\n",
            encoding="utf-8",
        )
        why = "it has ended without a word"
        silent = ("nothing has come", "wait", 1000.0)
        made.append(Listening("a_device", {"first": 2.5}, why, silent, counts))
        made[-1].start()
        return made[-1]

    yield start
    for each in made:
        each.end("the test is over")
        each.end("likewise")
        each.receive()


def taken(process, number):
    """Return the next messages, fewer where it has ended."""
    deadline = time.monotonic() + PATIENCE_S
    while len(process.heard) < number and process.ended is None:
        assert time.monotonic() < deadline, "nothing more has come"
        process.receive()
        time.sleep(0.001)
    messages, process.heard = process.heard, []
    return messages


def test_commands_messages_and_counts_pass_in_their_order(run, counts):
    process = run(
        """
        print("what a library prints")
        pipes.send("F", str(arguments["first"]))
        while (commands := pipes.receive()) is not None:
            for kind, number in commands:
                pipes.send(COUNT, "commands")
                pipes.send(kind, str(number))
            time.sleep(0.001)
        """
    )
    assert taken(process, 1) == [("F", "2.5")]
    for number in range(200):
        process.send("A", float(number))
    assert taken(process, 200) == [("A", str(float(number))) for number in range(200)]
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
    process.send("A", 0.0)  # to nobody
    process.end("closed")
    assert process.ended == reason


def test_silence_is_seen_by_reads_that_find_nothing_not_by_time_alone(run):
    process = run("pipes.send('F', 1)\nwhile pipes.receive() is not None: time.sleep(0.001)")
    taken(process, 1)
    time.sleep(0.01)
    assert process.silent_ns == 0
    for _ in range(20):
        process.receive()
    assert process.silent_ns > 10_000_000


def test_a_message_for_which_there_is_no_room_is_known_not_to_be_sent():
    (read, write), (unread, unused) = os.pipe(), os.pipe()
    pipes, driver = DriverPipes(unread, write), DriverPipes(read, unused)
    sent = 0
    while pipes.send("state", bytes(4000)):
        sent += 1
    assert not pipes.send("lost", "\N{GREEK SMALL LETTER ALPHA}" * 4000)
    assert driver.receive() == [("state", bytes(4000))] * sent
    assert pipes.send("lost", "\N{GREEK SMALL LETTER ALPHA}" * 4000)
    assert driver.receive() == [("lost", "\N{GREEK SMALL LETTER ALPHA}" * 2000)]
    os.close(read)
    os.close(unused)
    assert pipes.receive() is None
    with pytest.raises(BrokenPipeError):
        pipes.send("state", 1)
    os.close(unread)
    os.close(write)


@given(st.lists(st.integers(1, 60), min_size=1, max_size=20))
def test_messages_that_come_in_pieces_are_received_whole(pieces):
    read, write = os.pipe()
    driver = DriverPipes(read, write)
    sent = [("state", (1.5, None)), ("lost", "\N{GREEK SMALL LETTER ALPHA}. K"), ("count", "x")]
    stream = b"".join(map(pickle.dumps, sent))
    ends = [*itertools.takewhile(lambda end: end < len(stream), itertools.accumulate(pieces))]
    received = []
    for begin, end in itertools.pairwise([0, *ends, len(stream)]):
        os.write(write, stream[begin:end])
        received += driver.receive()
    assert received == sent
    os.close(read)
    os.close(write)
