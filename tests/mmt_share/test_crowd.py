"""The crowd of the experiment: what it finds of a model that is shared in this process."""

import asyncio

from sharing_samples import about, model_of, shared, until

from mmt.texture.model.file import arrays_of
from mmt_lab.sharing.counting import run_listeners
from mmt_lab.sharing.session import crowd
from mmt_share.changes import digest


async def test_a_crowd_finds_the_ready_model_and_each_change_of_it():
    async with shared() as sharing:
        sharing.publish(9, ready=False)
        finding = asyncio.create_task(crowd(sharing.url, 20, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 1)
        sharing.publish(10)
        await until(lambda: sharing.relay.sent["wholes"] == 21)
        sharing.publish(11)
        await until(lambda: sharing.relay.sent["changes"] >= 20)
        sharing.relay.finish("completed")
        found = await finding
    assert [each.number for each in found] == [3] * 20
    assert [each.rejected for each in found] == [0] * 20
    for each in found:
        assert each.first_s is not None
        assert not each.problem
        assert len(each.lags_ms) == 1
        assert 0.0 < each.lags_ms[0] < 1e4


async def test_listeners_that_count_have_the_digest_of_the_last_model():
    async with shared() as sharing:
        sharing.publish(10)
        counting = asyncio.create_task(run_listeners(sharing.url, 4, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 4)
        for size in (11, 14):
            sharing.publish(size)
            sharing.offer_state(0.1 * size)
            await until(lambda size=size: sharing.relay.sent["states"] == 4 * (1 + (size > 11)))
        sharing.relay.finish("completed")
        found = await counting
    expected = digest(arrays_of(model_of(14).contents)).hex()
    assert [(each.number, each.digest) for each in found] == [(3, expected)] * 4
    assert [(each.wholes, each.changes, each.states) for each in found] == [(1, 2, 2)] * 4
    assert all(len(each.lags_ms) == 2 and not each.rejected for each in found)


async def test_a_listener_that_counts_misses_no_gap():
    async with shared() as sharing:
        sharing.publish(10)
        counting = asyncio.create_task(run_listeners(sharing.url, 1, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 1)
        sharing.publisher.publish(model_of(11), about(11))  # which nobody gets
        number, whole, change = sharing.publisher.publish(model_of(12), about(12))
        sharing.relay.number = 2  # so that the change seems to follow
        for listener in sharing.relay.listeners.values():
            listener._number = 2
        sharing.relay.offer_model(number, whole, change)
        await until(lambda: sharing.relay.sent["wholes"] == 2)
        sharing.relay.finish("completed")
        (found,) = await counting
    assert (found.number, found.rejected) == (3, 1)
    assert found.digest == digest(arrays_of(model_of(12).contents)).hex()


async def test_who_is_refused_says_why():
    async with shared(most=2) as sharing:
        sharing.publish(10)
        finding = asyncio.create_task(run_listeners(sharing.url, 3, 20.0))
        await until(lambda: sharing.relay.sent["wholes"] == 2)
        await asyncio.sleep(0.5)
        sharing.relay.finish("completed")
        found = await finding
    assert ["listening already" in each.problem for each in found].count(True) == 1


async def test_a_session_without_a_model_is_the_crowds_problem_and_nobody_waits_for_ever():
    async with shared() as sharing:
        (found,) = await crowd(sharing.url, 1, 0.5)
        assert found.problem == "no model was ready within 0.5 s"
        finding = asyncio.create_task(crowd(sharing.url, 2, 20.0))
        await until(lambda: sharing.relay.listeners)
        sharing.relay.finish("completed")
        found = await finding
    assert [each.problem for each in found] == ["the session ended before its model was ready"] * 2
