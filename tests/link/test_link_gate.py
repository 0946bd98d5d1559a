"""What one peer may send is bounded, in rate, in size and in connections."""

import asyncio
import contextlib
import time

import aiohttp
import pytest
import socketio
from hypothesis import given
from hypothesis import strategies as st
from link_samples import (
    FollowerNotes,
    LeaderNotes,
    follower,
    frames,
    hello,
    leader,
    until,
)

import mmt.link.rate_limit
import mmt.link.server_sockets
from mmt.core.errors import MmtError
from mmt.link.protocol import encode_event
from mmt.link.rate_limit import RateLimit

SECOND = 1_000_000_000


class Notes:
    def __init__(self, rate_hz: float = 1000) -> None:
        self.excess = 0
        self.shut: list[MmtError] = []
        self.gate = RateLimit(rate_hz, self.count, self.shut.append)

    def count(self, reason: str) -> None:
        assert reason == "too fast"
        self.excess += 1


@pytest.mark.parametrize(
    ("messages_hz", "size"),
    [(1000, 100), (5000, 80), (9000, 60), (1000, 5000), (100, 100_000)],
)
def test_what_a_session_sends_passes_for_ever(messages_hz: int, size: int) -> None:
    notes = Notes()
    for number in range(20 * messages_hz):
        assert notes.gate.passes(size, number * SECOND // messages_hz)
    assert notes.excess == 0


def test_what_was_held_back_for_ten_seconds_passes_in_a_clump() -> None:
    notes = Notes()
    for _ in range(10_000):
        assert notes.gate.passes(100, 50 * SECOND)


@given(
    st.lists(st.tuples(st.integers(0, SECOND // 10), st.integers(0, 131_072)), max_size=300),
)
def test_over_any_time_no_more_than_the_bound_passes(
    messages: list[tuple[int, int]],
) -> None:
    notes, now_ns, count, size_sum = Notes(rate_hz=1.0), SECOND, 0, 0
    for silence_ns, size in messages:
        now_ns += silence_ns
        if notes.gate.passes(size, now_ns):
            count += 1
            size_sum += size
    elapsed_s = (now_ns - SECOND) / 1e9
    assert count <= 10 * (elapsed_s + 10)
    assert size_sum <= 20_000 * (elapsed_s + 10) * 1.001
    assert count + notes.excess == len(messages)


def test_a_peer_that_goes_on_is_cut_off_and_one_that_stops_is_not() -> None:
    going_on, stopping = Notes(), Notes()
    for number in range(150_000):
        going_on.gate.passes(100, number * SECOND // 50_000)
    assert not going_on.gate.shut  # over its bound for less than two seconds
    for number in range(150_000, 250_000):
        going_on.gate.passes(100, number * SECOND // 50_000)
    assert going_on.gate.shut
    (fault,) = going_on.shut
    assert str(fault) == "it sent more than 10000 messages, or 20 MB, a second for 2 s"
    for number in range(150_000):
        stopping.gate.passes(100, number * SECOND // 50_000)
    for number in range(60_000):
        stopping.gate.passes(100, 3 * SECOND + number * SECOND // 1000)
    assert stopping.shut == []


@pytest.mark.parametrize("jump_s", [0.5, 30, 3600])
def test_a_clock_that_jumps_back_cuts_nobody_off(jump_s: float) -> None:
    notes, jump_ns = Notes(), round(jump_s * SECOND)
    for number in range(40_000):
        now_ns = 5000 * SECOND + number * SECOND // 1000 - jump_ns * (number > 10_000)
        assert notes.gate.passes(100, now_ns)
    assert notes.shut == []


def test_a_clock_that_jumps_back_lets_no_more_than_the_bound_pass() -> None:
    notes = Notes()
    passed = sum(
        notes.gate.passes(0, (90 - jump) * SECOND) for jump in range(60) for _ in range(5000)
    )
    assert passed == 100_000


def test_a_flood_is_cut_off_though_the_clock_jumps_back() -> None:
    notes = Notes()
    for start_s in (90.0, 60.0):
        for number in range(130_000):
            notes.gate.passes(0, round((start_s + number / 50_000) * SECOND))
    assert len(notes.shut) == 1


def test_an_excess_that_is_long_over_is_forgiven() -> None:
    notes = Notes()

    def clump(count: int, now_s: float) -> None:
        for _ in range(count):
            notes.gate.passes(0, round(now_s * SECOND))

    clump(100_001, 10.0)  # one too many
    assert notes.excess == 1
    clump(1, 15.1)  # the bucket is more than half empty again
    clump(60_000, 15.2)
    assert notes.excess > 1
    assert notes.shut == []
    clump(30_000, 17.3)  # now it goes on for longer than the grace
    assert len(notes.shut) == 1


def test_an_excess_that_is_hardly_over_is_not_forgiven() -> None:
    notes = Notes()
    for now_s, count in ((10.0, 100_001), (14.9, 1), (15.0, 60_000)):
        for _ in range(count):
            notes.gate.passes(0, round(now_s * SECOND))
    assert len(notes.shut) == 1


def test_a_new_connection_begins_with_no_excess_but_the_same_level() -> None:
    notes = Notes()
    for now_s in (10.0, 12.1):
        for _ in range(125_000):
            notes.gate.passes(0, round(now_s * SECOND))
    assert len(notes.shut) == 1
    notes.gate.open()
    assert not notes.gate.shut
    before = notes.excess
    assert not notes.gate.passes(0, round(12.1 * SECOND))
    assert notes.excess == before + 1
    assert not notes.gate.shut


def test_the_gate_costs_little() -> None:
    notes, started_s = Notes(), time.perf_counter()
    for number in range(100_000):
        notes.gate.passes(90, number * 1_000_000)
    assert (time.perf_counter() - started_s) / 100_000 < 20e-6  # a loaded machine included


async def test_a_follower_that_floods_is_cut_off_and_the_next_is_served(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mmt.link.rate_limit, "MESSAGES_PER_PERIOD", 1)
    monkeypatch.setattr(mmt.link.rate_limit, "BURST_S", 0.5)
    monkeypatch.setattr(mmt.link.rate_limit, "GRACE_S", 0.05)
    notes = LeaderNotes()
    async with leader(notes) as server:
        client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False, reconnection=False)
        url = f"http://127.0.0.1:{server.port}"
        await client.connect(url, auth=hello().to_auth(), transports=["websocket"])
        rubbish = encode_event("frames", b"x")
        with contextlib.suppress(ConnectionError, RuntimeError, aiohttp.ClientError):
            async with asyncio.timeout(30):
                while not notes.losses:
                    for _ in range(200):
                        await client.eio.ws.send_bytes(rubbish)
                    await asyncio.sleep(0)
        await until(lambda: notes.losses)
        assert notes.losses[0].startswith("it sent more than 1000 messages")
        assert server.statistics.rejected["too fast"] > 0
        await client.disconnect()
        monkeypatch.setattr(
            server.endpoint.rate_limit, "_due_ns", 0
        )  # what the first owes would take 0.5 s
        async with follower(server.port) as good:
            good.send_frames(frames(0))
            await until(lambda: notes.sequences == [0])
    assert notes.errors == []


async def test_a_leader_that_floods_ends_the_follower_with_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mmt.link.rate_limit, "MESSAGES_PER_PERIOD", 1)
    monkeypatch.setattr(mmt.link.rate_limit, "BURST_S", 0.5)
    monkeypatch.setattr(mmt.link.rate_limit, "GRACE_S", 0.05)
    notes = FollowerNotes()
    async with leader() as server, follower(server.port, notes) as client:
        await until(lambda: server.can_send)
        async with asyncio.timeout(30):
            while not notes.errors:
                server.endpoint.outbox.put(1, encode_event("commands", b"x"))
                server.endpoint.outbox.put(1, encode_event("commands", b"x"))
                await asyncio.sleep(0)
        assert str(notes.errors[0]).startswith("the leader was cut off: it sent more than")
        assert client.statistics.rejected["too fast"] > 0


async def test_who_is_not_let_in_may_neither_stay_nor_talk(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mmt.link.server_sockets, "HANDSHAKE_S", 0.3)
    async with leader() as server, aiohttp.ClientSession() as session:
        url = f"http://127.0.0.1:{server.port}/socket.io/?EIO=4&transport=websocket"
        async with follower(server.port) as good, session.ws_connect(url) as silent:
            assert (await silent.receive()).type is aiohttp.WSMsgType.TEXT  # the handshake
            async with asyncio.timeout(10):
                while not (await silent.receive()).type & 0x8:  # until it is closed
                    pass
            assert silent.closed
            async with session.ws_connect(url) as talking, asyncio.timeout(10):
                await talking.receive()
                for _ in range(200):
                    if talking.closed:
                        break
                    await talking.send_bytes(b"x" * 1000)
                message = await talking.receive()
                assert message.type in {aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED}
            assert good.connected
