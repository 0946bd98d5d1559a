"""One WebSocket by itself: what is dropped, refused and closed, and what the libraries may log."""

import asyncio
import logging
from types import SimpleNamespace
from typing import Any

import aiohttp
import msgpack
import pytest
from aiohttp import WSCloseCode, WSMessage, WSMsgType, web
from aiohttp.http_exceptions import BadStatusLine

from mmt.link.incoming import HANDSHAKE_MESSAGES, HandshakeLimit, RateLimit
from mmt.link.protocol import MAX_MESSAGE_BYTES, encode_event
from mmt.link.queue import UnbufferedSend
from mmt.link.websocket import (
    DecodedPacket,
    client_send,
    receive_directly,
    receive_rest,
    wire_logger,
)

LAST = WSMessage(WSMsgType.TEXT, "2", None)
DEEP = msgpack.packb({"type": 2, "nsp": "/", "data": ["end", [{}] * 40]})
REFUSED = {"code": WSCloseCode.UNSUPPORTED_DATA, "message": b"msgpack alone"}
CUT = {"code": WSCloseCode.POLICY_VIOLATION, "message": b"too many messages"}


def binary(data):
    return WSMessage(WSMsgType.BINARY, data, None)


def text(data):
    return WSMessage(WSMsgType.TEXT, data, None)


class Socket(web.WebSocketResponse):
    """A server's WebSocket to which these messages come, and then the last one."""

    def __init__(self, *messages):
        super().__init__()
        self.coming = iter([*messages, LAST])
        self.pongs = []
        self.texts = []
        self.closings = []

    async def receive(self, timeout=None):
        return next(self.coming)

    async def pong(self, message=b""):
        self.pongs.append(message)

    async def send_str(self, data, compress=None):
        self.texts.append(data)

    async def close(self, **reason):
        self.closings.append(reason)
        return True


async def rest_of(*messages, **more):
    """Return what an admitted client's messages leave for the library, and why some are dropped."""
    socket, why = Socket(*messages), list[str]()
    limit = RateLimit(1000, on_drop=why.append, on_exceeded=pytest.fail)
    rest = await receive_rest(socket.receive, socket.pong, socket.close, limit, {}, **more)
    assert socket.closings == []
    return rest, why


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (binary(b"\xc1"), "malformed packet"),
        (binary(encode_event("connect", b"")), "reserved event"),
        *((text(odd), "malformed packet") for odd in ("x", "", ">", "b!", "\N{SUPERSCRIPT TWO}")),
        (text("42[]"), "packet without msgpack"),
    ],
)
async def test_what_cannot_be_used_is_dropped_for_a_reason(message, reason):
    assert await rest_of(message) == (LAST, [reason])


async def test_a_text_that_is_no_packet_is_not_refused():
    refusals = []

    async def refuse():
        refusals.append(None)

    assert await rest_of(text("x"), refuse=refuse) == (LAST, ["malformed packet"])
    assert refusals == []
    rest, why = await rest_of(text("42[]"), refuse=refuse)
    assert (rest.type, why, refusals) == (WSMsgType.CLOSED, ["packet without msgpack"], [None])


async def test_a_stranger_may_send_less_than_who_is_admitted():
    rest, why = await rest_of(binary(DEEP))
    assert (rest.data, why) == (DEEP, [])
    assert rest.data.packet["data"][0] == "end"
    socket = Socket(binary(DEEP))
    receive_directly(socket, {}, HandshakeLimit())
    assert await socket.receive() is LAST


@pytest.mark.parametrize(("beyond", "decoded"), [(0, True), (1, False)])
async def test_the_longest_message_is_decoded_and_a_longer_one_is_not(beyond, decoded):
    empty = len(encode_event("end", bytes(70_000))) - 70_000
    rest, _ = await rest_of(binary(encode_event("end", bytes(MAX_MESSAGE_BYTES - empty + beyond))))
    assert len(rest.data) == MAX_MESSAGE_BYTES + beyond
    assert isinstance(rest.data, DecodedPacket) is decoded


