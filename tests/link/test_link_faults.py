"""Who goes away, who is turned away, what is thrown away, and what each is told."""

import asyncio
import gc
import socket
import struct

import pytest
from link_samples import (
    UPGRADE,
    FollowerNotes,
    LeaderNotes,
    commands,
    follower,
    frames,
    hello,
    leader,
    stock_client,
    until,
)
from wire_relay import Wire

import mmt.link.client
import mmt.link.connection
import mmt.link.serving.http
import mmt.link.serving.sockets
from mmt.core.errors import InputError, MmtError
from mmt.link.client import FollowerClient


async def test_a_follower_that_dies_frees_its_place_at_once():
    notes = LeaderNotes()
    async with (
        leader(notes) as server,
        Wire(server.port) as wire,
        stock_client(wire.port) as dying,
    ):
        await dying.emit("frames", frames(0).tobytes())
        await until(lambda: notes.sequences == [0])
        wire.cut()
        await until(lambda: notes.losses, timeout_s=1.0)
        assert notes.losses == ["the connection was closed"]
        assert not server.connected
        assert notes.ends == []
        async with follower(server.port) as successor:
            successor.send_frames(frames(0))  # a new session begins
            await until(lambda: notes.sequences == [0, 0])


async def test_a_cut_link_is_taken_up_again_and_shows_as_a_gap():
    up, down = LeaderNotes(), FollowerNotes()
    async with (
        leader(up) as server,
        Wire(server.port) as wire,
        follower(wire.port, down, source="the same") as client,
    ):
        client.send_frames(frames(0, 10))
        await until(lambda: len(up.sequences) == 10)
        wire.cut()
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


async def test_a_leader_that_stops_without_asking_is_lost_and_may_come_back_or_be_given_up():
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
    await until(lambda: len(down.losses) == 2)
    await asyncio.sleep(0.3)  # into the attempts to reconnect
    await client.end("alone")
    await asyncio.wait_for(client.disconnect(), 10.0)
    assert not client.connected
    assert len(down.losses) == 2


async def test_a_silent_wire_is_noticed_on_both_sides_and_the_link_is_taken_up_again(monkeypatch):
    monkeypatch.setattr(mmt.link.serving.http, "PING_TIMEOUT_S", 1)
    monkeypatch.setattr(mmt.link.connection, "ATTEMPT_S", 0.2)
    up, down = LeaderNotes(), FollowerNotes()
    async with (
        leader(up) as server,
        Wire(server.port) as wire,
        follower(wire.port, down) as client,
    ):
        wire.stall()
        await until(lambda: up.losses and down.losses)
        assert not server.connected
        before = wire.connections
        await until(lambda: wire.connections >= before + 3)  # three attempts
        wire.mend()
        await until(lambda: client.connected and server.connected, timeout_s=5.0)
    assert len(down.losses) == 1


async def test_a_client_that_leaves_before_it_is_answered_is_no_error(monkeypatch, caplog):
    monkeypatch.setattr(mmt.link.serving.sockets, "HANDSHAKE_S", 0.1)
    async with leader() as server:
        for _ in range(5):
            with socket.create_connection(("127.0.0.1", server.port)) as leaving:
                leaving.sendall(UPGRADE)
                leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.3)
        gc.collect()  # an exception that nobody retrieved is logged then
    assert caplog.messages == []


async def test_the_end_does_not_wait_for_ever_on_a_silent_wire(monkeypatch):
    monkeypatch.setattr(mmt.link.client, "CLOSE_TIMEOUT_S", 0.2)
    async with leader() as server, Wire(server.port) as wire, follower(wire.port) as client:
        wire.stall()
        await asyncio.wait_for(client.end("unheard"), 5.0)


async def test_malformed_events_do_no_harm():
    notes, broken = LeaderNotes(), frames(0)
    broken["force_n"] = float("nan")
    malformed = {
        "frames": ["text", None, b"", bytes(37), frames(0, 101).tobytes(), broken.tobytes()],
        "end": [None, {"reason": 5, "frames": 1}, {"reason": "x"}, {"reason": "x", "frames": "y"}],
        "event": [None, b"x", {"event": "x"}],
        "unknown event": [b"x"],
    }
    async with leader(notes) as server, stock_client(server.port) as client:
        for event, payloads in malformed.items():
            for data in payloads:
                await client.emit(event, data)
        await client.emit("frames", (frames(0).tobytes(), frames(1).tobytes()))
        await client.emit("frames", frames(1).tobytes())
        await until(lambda: notes.sequences == [1])
        assert server.statistics.rejected == {
            "not bytes": 3,
            "size": 2,
            "too many": 1,
            "malformed end": 4,
            "malformed event": 3,
            "not finite": 1,
        }
        assert server.connected
    assert notes.ends == []
    assert notes.errors == []


async def test_a_message_that_is_too_long_closes_that_link_alone():
    notes = LeaderNotes()
    async with leader(notes) as server, stock_client(server.port) as client:
        await client.emit("frames", bytes(200_000))
        await until(lambda: notes.losses)
        await until(lambda: not client.connected)
        async with follower(server.port) as other:
            other.send_frames(frames(0))
            await until(lambda: notes.sequences == [0])


async def refused_in_time(port, said):
    client = FollowerClient(f"http://127.0.0.1:{port}", hello(), FollowerNotes().events())
    with pytest.raises(MmtError, match=said):
        await asyncio.wait_for(client.connect(0.3), 10.0)
    await client.disconnect()


async def test_no_leader_is_explained(unused_tcp_port):
    said = r"no leader answered at .+ within 0\.3 s .*start mmt-leader"
    await refused_in_time(unused_tcp_port, said)


NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


@pytest.mark.parametrize(
    ("answered", "said"), [(None, r"\(nothing came back in time\)"), (NOT_FOUND, "404")]
)
async def test_a_server_that_is_no_leader_is_explained_in_time(answered, said):
    async def answer(reader, writer):
        await reader.readline()
        if answered is None:
            await hang.wait()
        else:
            writer.write(answered)
            await writer.drain()
        writer.close()

    hang = asyncio.Event()
    other = await asyncio.start_server(answer, "127.0.0.1", 0)
    await refused_in_time(other.sockets[0].getsockname()[1], said)
    hang.set()
    other.close()
    await asyncio.sleep(0.05)


async def test_the_leader_may_start_after_the_follower_who_may_also_give_up(unused_tcp_port):
    url = f"http://127.0.0.1:{unused_tcp_port}"
    client = FollowerClient(url, hello(), FollowerNotes().events())
    given_up = asyncio.create_task(client.connect(60.0))
    await asyncio.sleep(0.1)
    given_up.cancel()
    with pytest.raises(asyncio.CancelledError):
        await given_up
    await client.end("nothing")
    await client.disconnect()
    client = FollowerClient(url, hello(), FollowerNotes().events())
    connecting = asyncio.create_task(client.connect(20.0))
    await asyncio.sleep(0.3)
    assert not connecting.done()
    async with leader(port=unused_tcp_port) as server:
        await connecting
        assert server.connected
        await client.disconnect()
        with pytest.raises(MmtError, match=rf"the leader at {url} refused: .+ needs position, f"):
            async with follower(server.port, channels=("position",)):
                pass


@pytest.mark.parametrize(
    "url",
    [
        "",
        "leader:1",
        "ftp://leader",
        "http://",
        "http://:80",
        "http://h:99999",
        "http://[::1",
        "http://h:1/mmt",
    ],
)
def test_a_bad_url_is_explained(url):
    with pytest.raises(InputError, match="allowed is http://HOST:PORT"):
        FollowerClient(url, hello(), FollowerNotes().events())
