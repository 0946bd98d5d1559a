"""Hubs with a Redis server of their own: one, two, and what happens as each of them is lost."""

import asyncio
import signal
import time
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace

import pytest
import trustme
from hub_samples import free_port, hub_process, needs_redis, redis_server, serving
from sharing_samples import ENDED, about, listening, model_of, refused, shared, until

from mmt.core.errors import MmtError
from mmt.texture.model.file import arrays_of
from mmt_share.changes import digest
from mmt_share.hub import peers
from mmt_share.hub.channel import FORBIDDEN, HubChannel

pytestmark = needs_redis


@pytest.fixture
def redis():
    with redis_server() as server:
        yield server


@pytest.fixture
def alone(redis, monkeypatch):
    """A Redis server for one hub, which has no beats of others to wait for."""
    monkeypatch.setattr(peers, "FIRST_S", 0.0)
    return redis


def is_model_of(heard, count):
    """Whether a listener has this model to the bit."""
    replica = heard.client.replica
    if replica.about != about(count):
        return False
    one, other = (digest(arrays_of(each.contents)) for each in (replica.build(), model_of(count)))
    return one == other


@asynccontextmanager
async def hubs_of_a_model(redis, count=2):
    """A leader with a model, hubs of it, and a listener at each, which has the model."""
    async with AsyncExitStack() as stack:
        leader = await stack.enter_async_context(shared())
        leader.publish(10)
        enter = stack.enter_async_context
        hubs = [await enter(serving(leader.url, redis.url)) for _ in range(count)]
        heard = [await enter(listening(hub.url)) for hub in hubs]
        await until(lambda: all(is_model_of(each, 10) for each in heard))
        yield leader, hubs, heard


async def test_a_hub_gives_its_listeners_what_the_leader_shares(alone):
    async with shared() as leader, serving(leader.url, alone.url) as hub:
        leader.publish(10)
        await until(lambda: hub.hub.copy.number)
        async with listening(hub.url) as heard:
            await until(lambda: is_model_of(heard, 10))
            for count in (11, 14):
                leader.publish(count)
                await until(lambda count=count: is_model_of(heard, count))
            assert heard.models == [1, 2, 3]
            assert (heard.client.wholes, heard.client.changes) == (1, 2)
            assert heard.client.session["session_id"] == "abc"
            leader.offer_state(0.75)
            await until(lambda: heard.states[-1:] == [0.75])
            async with listening(hub.url) as late:
                await until(lambda: is_model_of(late, 14))
                assert (late.client.wholes, late.client.changes) == (1, 0)
            leader.relay.finish("completed")
            await until(lambda: ENDED in heard.said)
        assert leader.server.figures()["listeners"] == 1


async def test_the_leader_has_one_listener_however_many_hubs_there_are(redis):
    async with hubs_of_a_model(redis, 3) as (leader, hubs, heard):
        await until(lambda: [hub.hub.feeding for hub in hubs] == [True, False, False])
        leader.publish(12)
        await until(lambda: all(is_model_of(each, 12) for each in heard))
        assert len(leader.said) == 1
        others = [{hub.url for hub in hubs} - {each.url} for each in hubs]
        await until(lambda: [set(each.client.hubs) for each in heard] == others)


async def test_a_feeder_that_is_killed_is_replaced_and_its_listeners_find_another_hub(redis):
    async with AsyncExitStack() as stack:
        enter = stack.enter_async_context
        leader = await enter(shared())
        leader.publish(10)
        first, first_url = await enter(hub_process(leader.url, redis.url))
        await until(lambda: "listener hub joined, 1 listening" in leader.said)
        _, second_url = await enter(hub_process(leader.url, redis.url))
        of_first = await enter(listening(first_url, name="a"))
        of_second = await enter(listening(second_url, name="b"))
        await until(lambda: of_first.client.hubs == [second_url])
        await until(lambda: of_second.client.hubs == [first_url])
        await until(lambda: is_model_of(of_first, 10) and is_model_of(of_second, 10))
        killed_s = time.monotonic()
        first.send(signal.SIGKILL)
        await until(lambda: leader.said.count("listener hub joined, 1 listening") == 2)
        assert time.monotonic() - killed_s < 3.5
        leader.publish(12)
        await until(lambda: is_model_of(of_first, 12) and is_model_of(of_second, 12))
        assert leader.server.figures()["listeners"] == 1


async def test_another_session_of_the_leader_is_followed(redis):
    port = free_port()
    async with AsyncExitStack() as stack:
        async with shared(port=port) as leader:
            for count in (10, 11, 12):
                leader.publish(count)
            hubs = [
                await stack.enter_async_context(serving(leader.url, redis.url)) for _ in range(2)
            ]
            heard = [await stack.enter_async_context(listening(hub.url)) for hub in hubs]
            await until(lambda: all(is_model_of(each, 12) for each in heard))
            leader.relay.finish("completed")
        async with shared(port=port) as again:
            await again.server.welcome(session_id="def")
            for count in (5, 6, 20):  # with the number that the earlier session ended by
                said = replace(about(count), session_id="def")
                again.offer(model_of(count), said)
            for each in heard:
                await until(lambda each=each: each.client.replica.about == said)
                assert each.client.session["session_id"] == "def"
            again.relay.finish("completed")
            await until(lambda: all(each.said.count(ENDED) == 2 for each in heard))


