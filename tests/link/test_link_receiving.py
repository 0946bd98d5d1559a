"""The frequent events go past the library, all others through it; and both ways are one."""

import asyncio
from collections import Counter
from contextlib import asynccontextmanager
from itertools import product

import aiohttp
import msgpack
import numpy as np
import pytest
import socketio
from aiohttp import web
from hypothesis import given, settings
from hypothesis import strategies as st
from link_samples import (
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
from socketio.msgpack_packet import MsgPackPacket

import mmt.link.connection
import mmt.link.serving.sockets
import mmt.link.socket_client
from mmt.link.incoming import HandshakeLimit
from mmt.link.protocol import encode_event
from mmt.link.websocket import (
    DecodedPacket,
    Packet,
    binary_event,
    decode_packet,
    is_reserved,
    receive_directly,
)


@pytest.fixture
def decoded(monkeypatch):
    """Count by type the packets that reach the library, on both sides together."""
    counted = Counter()
    usual = Packet.decode

    def decode(self, encoded):
        usual(self, encoded)
        counted[self.packet_type] += 1

    monkeypatch.setattr(Packet, "decode", decode)
    return counted


def event_in(message):
    packet = decode_packet(message)
    return None if packet is None else binary_event(packet)


async def exchange(count):
    """Send so many frames and commands, one a message, and a reason; they arrive unchanged."""
    up, down = LeaderNotes(), FollowerNotes()
    async with leader(up) as server, follower(server.port, down) as client:
        await until(lambda: server.can_send)
        for sequence in range(count):
            client.send_frames(frames(sequence))
            server.send_commands(commands(sequence))
            await asyncio.sleep(0)
        await until(lambda: len(up.sequences) == len(down.sequences) == count)
        await client.end("enough")
        await until(lambda: up.ends)
    assert np.array_equal(np.concatenate(up.blocks), frames(0, count))
    assert np.array_equal(np.concatenate(down.blocks), commands(0, count))
    assert up.ends == ["enough"]
    assert up.losses == down.losses == up.errors == down.errors == []


async def test_frames_and_commands_do_not_pass_through_the_library(decoded):
    await exchange(100)
    # the welcome, the end, and at most what came before the connection was told of
    assert decoded[socketio.packet.EVENT] <= 4
    assert decoded[socketio.packet.CONNECT] == 2
    assert decoded[socketio.packet.ACK] == 1


async def test_where_the_library_hides_its_websocket_it_hands_over_the_same(monkeypatch, decoded):
    def hidden(self, sid, environ):
        return send(self, sid, {})

    send = mmt.link.serving.sockets.ServerSockets.send
    monkeypatch.setattr(mmt.link.serving.sockets.ServerSockets, "send", hidden)
    monkeypatch.setattr(mmt.link.serving.sockets, "receive_directly", lambda *_: None)
    monkeypatch.setattr(mmt.link.connection, "client_send", lambda client: client.eio.send)
    monkeypatch.setattr(
        mmt.link.socket_client, "client_websocket", lambda *_: aiohttp.ClientWebSocketResponse
    )
    await exchange(40)
    assert decoded[socketio.packet.EVENT] == 82


JOIN = MsgPackPacket(socketio.packet.CONNECT, data=hello().to_auth(), namespace="/").encode()


@asynccontextmanager
async def plain_websocket(server):
    url = f"http://127.0.0.1:{server.port}/socket.io/?EIO=4&transport=websocket"
    async with aiohttp.ClientSession() as session, session.ws_connect(url) as websocket:
        yield websocket


async def test_a_client_that_joins_again_on_the_same_websocket_is_a_new_follower():
    notes = LeaderNotes()
    leave = MsgPackPacket(socketio.packet.DISCONNECT, namespace="/").encode()
    async with leader(notes) as server, plain_websocket(server) as websocket:
        await websocket.send_bytes(encode_event("frames", frames(7).tobytes()))
        for _visit in range(2):
            await websocket.send_bytes(JOIN)
            await websocket.send_bytes(encode_event("frames", frames(0).tobytes()))
            await websocket.send_bytes(leave)
            await websocket.send_bytes(encode_event("frames", frames(1).tobytes()))
        await until(lambda: len(notes.losses) == 2)
        await until(lambda: notes.sequences == [0, 0])
    assert len(notes.hellos) == 2
    assert server.statistics.rejected == {}


async def test_an_event_by_a_name_of_the_library_reaches_none_of_its_handlers(caplog):
    up, down = LeaderNotes(), FollowerNotes()
    arguments = (b"x", "text", {"message": "forged"}, None)
    async with leader(up) as server, follower(server.port, down) as client:
        await until(lambda: server.can_send)
        for event, argument in product(("connect", "disconnect", "connect_error"), arguments):
            for side in (client, server):
                side.endpoint.outbox.put(0, encode_event(event, argument))
        client.send_frames(frames(0))
        server.send_commands(commands(0))
        await until(lambda: up.sequences == down.sequences == [0])
        assert up.losses == []
        for side in (client, server):
            assert side.statistics.rejected == {"reserved event": 12}
            assert side.connected
    assert len(up.hellos) == 1
    assert down.losses == []
    assert "refused" not in caplog.text


def test_a_websocket_that_cannot_be_changed_is_left_as_it_is():
    class Closed(web.WebSocketResponse):
        def __setattr__(self, name, value):
            if name == "receive":
                raise AttributeError(name)
            super().__setattr__(name, value)

    websocket = Closed()
    receive_directly(websocket, {"frames": pytest.fail}, HandshakeLimit())
    assert websocket.receive.__func__ is web.WebSocketResponse.receive


@given(st.text(max_size=10), st.binary(max_size=300))
def test_an_event_is_encoded_as_by_the_library_and_read_back(name, argument):
    packet = MsgPackPacket(socketio.packet.EVENT, data=[name, argument], namespace="/")
    assert encode_event(name, argument) == packet.encode()
    assert event_in(packet.encode()) == (name, argument)


SCALARS = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.text() | st.binary()
SMALL = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=32) | st.dictionaries(st.text(), inner, max_size=32),
    max_leaves=20,
)


