"""Who is turned away, what is thrown away, and what each is told."""

import asyncio

import pytest
import socketio
from link_samples import (
    FollowerNotes,
    LeaderNotes,
    follower,
    frames,
    hello,
    leader,
    until,
)

from mmt.core.errors import InputError, MmtError
from mmt.link.client import FollowerClient
from mmt.link.server import LeaderServer
from mmt.scene import Link

GOOD = hello().to_auth()


@pytest.fixture
async def server():
    async with leader() as started:
        yield started


async def test_the_followers_user_reads_the_refusal(server):
    with pytest.raises(MmtError, match=r"the leader at http://127.+ refused: .+ needs position, f"):
        async with follower(server.port, channels=("position",)):
            pass


async def test_malformed_events_do_no_harm():
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        for data in ("text", 5, None, {"a": b"b"}, b"", bytes(37), frames(0, 101).tobytes()):
            await client.emit("frames", data)
        await client.emit("frames", (frames(0).tobytes(), frames(1).tobytes()))
        for data in (
            None,
            3,
            {"reason": 5, "frames": 1},
            {"reason": "x"},
            {"reason": "x", "frames": "y"},
        ):
            await client.emit("end", data)
        for data in (None, 3, b"x", {"event": "x"}):
            await client.emit("event", data)
        await client.emit("unknown event", b"x")
        broken = frames(0)
        broken["force_n"] = float("nan")
        await client.emit("frames", broken.tobytes())
        await client.emit("frames", frames(1).tobytes())
        await until(lambda: notes.sequences == [1])
        assert server.statistics.rejected == {
            "not bytes": 5,
            "size": 2,
            "too many": 1,
            "malformed end": 5,
            "malformed event": 4,
            "not finite": 1,
        }
        assert server.connected
        await client.disconnect()
    assert notes.ends == []
    assert notes.errors == []


async def test_a_message_that_is_too_long_closes_that_link_alone():
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False, reconnection=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        await client.emit("frames", bytes(200_000))
        await until(lambda: notes.losses)
        await until(lambda: not client.connected)
        async with follower(server.port) as other:
            other.send_frames(frames(0))
            await until(lambda: notes.sequences == [0])


async def test_events_after_the_end_are_not_of_the_session():
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        await client.emit("frames", frames(0).tobytes())
        await client.call("end", {"reason": "x" * 1000, "frames": 1})
        await client.emit("frames", frames(1).tobytes())
        await client.call("end", {"reason": "again", "frames": 2})
        await client.disconnect()
    assert notes.sequences == [0]
    assert notes.ends == ["x" * 256]


async def test_no_leader_is_explained(unused_tcp_port):
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    with pytest.raises(
        MmtError, match=r"no leader answered at .+ within 0\.3 s .*start mmt-leader"
    ):
        await client.connect(0.3)
    await client.disconnect()


async def test_a_server_that_is_no_leader_is_explained():
    async def answer(reader, writer):
        await reader.readline()
        writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    other = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = other.sockets[0].getsockname()[1]
    client = FollowerClient(f"http://127.0.0.1:{port}", hello(), FollowerNotes().events())
    with pytest.raises(MmtError, match="404"):
        await client.connect(0.3)
    other.close()
    await other.wait_closed()


async def test_a_server_that_never_speaks_does_not_hold_the_follower_up():
    hang = asyncio.Event()

    async def keep_silent(reader, writer):
        await hang.wait()
        writer.close()

    other = await asyncio.start_server(keep_silent, "127.0.0.1", 0)
    port = other.sockets[0].getsockname()[1]
    client = FollowerClient(f"http://127.0.0.1:{port}", hello(), FollowerNotes().events())
    with pytest.raises(MmtError, match="no leader answered"):
        await asyncio.wait_for(client.connect(0.3), 10.0)
    hang.set()
    other.close()
    await asyncio.sleep(0.05)


async def test_the_leader_may_start_after_the_follower(unused_tcp_port):
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    connecting = asyncio.create_task(client.connect(20.0))
    await asyncio.sleep(0.3)
    assert not connecting.done()
    async with leader(port=unused_tcp_port) as server:
        await connecting
        assert server.connected
        await client.disconnect()


async def test_a_follower_may_give_up_while_it_connects(unused_tcp_port):
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    connecting = asyncio.create_task(client.connect(60.0))
    await asyncio.sleep(0.1)
    connecting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await connecting
    await client.end("nothing")
    await client.disconnect()


@pytest.mark.parametrize(
    "url",
    [
        "",
        "leader",
        "leader:8765",
        "ftp://leader",
        "http://",
        "http://:80",
        "http://h:99999",
        "http://[::1",
    ],
)
def test_a_bad_url_is_explained(url):
    with pytest.raises(InputError, match="allowed is http://HOST:PORT"):
        FollowerClient(url, hello(), FollowerNotes().events())


def test_a_leader_needs_channels():
    with pytest.raises(InputError, match="channels"):
        LeaderServer(Link(), (), LeaderNotes().events())