async def test_hubs_go_on_alone_while_redis_is_lost_and_together_when_it_is_back(redis):
    async with hubs_of_a_model(redis) as (leader, hubs, heard):
        redis.kill()
        await until(lambda: all("Redis is lost" in "".join(hub.said) for hub in hubs))
        leader.publish(11)
        await until(lambda: all(is_model_of(each, 11) for each in heard))
        assert all(hub.hub.feeding for hub in hubs)
        redis.start()
        await until(lambda: all("Redis is back" in hub.said for hub in hubs))
        await until(lambda: [hub.hub.feeding for hub in hubs] == [True, False])
        leader.publish(12)
        await until(lambda: all(is_model_of(each, 12) for each in heard))


async def test_a_change_that_redis_loses_is_noticed(redis, monkeypatch):
    async with hubs_of_a_model(redis) as (leader, hubs, heard):
        with monkeypatch.context() as lost:
            lost.setattr(hubs[1].hub.copy, "receive", lambda *_: None)
            leader.publish(11)  # and then nothing more: only the beats tell that it was there
            await until(lambda: hubs[0].hub.copy.number == 2)
            await asyncio.sleep(0.2)
        await until(lambda: is_model_of(heard[1], 11))


async def test_without_redis_the_hub_says_how_to_start_it(redis):
    redis.kill()
    with pytest.raises(MmtError, match=r"no Redis server answers .*apt install redis-server"):
        async with serving("http://127.0.0.1:9", redis.url):
            pass


async def test_a_hub_that_is_refused_says_why(alone, monkeypatch):
    monkeypatch.setenv("MMT_SHARING_TOKEN", "0123456789abcdef0123")
    async with shared() as leader:
        monkeypatch.setenv("MMT_SHARING_TOKEN", "another0123456789abcd")
        async with serving(leader.url, alone.url) as hub:
            await hub.ends_by("give the listener the leader's token")


async def test_listeners_of_a_hub_show_its_token_and_are_no_more_than_it_allows(redis, monkeypatch):
    async with shared() as leader:
        monkeypatch.setenv("MMT_SHARING_TOKEN", "0123456789abcdef0123")
        async with serving(leader.url, redis.url, sharing={"most": 1}) as hub:
            async with listening(hub.url):
                await refused("1 are listening already", hub.url)
            monkeypatch.setenv("MMT_SHARING_TOKEN", "")
            await refused("give the listener the leader's token", hub.url)


async def test_a_wrong_password_of_redis_is_called_so():
    with redis_server("--requirepass", "right") as guarded:
        address = guarded.url.removeprefix("redis://")
        for url in (guarded.url, f"redis://:wr0ng@{address}", f"redis://ann:wr0ng@{address}"):
            channel = HubChannel(url, "group", pytest.fail)
            with pytest.raises(MmtError, match="refuses the user or the password") as caught:
                await channel.require()
            assert "wr0ng" not in str(caught.value)
            await channel.close()
        channel = HubChannel(f"redis://:right@{address}", "group", pytest.fail)
        await channel.require()
        await channel.close()


ALLOWED = "+publish +subscribe +unsubscribe"  # what docs/how-to/hubs.md allows


@pytest.mark.parametrize(
    ("rules", "problem"),
    [
        (f"&mmt-hubs* {ALLOWED}", None),
        (f"&others* {ALLOWED}", FORBIDDEN),
        ("&mmt-hubs* +publish +ping", FORBIDDEN),
        ("&mmt-hubs* +subscribe +unsubscribe +ping", FORBIDDEN),
    ],
)
async def test_a_channel_that_redis_forbids_is_said_and_the_documented_rules_suffice(
    rules, problem
):
    user = f"hub on >right resetchannels {rules}"
    with redis_server("--user", *user.split()) as guarded:
        url = f"redis://hub:right@127.0.0.1:{guarded.port}"
        heard = []
        channels = [HubChannel(url, "g", lambda event, _: heard.append(event)) for _ in range(2)]
        assert await channels[0].check() == problem
        if problem is None:
            assert await channels[0].check() is None, "as once a second"
            await channels[1].require()
            for channel in channels:
                channel.start()
            await asyncio.sleep(0.5)
            await channels[0].publish("beat", {})
            await until(lambda: len(heard) == 2)
        else:
            with pytest.raises(MmtError, match=r"forbids this user the channel .*: allow it &mmt"):
                await channels[1].require()
        for channel in channels:
            await channel.close()


async def test_a_certificate_that_is_not_trusted_is_called_so(tmp_path):
    authority, port = trustme.CA(), free_port()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(
        tmp_path / "redis.pem"
    )
    files = {"cert": "redis.pem", "key": "redis.pem", "ca-cert": "ca.pem"}
    options = [part for k, v in files.items() for part in (f"--tls-{k}-file", str(tmp_path / v))]
    with redis_server("--tls-port", str(port), "--tls-auth-clients", "no", *options):
        channel = HubChannel(f"rediss://127.0.0.1:{port}", "group", pytest.fail)
        with pytest.raises(MmtError, match="certificate is not trusted: name the authority"):
            await channel.require()
        await channel.close()
        trusting = f"rediss://127.0.0.1:{port}?ssl_ca_certs={tmp_path / 'ca.pem'}"
        channel = HubChannel(trusting, "group", pytest.fail)
        await channel.require()
        await channel.close()
