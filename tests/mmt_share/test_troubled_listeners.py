"""Listeners that make trouble, as the experiment has them."""

import asyncio
import gc
import socket

import numpy as np
import pytest
from sharing_samples import listening, shared, until

from mmt_lab.sharing.long_session import STEADY, Memory, TroubledListeners


async def test_troubles_disturb_nobody():
    async with shared() as sharing, listening(sharing.url) as heard:
        sharing.publish(10)
        troubled = TroubledListeners(sharing.url, 1)
        running = asyncio.create_task(troubled.run(60.0))
        await until(lambda: len(sharing.relay.listeners) >= STEADY + 1)
        await asyncio.gather(*map(troubled.make, ("rubbish", "visits", "vanished")))
        sharing.publish(11)
        await until(lambda: heard.models[-1:] == [2])
        await asyncio.sleep(0.5)
        sharing.relay.finish("completed")
        found = await running
        assert heard.client.rejected == 0
    assert found["steady"] == STEADY
    assert all(found[kind] >= 1 for kind in ("rubbish", "visits", "vanished"))


@pytest.mark.parametrize("slope_mb_h", [0.0, 60.0])
def test_memory_that_grows_is_told(slope_mb_h):
    memory = Memory()
    rng = np.random.default_rng(3)
    for second in range(600):
        noise_mb = 0.1 * rng.standard_normal()
        memory.add("leader", float(second), 190.0 + slope_mb_h / 3600.0 * second + noise_mb)
    grown = memory.growth("leader")
    assert 3600.0 * grown.growth / grown.span_s == pytest.approx(slope_mb_h, abs=2.0)
    assert (grown.least_growth > 1.0) == (slope_mb_h > 0.0)
    assert memory.growth("sharing").typical is None


async def test_trouble_for_nobody_leaves_no_session_open(caplog):
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        await TroubledListeners(f"http://127.0.0.1:{nobody.getsockname()[1]}", 1).make("rubbish")
    gc.collect()
    assert "Unclosed" not in caplog.text