@pytest.mark.parametrize("kind", [WSMsgType.CLOSE, WSMsgType.ERROR])
async def test_a_message_of_another_kind_is_the_librarys(kind):
    message = WSMessage(kind, encode_event("frames", b"x"), None)
    assert await rest_of(message) == (message, [])


async def test_a_turn_of_the_loop_comes_after_64_messages(monkeypatch):
    pauses = []

    async def sleep(delay_s):
        pauses.append(delay_s)

    monkeypatch.setattr(asyncio, "sleep", sleep)
    await rest_of(*[WSMessage(WSMsgType.PONG, b"", None)] * 127)
    assert pauses == [0]


async def test_a_stranger_without_msgpack_is_told_and_closed():
    taken = []
    socket = Socket(
        WSMessage(WSMsgType.PING, b"alive", None), binary(encode_event("frames", b"x")), text("40")
    )
    receive_directly(socket, {"frames": taken.append}, HandshakeLimit())
    assert (await socket.receive()).type is WSMsgType.CLOSED
    assert (socket.pongs, taken, socket.closings) == ([b"alive"], [b"x"], [REFUSED])
    assert socket.texts[0].startswith('44{"message": "this server speaks msgpack')
    assert socket._autoping is False


async def test_who_is_admitted_stays_without_msgpack():
    socket, why = Socket(text("42[]")), list[str]()
    receive_directly(socket, {}, RateLimit(1000, on_drop=why.append, on_exceeded=pytest.fail))
    assert await socket.receive() is LAST
    assert (why, socket.closings) == (["packet without msgpack"], [])


@pytest.mark.parametrize("own", [True, False])
async def test_a_stranger_that_goes_on_is_cut_off(own):
    socket, closings = Socket(*[text("2x")] * 9), list[dict[str, Any]]()

    async def close(**reason):
        closings.append(reason)

    receive_directly(socket, {}, HandshakeLimit(), close if own else None)
    for _ in range(HANDSHAKE_MESSAGES):
        assert (await socket.receive()).data == "2x"
    assert (await socket.receive()).type is WSMsgType.CLOSED
    assert (closings, socket.closings) == (([CUT], []) if own else ([], [CUT]))


def test_messages_go_to_the_websocket_itself_if_the_library_shows_it():
    class Shown(aiohttp.ClientWebSocketResponse):
        def __init__(self): ...

        def get_extra_info(self, name, default=None):
            return default

    async def send(_): ...

    shown = SimpleNamespace(eio=SimpleNamespace(ws=Shown(), send=send))
    assert isinstance(client_send(shown), UnbufferedSend)
    for hidden in (SimpleNamespace(send=send), SimpleNamespace(ws=None, send=send)):
        assert client_send(SimpleNamespace(eio=hidden)) is send


def record(message, error):
    trace = None if error is None else (type(error), error, None)
    return logging.makeLogRecord({"msg": message, "args": (), "exc_info": trace})


def test_a_library_logs_a_trace_of_each_kind_a_second(monkeypatch):
    logger = logging.getLogger("mmt.link.wire")
    monkeypatch.setattr(logger, "filters", [])
    monkeypatch.setattr(logger, "level", logging.NOTSET)
    assert wire_logger() is wire_logger() is logger
    assert (logger.level, len(logger.filters)) == (logging.ERROR, 1)
    assert not logger.filter(record("a broken connection", None))
    failed = record("a failure", ValueError("x"))
    assert logger.filter(failed)
    assert (failed.getMessage(), failed.exc_info is None) == ("a failure", False)
    assert not logger.filter(record("a failure", ValueError("y")))
    malformed = record("a request", BadStatusLine("x"))
    assert logger.filter(malformed)
    assert malformed.getMessage() == "malformed request rejected: BadStatusLine"
    assert malformed.exc_info is None
