"""A peer that sends too much is cut off; who is not admitted may hardly send anything."""

import asyncio
import contextlib

import aiohttp
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

import mmt.link.incoming
import mmt.link.serving.sockets
from mmt.link.protocol import encode_event


async def test_a_follower_that_floods_is_cut_off_and_the_next_is_served(monkeypatch):
    monkeypatch.setattr(mmt.link.incoming, "MESSAGES_PER_PERIOD", 1)
    monkeypatch.setattr(mmt.link.incoming, "BURST_S", 0.5)
    monkeypatch.setattr(mmt.link.incoming, "GRACE_S", 0.05)
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


async def test_a_leader_that_floods_ends_the_follower_with_a_reason(monkeypatch):
    monkeypatch.setattr(mmt.link.incoming, "MESSAGES_PER_PERIOD", 1)
    monkeypatch.setattr(mmt.link.incoming, "BURST_S", 0.5)
    monkeypatch.setattr(mmt.link.incoming, "GRACE_S", 0.05)
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


async def test_who_is_not_let_in_may_neither_stay_nor_talk(monkeypatch):
    monkeypatch.setattr(mmt.link.serving.sockets, "HANDSHAKE_S", 0.3)
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