def containers(value):
    """How many maps and arrays a value has."""
    inner = [*value.values()] if isinstance(value, dict) else value
    return 1 + sum(map(containers, inner)) if isinstance(inner, list) else 0


@given(SMALL)
def test_a_strangers_packet_is_decoded_as_anyones_if_it_is_small(auth):
    packet = {"type": 0, "data": auth, "nsp": "/"}
    small = containers(packet) <= 32
    assert decode_packet(msgpack.packb(packet), stranger=True) == (packet if small else None)


@pytest.mark.parametrize(
    "auth",
    [[{}] * 130_000, [[]] * 33, [None] * 33, dict.fromkeys(map(str, range(33))), [[[{}] * 11] * 3]],
)
def test_what_takes_long_to_decode_is_no_strangers_packet(auth):
    packet = {"type": 0, "data": auth, "nsp": "/"}
    assert decode_packet(msgpack.packb(packet)) == packet
    assert decode_packet(msgpack.packb(packet), stranger=True) is None


def test_the_order_of_keys_and_further_ones_do_not_matter():
    packet = {"nsp": "/", "options": {"compress": True}, "data": ["frames", b"x"], "type": 2}
    assert event_in(msgpack.packb(packet)) == ("frames", b"x")


@pytest.mark.parametrize(
    "changes",
    [
        {"type": 3},
        {"nsp": "/other"},
        {"id": 0},
        {"id": 7},
        {"data": ["frames"]},
        {"data": ["frames", "text"]},
        {"data": ["frames", b"x", b"y"]},
        {"data": [b"frames", b"x"]},
        {"data": {"frames": b"x"}},
        {"data": None},
    ],
)
def test_all_else_is_the_librarys(changes):
    packet = {"type": 2, "data": ["frames", b"x"], "nsp": "/", **changes}
    assert event_in(msgpack.packb(packet)) is None


def test_the_librarys_packet_is_that_of_the_message_or_what_was_decoded_of_it():
    fields = {"type": 2, "nsp": "/", "data": ["end", b"x"], "id": 7}
    decoded = DecodedPacket(b"is not decoded again")
    decoded.packet = fields
    for message in (msgpack.packb(fields), decoded):
        packet = Packet(encoded_packet=message)
        assert (packet.packet_type, packet.namespace) == (2, "/")
        assert (packet.data, packet.id) == (["end", b"x"], 7)
    bare = Packet(encoded_packet=msgpack.packb({"type": 1, "nsp": "/"}))
    assert (bare.packet_type, bare.data, bare.id) == (1, None, None)
    with pytest.raises(ValueError, match=r"^malformed packet$"):
        Packet(encoded_packet=b"\xc1")


def test_an_event_is_reserved_if_the_library_handles_its_name():
    assert is_reserved({"type": 2, "data": ["connect", b"x"]})
    for kind, data in ((2, ["frames", b"x"]), (3, ["connect"]), (2, []), (2, None)):
        assert is_reserved({"type": kind, "data": data}) is False


_EVENT = encode_event("frames", bytes(20))


@given(
    st.one_of(
        st.binary(max_size=200),
        st.tuples(st.integers(0, len(_EVENT)), st.binary(max_size=20)).map(
            lambda cut: _EVENT[: cut[0]] + cut[1]
        ),
        st.integers(1, 100_000).map(lambda depth: b"\x91" * depth),
        st.integers(1, 50_000).map(lambda depth: b"\x81\xa1a" * depth),
    )
)
@settings(max_examples=300)
def test_no_message_whatever_raises(message):
    event = event_in(message)
    assert event is None or (isinstance(event[0], str) and isinstance(event[1], bytes))


async def test_frames_that_ask_for_an_acknowledgement_get_one():
    notes = LeaderNotes()
    async with leader(notes) as server, stock_client(server.port) as client:
        for sequence in range(4):
            if sequence % 2:
                await client.call("frames", frames(sequence).tobytes(), timeout=5)
            else:
                await client.emit("frames", frames(sequence).tobytes())
    assert notes.sequences == [0, 1, 2, 3]
