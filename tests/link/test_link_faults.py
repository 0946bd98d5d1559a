"""A follower, a leader or the wire between them goes away."""

import asyncio
import gc
import socket
import struct
from types import SimpleNamespace

import socketio
from link_samples import (
    FollowerNotes,
    LeaderNotes,
    commands,
    follower,
    frames,
    hello,
    leader,
    until,
)
from wire_relay import relay

import mmt.link.client
import mmt.link.connection
import mmt.link.serving.http
import mmt.link.serving.sockets
from mmt.link.client import FollowerClient
from mmt.link.websocket import client_send


async def test_a_follower_that_dies_frees_its_place_at_once():
    notes = LeaderNotes()
    async with leader(notes) as server, relay(server.port) as wire:
        dying = socketio.AsyncClient(serializer="msgpack", handle_sigint=False, reconnection=False)
        await dying.connect(
            f"http://127.0.0.1:{wire.port}", auth=hello().to_auth(), transports=["websocket"]
        )
        await dying.emit("frames", frames(0).tobytes())
        await until(lambda: notes.sequences == [0])
        wire.drop()
        await until(lambda: notes.losses, timeout_s=1.0)
        assert notes.losses == ["the connection was closed"]
        assert not server.connected
        assert notes.ends == []
        async with follower(server.port) as successor:
            successor.send_frames(frames(0))  # a new session begins
            await until(lambda: notes.sequences == [0, 0])
        await dying.eio.wait()  # it closes its HTTP session last


async def test_a_cut_link_is_taken_up_again_and_shows_as_a_gap():
    up, down = LeaderNotes(), FollowerNotes()
    async with (
        leader(up) as server,
        relay(server.port) as wire,
        follower(wire.port, down, source="the same") as client,
    ):
        client.send_frames(frames(0, 10))
        await until(lambda: len(up.sequences) == 10)
        wire.drop()
        await until(lambda: down.losses and up.losses)
        assert not client.connected
        assert not server.connected
        client.send_frames(frames(10, 5))  # nobody can take them
        server.send_commands(commands(0))
        assert client.statistics.dropped == 5
        await until(lambda: client.connected and server.can_send)
        client.send_frames(frames(15, 5))
        server.send_commands(commands(1))
        await until(lambda: len(up.sequences) == 15 and down.sequences == [1])
        assert server.statistics.lost == 5
        assert client.statistics.lost == 0
        await client.end("done")
        assert server.statistics.lost == 5
    assert [note.source for note in up.hellos] == ["the same", "the same"]
    assert up.sequences == [*range(10), *range(15, 20)]
    assert len(down.losses) == len(up.losses) == 1
    assert up.ends == ["done"]


async def test_a_leader_that_stops_without_asking_is_lost_and_may_come_back():
    up, down = LeaderNotes(), FollowerNotes()
    async with leader() as first:
        port = first.port
        client = FollowerClient(f"http://127.0.0.1:{port}", hello(), down.events())
        await client.connect(10.0)
        client.send_frames(frames(0, 3))
    await until(lambda: down.losses)
    assert not client.connected
    async with leader(up, port=port) as second:
        await until(lambda: client.connected)
        client.send_frames(frames(7))
        await until(lambda: up.sequences == [7])
        assert second.statistics.lost == 0  # it never knew the others
        await client.end("done")
        await client.disconnect()
    assert len(down.losses) == 1


async def test_a_follower_may_give_up_on_a_leader_that_does_not_come_back():
    notes = FollowerNotes()
    async with leader() as server:
        client = FollowerClient(f"http://127.0.0.1:{server.port}", hello(), notes.events())
        await client.connect(10.0)
    await until(lambda: notes.losses)
    await asyncio.sleep(0.3)  # into the attempts to reconnect
    await client.end("alone")
    await asyncio.wait_for(client.disconnect(), 10.0)
    assert not client.connected
    assert len(notes.losses) == 1


async def test_a_silent_wire_is_noticed_on_both_sides_and_the_link_is_taken_up_again(monkeypatch):
    monkeypatch.setattr(mmt.link.serving.http, "PING_TIMEOUT_S", 1)
    monkeypatch.setattr(mmt.link.connection, "ATTEMPT_S", 0.2)
    up, down = LeaderNotes(), FollowerNotes()
    async with (
        leader(up) as server,
        relay(server.port) as wire,
        follower(wire.port, down) as client,
    ):
        wire.fall_silent()
        await until(lambda: up.losses and down.losses)
        assert not server.connected
        before = len(wire.writers)
        await until(lambda: len(wire.writers) >= before + 6)  # three attempts
        wire.mend()
        await until(lambda: client.connected and server.connected, timeout_s=5.0)
    assert len(down.losses) == 1


async def test_a_client_that_leaves_before_it_is_answered_is_no_error(monkeypatch, caplog):
    monkeypatch.setattr(mmt.link.serving.sockets, "HANDSHAKE_S", 0.1)
    request = (
        b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    )
    async with leader() as server:
        for _ in range(5):
            with socket.create_connection(("127.0.0.1", server.port)) as leaving:
                leaving.sendall(request)
                leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.3)
        gc.collect()  # an exception that nobody retrieved is logged then
    assert caplog.messages == []


async def test_the_end_does_not_wait_for_ever_on_a_silent_wire(monkeypatch):
    monkeypatch.setattr(mmt.link.client, "CLOSE_TIMEOUT_S", 0.2)
    async with (
        leader() as server,
        relay(server.port) as wire,
        follower(wire.port) as client,
    ):
        wire.fall_silent()
        await asyncio.wait_for(client.end("unheard"), 5.0)


async def test_where_the_library_hides_its_websocket_its_queue_is_used(monkeypatch):
    def hidden(self, sid, environ):
        return usual(self, sid, {})

    usual = mmt.link.serving.sockets.ServerSockets.send
    monkeypatch.setattr(mmt.link.serving.sockets.ServerSockets, "send", hidden)
    monkeypatch.setattr(
        mmt.link.connection,
        "client_send",
        lambda client: client_send(SimpleNamespace(eio=SimpleNamespace(send=client.eio.send))),
    )
    up, down = LeaderNotes(), FollowerNotes()
    async with leader(up) as server, follower(server.port, down) as client:
        await until(lambda: server.can_send)
        for sequence in range(20):
            client.send_frames(frames(sequence))
            server.send_commands(commands(sequence))
        await until(lambda: len(up.sequences) == len(down.sequences) == 20)
        await client.end("done")
    assert up.sequences == down.sequences == list(range(20))


async def test_a_link_that_breaks_in_the_moment_it_is_closed_is_closed():
    notes = FollowerNotes()
    async with (
        leader() as server,
        relay(server.port) as wire,
        follower(wire.port, notes) as client,
    ):
        wire.drop()
        await until(lambda: notes.losses)
        await client.disconnect()
        await asyncio.sleep(0.5)  # longer than the first pause
        assert not server.connected
        assert not client.connected
