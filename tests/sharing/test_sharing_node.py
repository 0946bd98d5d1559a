"""A listener in another language: npm's stock socket.io-client under Node."""

import asyncio
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from sharing_samples import LONGEST_S, about, model_of, shared, until

from mmt.link.protocol import encode_event
from mmt.sharing.messages import STATE, STATE_DTYPE

PROGRAM = Path(__file__).with_name("stock_listener.cjs")
MODULES = Path(sys.prefix) / "node" / "node_modules"
NODE = shutil.which("node")

pytestmark = [
    pytest.mark.skipif(NODE is None, reason="Node is not installed"),
    pytest.mark.skipif(
        not (MODULES / "socket.io-msgpack-parser").is_dir(),
        reason=f"socket.io-client is not in {MODULES}: scripts/test puts it there by npm",
    ),
]


async def test_a_stock_client_under_node_follows_a_model_that_grows() -> None:
    async with shared() as sharing:
        process = await asyncio.create_subprocess_exec(
            *(str(NODE), str(PROGRAM), sharing.url, "9"),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "NODE_PATH": str(MODULES)},
        )
        await until(lambda: sharing.relay.listeners)
        (listener,) = sharing.relay.listeners.values()
        state = np.zeros(1, STATE_DTYPE)
        state["time_s"], state["force_n"], state["contact"] = 1.5, 0.75, 1
        sharing.relay.offer_state(encode_event(STATE, state.tobytes()))
        # the first change of an order brings all samples of the new one
        models = [model_of(6, order=8), *(model_of(count) for count in (6, 8, 9))]
        for number, model in enumerate(models, start=1):
            sharing.relay.offer_model(*sharing.publisher.publish(model, about(number)))
            await until(lambda: not listener.news.is_set())
        printed, complaints = await asyncio.wait_for(process.communicate(), LONGEST_S)
    assert process.returncode == 0, complaints.decode()
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
