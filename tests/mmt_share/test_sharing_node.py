"""A listener in another language: npm's stock socket.io-client under Node."""

import asyncio
import json
from pathlib import Path

import numpy as np
from hub_samples import needs_redis, redis_server, serving
from node_programs import NEEDS_NODE, another_site, run_node, under_node
from sharing_samples import WELCOME, about, model_of, shared, until

PROGRAM = Path(__file__).with_name("stock_listener.cjs")

WELCOMED = {"sharing": 1, **WELCOME}

pytestmark = NEEDS_NODE


def models_given(listener):
    return listener.sent["wholes"] + listener.sent["changes"]


async def heard_under_node(sharing, url, relay):
    """What a client hears at this address, where this relay's listeners are, of a growing model."""
    running = asyncio.create_task(run_node(PROGRAM, url, 9))
    await until(lambda: relay.listeners or running.done())
    (listener,) = relay.listeners.values()
    sharing.offer_state(1.5, force_n=0.75)
    # the first change of an order brings all samples of the new one
    models = [model_of(6, order=8), *(model_of(count) for count in (6, 8, 9))]
    for number, model in enumerate(models, start=1):
        sharing.offer(model, about(number))
        await until(lambda number=number: models_given(listener) == number)
    code, printed, complaints = await running
    assert code == 0, complaints
    heard = json.loads(printed)
    assert heard["numbers"] == [1, 2, 3, 4]
    assert heard["file"] == "PK"
    assert heard["state"] == {"time_s": 1.5, "force_n": 0.75, "contact": 1}
    np.testing.assert_array_equal(heard["variances"], model_of(9).samples.variance)
    return heard


async def test_a_stock_client_under_node_follows_a_model_that_grows():
    async with shared() as sharing:
        heard = await heard_under_node(sharing, sharing.url, sharing.relay)
    assert heard["welcome"] == WELCOMED


@needs_redis
async def test_a_stock_client_under_node_follows_it_at_a_hub():
    with redis_server() as redis:
        async with shared() as sharing, serving(sharing.url, redis.url) as hub:
            await until(lambda: hub.hub.copy.session_id)
            heard = await heard_under_node(sharing, hub.url, hub.hub.relay)
    assert heard["welcome"] == {**WELCOMED, "hubs": []}


async def followed(sharing):
    """Share a model that grows and a state, and end; return what the documented listener says."""
    await until(lambda: sharing.relay.listeners)
    (listener,) = sharing.relay.listeners.values()
    sharing.offer_state(1.5, force_n=0.75, position_mm=(1.0, 2.0, 3.0))
    sharing.publish(6)
    await until(lambda: listener.sent["wholes"] == 1)
    sharing.publish(8)
    await until(lambda: listener.sent["wholes"] == 2)
    sharing.relay.finish("completed")
    size, grown = (len(model_of(count).to_bytes()) for count in (6, 8))
    said = about(1).completion
    return [
        f"session {WELCOME['name']}",
        "1.50 s: 1.0,2.0,3.0 mm, 0.75 N",
        f"model 1: 6 samples, {size} bytes, {said}",
        f"model 2: 8 samples, {grown} bytes, {said}",
        "completed",
    ]


async def test_the_documented_listener_follows_from_node(tmp_path):
    async with shared() as sharing:
        running = asyncio.create_task(run_node(under_node(tmp_path, "A listener", sharing.url, "")))
        expected = await followed(sharing)
        code, printed, complaints = await running
    assert (code, complaints) == (0, "")
    assert sorted(printed.splitlines()) == sorted(expected)


async def test_the_documented_listener_follows_from_a_page_of_another_site(tmp_path):
    async with another_site(tmp_path) as (settings, show), shared(**settings) as sharing:
        _, said = await show(sharing.url, "A listener")
        expected = await followed(sharing)
        await until(lambda: "completed" in said)
    assert sorted(said) == sorted(expected)
