"""A hub that has its most names the others, and listeners turn to them."""

import asyncio
from contextlib import AsyncExitStack

import pytest
import socketio
from sharing_samples import listening, refused, shared, until

from mmt_share.messages import SHARING_VERSION


async def test_a_listener_turns_from_a_full_hub_to_another():
    async with AsyncExitStack() as stack:
        full, other = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        await full.server.send_hubs(["rubbish", other.url])
        await stack.enter_async_context(listening(full.url))
        other.publish(10)
        heard = await stack.enter_async_context(listening(full.url))
        await until(lambda: heard.models)
        assert f"{full.url} is full: connected to {other.url}" in heard.said
        assert (len(full.said), len(other.said)) == (1, 1)


async def test_where_all_are_full_the_first_ones_refusal_is_told_at_once():
    async with AsyncExitStack() as stack:
        hubs = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        for one, another in (hubs, hubs[::-1]):
            await one.server.send_hubs([another.url])
            await stack.enter_async_context(listening(one.url))
        async with asyncio.timeout(4.0):  # each is asked once
            await refused(f"{hubs[0].url} refused: 1 are listening already", hubs[0].url)


async def test_a_listener_that_comes_back_to_a_full_hub_turns_to_another():
    async with AsyncExitStack() as stack:
        first, other = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        heard = await stack.enter_async_context(listening(first.url))
        first.server._welcome["hubs"] = [other.url]
        line = heard.client._connection.line
        line.drop()
        await until(lambda: len(first.said) == 2)  # it has left
        late = await stack.enter_async_context(listening(first.url, name="quicker"))
        await until(lambda: other.said and heard.client.connected)
        assert late.client.connected


@pytest.mark.parametrize("token", ["0123456789abcdef0123", "another0123456789abcd"])
async def test_a_stock_client_is_told_the_others_if_it_shows_the_token(token, monkeypatch):
    monkeypatch.setenv("MMT_SHARING_TOKEN", "0123456789abcdef0123")
    refusals = []
    async with shared(most=1) as full, listening(full.url):
        await full.server.send_hubs(["http://hub2.lab:8766"])
        stock = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        stock.on("connect_error", refusals.append)
        hello = {"sharing": SHARING_VERSION, "role": "listener", "token": token}
        with pytest.raises(socketio.exceptions.ConnectionError):
            await stock.connect(full.url, auth=hello, transports=["websocket"])
        await stock.disconnect()
    if token.startswith("0"):
        assert refusals[0]["message"].startswith("1 are listening already")
        assert refusals[0]["data"] == {"hubs": ["http://hub2.lab:8766"]}
    else:
        assert "data" not in refusals[0]
