"""A listener in another language: npm's stock socket.io-client under Node."""

import asyncio
import json
from pathlib import Path

import numpy as np
from node_programs import NEEDS_NODE, run_node
from sharing_samples import about, model_of, shared, until

PROGRAM = Path(__file__).with_name("stock_listener.cjs")

pytestmark = NEEDS_NODE


async def test_a_stock_client_under_node_follows_a_model_that_grows() -> None:
    async with shared() as sharing:
        running = asyncio.create_task(run_node(PROGRAM, sharing.url, 9))
        await until(lambda: sharing.relay.listeners)
        (listener,) = sharing.relay.listeners.values()
        sharing.offer_state(1.5, force_n=0.75)
        # the first change of an order brings all samples of the new one
        models = [model_of(6, order=8), *(model_of(count) for count in (6, 8, 9))]
        for number, model in enumerate(models, start=1):
            sharing.offer(model, about(number))
            await until(lambda: not listener.news.is_set())
        code, printed, complaints = await running
    assert code == 0, complaints
    heard = json.loads(printed)
    assert heard["welcome"] == {
        "sharing": 1,
        "session_id": "abc",
        "name": "a table",
        "rate_hz": 1000,
    }
    assert heard["numbers"] == [1, 2, 3, 4]
    assert heard["file"] == "PK"
    assert heard["state"] == {"time_s": 1.5, "force_n": 0.75, "contact": 1}
    np.testing.assert_array_equal(heard["variances"], model_of(9).samples.variance)
