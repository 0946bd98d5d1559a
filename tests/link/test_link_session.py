import asyncio
import time

import pytest
from link_samples import (
    CHANNELS,
    FollowerNotes,
    LeaderNotes,
    commands,
    follower,
    frames,
    hello,
    leader,
    until,
)

from mmt.core.errors import MmtError
from mmt.core.frames import frame_dtype
from mmt.link.client import FollowerClient
from mmt.link.endpoint import LeaderEvents
from mmt.link.server import LeaderServer
from mmt.scene import Link


async def test_both_sides_count_the_same():
    up, down = LeaderNotes(), FollowerNotes()
    async with leader(up) as server, follower(server.port, down) as client:
        await until(lambda: server.can_send)
        now_ns = time.monotonic_ns()
        for sequence in (0, 1, 2, 5, 6):
            client.send_frames(frames(sequence, time_ns=now_ns))
            echo = commands(sequence, time_ns=now_ns)
            echo["echo_time_ns"] = now_ns
            server.send_commands(echo)
        await until(lambda: len(up.sequences) == len(down.sequences) == 5)
        above, below = server.statistics, client.statistics
    assert (above.frames, above.commands, below.frames, below.commands) == (5, 5, 5, 5)
    assert above.messages_sent == below.messages_received == 5
    assert above.messages_received == below.messages_sent == 5
    assert above.bytes_received == 5 * frame_dtype(CHANNELS).itemsize
    assert above.lost == below.lost == 2
    for statistics in (above, below):
        assert statistics.latency_p99_ms is not None
        assert 0.0 < statistics.latency_p50_ms <= statistics.latency_p99_ms < 10_000
        assert statistics.dropped == statistics.repeated == statistics.out_of_order == 0
        assert statistics.rejected == {}
    assert below.round_trip_p50_ms > 0
    assert above.round_trip_p50_ms is None


async def test_the_round_trip_leaves_out_how_long_the_leader_held_the_echo():
    down = FollowerNotes()
    async with leader() as server, follower(server.port, down) as client:
        await until(lambda: server.can_send)
        echo = commands(0)
        echo["echo_time_ns"] = time.monotonic_ns() - 3_000_000_000
        echo["echo_age_ns"] = 2_900_000_000
        server.send_commands(echo)
        await until(lambda: down.sequences)
        round_trip_ms = client.statistics.round_trip_p50_ms
    assert 99.0 <= round_trip_ms < 2_000


async def test_the_leader_asks_the_follower_to_stop_and_waits_for_its_end():
    up, down = LeaderNotes(), FollowerNotes()
    async with leader(up) as server:
        await server.request_stop("nobody there")

        async def follow():
            async with follower(server.port, down) as client:
                client.send_frames(frames(0))
                await until(lambda: down.stops)
                await client.end("as asked")

        following = asyncio.create_task(follow())
        await until(lambda: up.sequences)
        await server.request_stop("completed")
        assert down.stops == ["completed"]
        assert up.ends == ["as asked"]
        assert not server.connected
        await following
    assert up.losses == down.losses == []


async def test_a_follower_that_ignores_the_stop_does_not_hold_the_leader_up():
    up, down = LeaderNotes(), FollowerNotes()
    async with leader(up) as server, follower(server.port, down):
        await server.request_stop("completed")
        await server.stop()
        await until(lambda: down.stops)
        await asyncio.sleep(0.05)
    assert up.losses == down.losses == []


async def test_the_end_counts_what_was_lost_at_the_tail():
    notes = LeaderNotes()
    async with leader(notes) as server, follower(server.port) as client:
        client.send_frames(frames(0, 10))
        await until(lambda: len(notes.sequences) == 10)
        client.endpoint.outbox.close()
        client.send_frames(frames(10, 5))
        assert client.statistics.dropped == 5
        await client.end("done")
        await client.end("twice")
        assert server.statistics.lost == 5
        assert not server.connected
        server.send_commands(commands(0))  # nobody wants them any more
        assert server.statistics.dropped == 0
    assert notes.ends == ["done"]


async def test_both_may_be_used_without_ever_being_connected():
    server = LeaderServer(Link(port=0), CHANNELS, LeaderNotes().events())
    assert server.port == 0
    assert not server.connected
    server.send_commands(commands(0))
    await server.request_stop("nothing")
    await server.stop()
    client = FollowerClient("http://127.0.0.1:1", hello(), FollowerNotes().events())
    client.send_frames(frames(0, 7))
    await client.end("nothing")
    await client.disconnect()
    assert client.statistics.dropped == 7
    assert not client.connected
    for send, other in ((client.send_frames, commands(0)), (server.send_commands, frames(0))):
        with pytest.raises(ValueError, match="dtype"):
            send(other)


async def test_a_port_that_is_taken_is_explained():
    async with leader() as server:
        second = LeaderServer(Link(port=server.port), CHANNELS, LeaderNotes().events())
        with pytest.raises(MmtError, match=rf"cannot listen on 127.0.0.1 port {server.port}"):
            await second.start()
        await second.stop()
    elsewhere = LeaderServer(Link(host="203.0.113.1", open=True), CHANNELS, LeaderNotes().events())
    with pytest.raises(MmtError, match=r"cannot listen on 203\.0\.113\.1"):
        await elsewhere.start()


@pytest.mark.parametrize("handed", [True, False])
async def test_what_a_service_raises_is_handed_to_it_or_else_logged(handed, caplog):
    def fail(*_):
        raise ZeroDivisionError("in the service")

    up = LeaderNotes()
    own = {"on_error": up.errors.append} if handed else {}
    events = LeaderEvents(on_frames=fail, **own)
    async with leader(events=events) as server, follower(server.port) as client:
        client.send_frames(frames(0))
        client.send_frames(frames(1))
        await until(lambda: len(up.errors) == 2 or "in the service" in caplog.text)
        assert server.connected
    assert [type(error) for error in up.errors] == ([ZeroDivisionError] * 2 if handed else [])
