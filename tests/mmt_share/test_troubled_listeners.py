"""Listeners that come and go, vanish, and send rubbish, beside one that stays."""

import asyncio
import random
from contextlib import suppress
from dataclasses import replace

import aiohttp
import psutil
import socketio
from service_runs import LONGEST_S, Together, small_scene
from sharing_samples import about, listening, shared, until

from mmt.link.protocol import encode_event
from mmt_lab.harness.proxy import Proxy
from mmt_share.client import ListenerClient
from mmt_share.messages import MODEL, SHARING_VERSION
from mmt_share.tables import Listening


async def vanish(url):
    """Join, and lose the connection without a goodbye."""
    async with Proxy(int(url.rpartition(":")[2])) as proxy:
        client = ListenerClient(Listening(url=f"http://127.0.0.1:{proxy.port}"))
        try:
            await client.connect()
            proxy.cut()
        finally:
            await client.close()


async def visit(url):
    """Join, and leave."""
    client = ListenerClient(Listening(url=url))
    await client.connect()
    await client.close()


async def send_rubbish(url, seed):
    """Join as a listener does, and send what makes no sense until the connection is closed."""
    rng = random.Random(seed)
    name = "\x1b[31mrubbish" + 99 * "x"
    hello = {"sharing": SHARING_VERSION, "role": "listener", "name": name}
    async with aiohttp.ClientSession() as http:
        client = socketio.AsyncClient(serializer="msgpack", reconnection=False, http_session=http)
        await client.connect(url, auth=hello, transports=["websocket"])
        try:
            for _ in range(2000):
                event = rng.choice(["again", "have", "frames", ""])
                rubbish = rng.choice([rng.randbytes(rng.randrange(5000)), {"a": [1, b"x"]}])
                with suppress(socketio.exceptions.SocketIOError):
                    await client.emit(event, rubbish)
                if not client.connected:
                    break
                await asyncio.sleep(0.002)
        finally:
            await client.disconnect()


async def test_troubles_disturb_nobody():
    async with shared() as sharing, listening(sharing.url) as heard:
        sharing.publish(10)
        url = sharing.url
        await asyncio.gather(*(send_rubbish(url, seed) for seed in (1, 2)), visit(url), vanish(url))
        sharing.publish(11)
        await until(lambda: heard.models[-1:] == [2])
        assert heard.client.rejected == 0
        await until(lambda: len(sharing.relay.listeners) == 1)
        sharing.offer_state(0.5)
        await until(lambda: heard.states == [0.5])
        assert sharing.relay.sent["states"] == 1  # who has gone is served no more
        ends = [each["listener"] for each in sharing.details if "left" in each["kind"]]
        assert any("it sent more than 10 messages" in each["why"] for each in ends)
        assert max(each["rejected"] for each in ends) > 0
        assert "\x1b" not in "".join(sharing.said)


async def test_a_model_that_cannot_be_read_is_told_once_and_the_next_one_is_taken():
    async with shared() as sharing, listening(sharing.url) as heard:
        for number in (1, 2):
            broken = {**vars(replace(about(3), number=number)), "file": b"of another release"}
            sharing.relay.offer_model(number, encode_event(MODEL, broken), None)
            await until(lambda number=number: heard.client.rejected >= number)
        await asyncio.sleep(0.3)
        assert heard.client.rejected == 2
        assert len([said for said in heard.said if "cannot be taken" in said]) == 1
        for _ in range(3):
            sharing.publish(10)
        sharing.publish(11)
        await until(lambda: heard.models)
        assert heard.client.replica.number == 4


async def test_a_process_for_listeners_that_is_killed_ends_the_sharing_and_nothing_else(tmp_path):
    tables = {"texture": {}, "rendering": {}, "sharing": {"port": 0}}
    together = await Together.listening(
        small_scene(tmp_path, session={"duration_s": 4.0}, **tables)
    )
    following = asyncio.create_task(together.follow())
    async with asyncio.timeout(LONGEST_S):
        await until(lambda: any(said.startswith("shared at") for said in together.said))
        for child in psutil.Process().children():
            if "mmt_share.process" in child.cmdline():
                child.kill()
        await until(together.leader.health.faults)
        assert together.leader.status().more["listeners"] == 0
        await following
    summary = await together.end()
    said = "the process that shares the model has ended: the session goes on without it"
    assert together.said.count(said) == 1
    assert (summary.outcome, summary.problem) == ("completed", None)
    assert summary.link["frames"] == summary.recording["frames"] >= 4000
