"""The crowd of the experiment: what it finds of a model that is shared in this process."""

import asyncio

import pytest
from sharing_samples import shared, until

from mmt_lab.sharing.crowd import crowd


async def test_a_crowd_finds_the_model_and_each_change_of_it() -> None:
    async with shared() as sharing:
        sharing.publish(10)
        finding = asyncio.create_task(crowd(sharing.url, 5, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 5)
        sharing.publish(11)
        await until(lambda: sharing.relay.sent["changes"] == 5)
        sharing.relay.finish("completed")
        found = await finding
    assert [each.number for each in found] == [2] * 5
    assert [each.rejected for each in found] == [0] * 5
    for each in found:
        assert each.first_s is not None
        assert len(each.lags_ms) == 1
        assert 0.0 < each.lags_ms[0] < 1e4


@pytest.mark.parametrize("most", [2])
async def test_who_is_refused_says_why(most: int) -> None:
    async with shared(most=most) as sharing:
        sharing.publish(10)
        finding = asyncio.create_task(crowd(sharing.url, 3, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 2)
        await asyncio.sleep(0.5)
        sharing.relay.finish("completed")
        found = await finding
    assert ["listening already" in each.problem for each in found].count(True) == 1
