"""A network that stalls holds back little: what waits, waits where it can be given up."""

import asyncio
import socket

import pytest
from aiohttp import ClientSession, ClientWSTimeout, web
from link_samples import until

from mmt.link import queue
from mmt.link.queue import SendQueue, UnbufferedSend

SOON = ClientWSTimeout(ws_close=0.1)
"""The other side reads nothing, the closing neither."""


class Stalled:
    """A server that takes WebSocket connections, but reads nothing until it is let."""

    def __init__(self):
        self.reading = asyncio.Event()
        self.received = []
        self.url = ""

    async def hold(self, request):
        websocket = web.WebSocketResponse()
        await websocket.prepare(request)
        request.transport.pause_reading()
        await self.reading.wait()
        request.transport.resume_reading()
        async for message in websocket:
            self.received.append(message.data)
        return websocket


@pytest.fixture
async def stalled():
    server = Stalled()
    application = web.Application()
    application.router.add_get("/", server.hold)
    runner = web.AppRunner(application, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    server.url = f"http://127.0.0.1:{runner.addresses[0][1]}/"
    yield server
    server.reading.set()
    await runner.cleanup()


async def test_what_a_stalled_network_does_not_take_waits_in_the_outbox_until_it_does(stalled):
    async with (
        ClientSession() as session,
        session.ws_connect(stalled.url, timeout=SOON) as websocket,
    ):
        outbox, sent = SendQueue(5), []
        outbox.open(UnbufferedSend(websocket))
        if (option := getattr(socket, "TCP_NOTSENT_LOWAT", None)) is not None:
            connection = websocket.get_extra_info("socket")
            assert connection.getsockopt(socket.IPPROTO_TCP, option) == queue.UNSENT_BYTES
        while outbox.dropped < 100:
            sent.append(len(sent).to_bytes(4) * 250)
            outbox.put(1, sent[-1])
            await asyncio.sleep(0)
        transport = queue._transport_of(websocket)  # what aiohttp hides
        assert transport.get_write_buffer_size() < 10_000
        stalled.reading.set()
        await outbox.flush(5.0)
        assert outbox.idle
        await until(lambda: len(stalled.received) == len(sent) - 100)
        assert stalled.received == [*sent[:-105], *sent[-5:]]
        outbox.close()


async def test_a_websocket_that_hides_what_it_writes_to_is_used_as_it_is(stalled, monkeypatch):
    monkeypatch.setattr(queue, "_transport_of", lambda _: None)
    async with (
        ClientSession() as session,
        session.ws_connect(stalled.url, timeout=SOON) as websocket,
    ):
        await UnbufferedSend(websocket)(b"message")
