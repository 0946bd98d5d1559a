"""A network that stalls holds back little: what waits, waits where it can be given up."""

import asyncio

import pytest
from aiohttp import ClientSession, ClientWSTimeout, web

from mmt.link import queue
from mmt.link.queue import SendQueue, UnbufferedSend

SOON = ClientWSTimeout(ws_close=0.1)
"""The other side reads nothing, the closing neither."""


@pytest.fixture
async def stalled() -> object:
    """The address of a server that takes WebSocket connections and reads nothing more."""
    reading = asyncio.Event()

    async def hold(request: web.Request) -> web.WebSocketResponse:
        websocket = web.WebSocketResponse()
        await websocket.prepare(request)
        assert request.transport is not None
        request.transport.pause_reading()  # type: ignore[attr-defined]
        await reading.wait()
        return websocket

    application = web.Application()
    application.router.add_get("/", hold)
    runner = web.AppRunner(application, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    yield f"http://127.0.0.1:{runner.addresses[0][1]}/"
    reading.set()
    await runner.cleanup()


async def test_what_a_stalled_network_does_not_take_waits_in_the_outbox(stalled: str) -> None:
    async with ClientSession() as session, session.ws_connect(stalled, timeout=SOON) as websocket:
        outbox = SendQueue(5)
        outbox.open(UnbufferedSend(websocket))
        for _ in range(100_000):
            outbox.put(1, bytes(1000))
            if outbox.dropped > 100:
                break
            await asyncio.sleep(0)
        assert outbox.dropped > 100
        transport = queue._transport_of(websocket)  # what aiohttp hides
        assert transport is not None
        assert transport.get_write_buffer_size() < 10_000
        outbox.close()


async def test_a_websocket_that_hides_what_it_writes_to_is_used_as_it_is(
    stalled: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(queue, "_transport_of", lambda _: None)
    async with ClientSession() as session, session.ws_connect(stalled, timeout=SOON) as websocket:
        await UnbufferedSend(websocket)(b"message")
