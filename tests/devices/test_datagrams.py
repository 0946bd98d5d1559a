"""When a packet came, also where nobody looked."""

import select
import socket
import sys
import time

import pytest

from mmt.devices.ati.net_ft import StampedSocket


@pytest.fixture
def pair():
    """A socket that listens without blocking, and one that sends to it."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending,
    ):
        listening.bind(("127.0.0.1", 0))
        listening.setblocking(False)
        sending.connect(listening.getsockname())
        yield listening, sending


def receive(stamped, listening, content):
    assert select.select([listening], [], [], 20.0)[0]
    buffer = bytearray(64)
    assert stamped.receiver()(buffer) == len(content)
    assert buffer.startswith(content)


@pytest.mark.skipif(sys.platform != "linux", reason="this system stamps no packets")
def test_a_packet_bears_the_time_at_which_it_came_and_not_that_of_the_look(pair):
    listening, sending = pair
    stamped = StampedSocket(listening)
    deadline = time.monotonic() + 20.0
    while True:  # the kernel begins to stamp some time after it was asked to
        before_ns = time.monotonic_ns()
        sending.send(b"one")
        assert select.select([listening], [], [], 20.0)[0]
        there_ns = time.monotonic_ns()
        time.sleep(0.02)
        receive(stamped, listening, b"one")
        arrival_ns = stamped.arrival_ns(before_ns)
        assert before_ns <= arrival_ns
        if arrival_ns <= there_ns + 1_000_000:  # the wall clock may be slewed
            break
        assert time.monotonic() < deadline


def test_a_stamp_from_before_the_last_look_is_not_believed(pair):
    listening, sending = pair
    stamped = StampedSocket(listening)
    sending.send(b"one")
    receive(stamped, listening, b"one")
    later_ns = time.monotonic_ns() + 10**10  # as if the wall clock had been set meanwhile
    before_ns = time.monotonic_ns()
    assert before_ns <= stamped.arrival_ns(later_ns) <= time.monotonic_ns()


def test_without_stamps_the_time_is_that_of_the_look(pair, monkeypatch):
    listening, sending = pair
    monkeypatch.setattr("sys.platform", "other")
    stamped = StampedSocket(listening)
    with pytest.raises(BlockingIOError):  # where nothing waits, it does not block
        stamped.receiver()(bytearray(8))
    sending.send(b"one")
    receive(stamped, listening, b"one")
    before_ns = time.monotonic_ns()
    assert before_ns <= stamped.arrival_ns(0) <= time.monotonic_ns()
