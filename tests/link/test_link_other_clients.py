"""Clients of other makes: bytes of JavaScript, no msgpack, no clock, pages of other sites."""

import asyncio

import aiohttp
import msgpack
import pytest
from link_samples import CHANNELS, LeaderNotes, frames, leader, stock_client, until
from test_link_wire import AUTH

from mmt.core.errors import InputError
from mmt.link.protocol import encode_event
from mmt.link.server import LeaderServer
from mmt.link.websocket import binary_event, decode_packet
from mmt.scene import Link

TOKEN = "0123456789abcdef-secret"


@pytest.mark.parametrize("stranger", [False, True])
def test_extension_0_is_bytes_and_no_other_is(stranger):
    for code, expected in ((0, ("frames", b"abc")), (1, None)):
        packet = {"type": 2, "nsp": "/", "data": ["frames", msgpack.ExtType(code, b"abc")]}
        decoded = decode_packet(msgpack.packb(packet), stranger=stranger)
        assert decoded is not None
        assert binary_event(decoded) == expected
    assert decode_packet(encode_event("frames", b"abc")) is not None


async def test_a_client_that_is_not_understood_is_told_why_and_its_clock_is_missed():
    notes, heard = LeaderNotes(), []
    async with leader(notes) as server, stock_client(server.port, clock_id="") as client:
        client.on("rejected", heard.append)
        for _ in range(200):
            await client.emit("frames", {"0": 1})
        await client.emit("frames", frames(0).tobytes()[:-1])
        await until(lambda: len(heard) == 2)
        assert [each["reason"] for each in heard] == ["not bytes", "size"]
        assert "ArrayBuffer" in heard[0]["text"]
        assert "36 bytes" in heard[1]["text"]
        await until(lambda: server.clock.unknown_s > 0.2)


async def test_pages_of_named_sites_may_connect_with_a_token(monkeypatch):
    site = "https://lab.example"
    with pytest.raises(InputError, match="only with a token"):
        LeaderServer(Link(allow_origins=(site,)), CHANNELS, LeaderNotes().events())
    with pytest.raises(ValueError, match="is no origin"):
        Link(allow_origins=("*",))
    monkeypatch.setenv("MMT_LINK_TOKEN", TOKEN)
    async with leader(allow_origins=(site,)) as server:
        url = f"http://127.0.0.1:{server.port}/socket.io/?EIO=4&transport=websocket"
        async with aiohttp.ClientSession() as session, asyncio.timeout(20):
            for token, answer in (("wrong", 4), (TOKEN, 0)):
                async with session.ws_connect(url, origin=site) as socket:
                    assert (await socket.receive_str()).startswith("0")
                    hello = {"type": 0, "nsp": "/", "data": {**AUTH, "token": token}}
                    await socket.send_bytes(msgpack.packb(hello))
                    assert msgpack.unpackb(await socket.receive_bytes())["type"] == answer
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await session.ws_connect(url, origin="https://other.example")
            assert refused.value.status == 403
