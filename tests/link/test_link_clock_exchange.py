"""Both sides' exchange over a real link, with clocks that differ, jump, and lie."""

import asyncio
import struct
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_samples import frames, linked, until

import mmt.link.clock_exchange
from mmt.core.frames import COMMAND_DTYPE
from mmt.link.clock_exchange import ClockRequester, ClockResponder
from mmt.link.incoming import BlockReader
from mmt.link.protocol import encode_event
from mmt.link.queue import SendQueue

QUESTION = struct.Struct("<IqIq")
ANSWER = struct.Struct("<Iqqq")


HZ = 100.0
"""Of the exchange."""


async def exchanged(link, count):
    """Wait for so many exchanges on both sides."""
    for clock in (link.server.clock, link.client.clock):
        goal = clock.statistics["exchanges"] + count
        await until(lambda clock=clock, goal=goal: clock.statistics["exchanges"] >= goal)


class ShiftedTime:
    """The module `time`, for one side only: another machine's clock."""

    def __init__(self, shift_ns):
        self._shift_ns = shift_ns

    def monotonic_ns(self):
        return time.monotonic_ns() + self._shift_ns()


@pytest.fixture
def follower_ahead(monkeypatch):
    """Let the follower's clock be ahead by what is set."""
    ahead = {"ns": 0}
    shifted = ShiftedTime(lambda: ahead["ns"])
    for method in ("handle_response", "_send_request"):
        original = getattr(ClockRequester, method)

        def with_shift(self, *arguments, original=original):
            mmt.link.clock_exchange.time = shifted
            try:
                return original(self, *arguments)
            finally:
                mmt.link.clock_exchange.time = time

        monkeypatch.setattr(ClockRequester, method, with_shift)
    return ahead


async def test_on_one_machine_the_offset_is_nothing_on_both_sides():
    async with linked(HZ) as link:
        await exchanged(link, 60)
        for statistics in (link.server.statistics.clock, link.client.statistics.clock):
            # on a machine that is busy nothing is quick, and the uncertainty says so
            assert abs(statistics["offset_ms"]) < max(0.2, statistics["uncertainty_ms"])
            assert statistics["uncertainty_ms"] < 50.0
            assert statistics["jumps"] == 0
        assert link.server.clock.is_shared
        assert link.server.clock.offset_ns == 0
        assert link.jumps == []


async def test_the_latency_is_known_between_different_clocks(follower_ahead):
    follower_ahead["ns"] = 3_600_000_000_000
    async with linked(HZ, other="elsewhere", delay_ms=20.0) as link:
        link.client.send_frames(frames(0, time_ns=1))
        await until(lambda: link.up.sequences)
        assert link.server.statistics.latency_p50_ms is None  # nothing was exchanged so far
        await exchanged(link, 20)
        for sequence in range(1, 41):
            there_ns = time.monotonic_ns() + follower_ahead["ns"]
            link.client.send_frames(frames(sequence, time_ns=there_ns))
            await asyncio.sleep(0.001)
        await until(lambda: len(link.up.sequences) == 41)
        latency_ms = link.server.statistics.latency_p50_ms
        clocks = link.server.statistics.clock, link.client.statistics.clock
    assert 19.0 < latency_ms < 1000.0
    assert clocks[0]["offset_ms"] == pytest.approx(3_600_000.0, abs=5.0)
    assert clocks[1]["offset_ms"] == pytest.approx(-3_600_000.0, abs=5.0)


@pytest.mark.parametrize("step_s", [10, -10])
async def test_a_jump_is_told_to_both_services(follower_ahead, step_s):
    async with linked(HZ, other="elsewhere", delay_ms=2.0) as link:
        await exchanged(link, 30)
        assert link.jumps == []
        follower_ahead["ns"] += step_s * 1_000_000_000
        await until(lambda: len(link.jumps) == 2)
        await exchanged(link, 20)
        for side, jump in link.jumps:
            sign = 1 if side == "leader" else -1
            assert jump.step_ns / 1e9 == pytest.approx(sign * step_s, abs=0.1)
        assert link.server.statistics.clock["jumps"] == link.client.statistics.clock["jumps"] == 1
        assert link.server.clock.offset_ns / 1e9 == pytest.approx(step_s, abs=0.1)


async def test_repeated_late_lost_and_malformed_stamps_do_no_harm():
    bad = {"loss": 0.3, "duplicate": 0.5, "delay_ms": 5, "jitter_ms": 5, "reorder": True}
    async with linked(HZ, other="first", **bad) as link:
        for side in (link.client, link.server):
            for _ in range(20):  # of which some arrive
                side.endpoint.outbox.put(0, encode_event("clock", b"short"))
        await exchanged(link, 30)
        for statistics in (link.server.statistics, link.client.statistics):
            assert set(statistics.rejected) == {"malformed clock"}
            assert abs(statistics.clock["offset_ms"]) < 5.0
        # what was learnt of a clock holds after a break, and not for another
        link.server.clock.start_connection("first")
        assert link.server.clock.offset_ns is not None
        link.server.clock.start_connection("second")
        assert link.server.clock.offset_ns is None


async def test_without_the_exchange_nothing_of_it_is_on_the_wire():
    async with linked() as link:
        await asyncio.sleep(0.1)
        assert link.client.statistics.messages_sent == link.server.statistics.messages_sent == 0
        assert link.client.statistics.clock["exchanges"] == 0
        assert link.client.statistics.clock["offset_ms"] is None


def answerer():
    reader = BlockReader(COMMAND_DTYPE, "frames")
    return ClockResponder(reader, SendQueue(1000), lambda _: None), reader


STAMPS = st.integers(-(2**63), 2**63 - 1)
NUMBERS = st.integers(0, 3)
ODD = st.one_of(st.none(), st.integers(), st.text(), st.binary(max_size=40), st.lists(st.none()))


@settings(max_examples=60)
@given(
    st.lists(ODD | st.builds(QUESTION.pack, NUMBERS, STAMPS, NUMBERS, STAMPS), max_size=40),
    st.lists(ODD | st.builds(ANSWER.pack, NUMBERS, STAMPS, STAMPS, STAMPS), max_size=40),
)
def test_no_stamps_kill_the_leader_or_the_follower(questions, answers):
    asked, reader = answerer()
    for question in questions:
        asked.handle_request(question)
    asked.handle_request()
    asked.handle_request(1, 2)
    assert sum(reader.rejected.values()) >= 2
    assert asked.statistics["exchanges"] <= len(questions)
    reader = BlockReader(COMMAND_DTYPE, "commands")
    clock = ClockRequester(reader, SendQueue(1000), lambda _: None)
    clock._pending.update(dict.fromkeys(range(4), (0,)))  # asked without a loop
    for answer in answers:
        clock.handle_response(answer)
    clock.handle_response()
    assert sum(reader.rejected.values()) >= 1
    assert clock.statistics["exchanges"] <= 4


async def test_an_answer_to_no_question_is_passed_over():
    clock = ClockRequester(BlockReader(COMMAND_DTYPE, "commands"), SendQueue(10), lambda _: None)
    clock.start(1.0)
    for number in (1, 2):  # the first is asked, at another time
        clock.handle_response(ANSWER.pack(number, 999, 5, 6))
    clock.stop()
    assert clock.statistics["exchanges"] == 0


def test_too_many_questions_are_rejected():
    clock, reader = answerer()
    for number in range(2000):
        clock.handle_request(QUESTION.pack(number, 1, 0, 0))
    assert reader.rejected["too many clock"] >= 2000 - 2 * 400 - 1
    assert len(clock._pending) <= 512  # memory
