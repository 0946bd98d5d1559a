import asyncio
import time
from contextlib import asynccontextmanager

import aiohttp
import numpy as np
import pytest
from link_samples import (
    CHANNELS,
    FollowerNotes,
    LeaderNotes,
    commands,
    frames,
    hello,
    until,
)

import mmt.core.running.loop_timer
from mmt.link.client import FollowerClient
from mmt.link.emulated.network import EmulatedNetwork, EmulatedSendQueue
from mmt.link.protocol import encode_event
from mmt.link.server import LeaderServer
from mmt.scene import Link, Network


class Sent:
    """Notes each message and when it went out."""

    def __init__(self):
        self.messages = []
        self.times_ns = []

    async def __call__(self, message):
        self.messages.append(message)
        self.times_ns.append(time.monotonic_ns())


@asynccontextmanager
async def outbox(capacity=50, **table):
    box, sent = EmulatedSendQueue(capacity, Network(**table), seed=1), Sent()
    box.open(sent)
    try:
        yield box, sent
    finally:
        box.close()


@pytest.fixture(params=["timerfd", "call_at"])
def timers(request, monkeypatch):
    if request.param == "call_at":
        monkeypatch.setattr(mmt.core.running.loop_timer, "open_timer", lambda: None)
    elif (timer := mmt.core.running.loop_timer.open_timer()) is None:
        pytest.skip("this system has no timerfd")
    else:
        timer.close()


@pytest.mark.usefixtures("timers")
async def test_messages_are_held_for_their_delay_and_in_order():
    async with outbox(delay_ms=20, jitter_ms=10) as (box, sent):
        put_ns = []
        for index in range(50):
            put_ns.append(time.monotonic_ns())
            box.put(1, bytes([index]))
            await asyncio.sleep(0.001)
        await until(lambda: len(sent.messages) == 50)
    assert sent.messages == [bytes([index]) for index in range(50)]
    delays_ms = (np.array(sent.times_ns) - np.array(put_ns)) / 1e6
    assert delays_ms.min() >= 9.0  # a loop's timer may be early by its clock's resolution
    assert np.median(delays_ms) < 200.0


async def test_an_empty_table_sends_at_once():
    async with outbox() as (box, sent):
        box.put(1, b"now")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert sent.messages == [b"now"]


async def test_a_clump_larger_than_the_queue_goes_out_whole():
    async with outbox(capacity=50, delay_ms=30) as (box, sent):
        for index in range(500):
            box.put(1, index.to_bytes(2))
        await until(lambda: len(sent.messages) == 500)
        assert box.dropped == 0
    assert sent.messages == [index.to_bytes(2) for index in range(500)]


async def test_losses_and_repetitions_are_counted():
    async with outbox(loss=0.2, duplicate=0.3) as (box, sent):
        for _ in range(1000):
            box.put(1, b"message")
            await asyncio.sleep(0)
        await until(lambda: box.records == 1000 - box.emulated["lost"])
        counts = box.emulated
        assert counts["messages"] == 1000
        assert 100 < counts["lost"] < 300
        assert 150 < counts["repeated"] < 350
        await until(lambda: len(sent.messages) == 1000 - counts["lost"] + counts["repeated"])


async def test_the_end_waits_for_what_is_held():
    async with outbox(capacity=5, delay_ms=100) as (box, sent):
        for _ in range(30):
            box.put(1, b"message")
        await box.finish(5.0)
    assert len(sent.messages) == 30


async def test_the_end_waits_no_longer_than_it_may():
    async with outbox(delay_ms=1000) as (box, sent):
        box.put(1, b"message")
        began_s = time.monotonic()
        await box.finish(0.05)
        assert time.monotonic() - began_s < 0.9
        assert box.emulated["lost"] == 1
    assert sent.messages == []


async def test_what_is_held_when_the_link_breaks_never_comes():
    async with outbox(delay_ms=20) as (box, sent):
        box.put(1, b"old")
        box.open(sent)
        box.put(1, b"new")
        await until(lambda: sent.messages)
        await asyncio.sleep(0.03)
    assert sent.messages == [b"new"]
    assert box.emulated["lost"] == 1


async def test_a_change_holds_for_what_is_put_afterwards():
    async with outbox(loss=1.0) as (box, sent):
        box.put(1, b"lost")
        box.change(Network(delay_ms=1), seed=2)
        box.put(1, b"sent")
        await until(lambda: sent.messages)
    assert sent.messages == [b"sent"]


# --- both sides, and the leader's HTTP interface


class Linked:
    """A leader and a follower with an emulated network, and what they were told."""

    def __init__(self, **table):
        self.said = []
        self.up, self.down = LeaderNotes(), FollowerNotes()
        self.leads = EmulatedNetwork(Network(**table), "down", 1, self.said.append)
        self.follows = EmulatedNetwork(Network(**table), "up", 1, self.said.append)

    async def __aenter__(self):
        self.server = LeaderServer(Link(port=0), CHANNELS, self.up.events(), network=self.leads)
        await self.server.start()
        self.url = f"http://127.0.0.1:{self.server.port}"
        self.client = FollowerClient(self.url, hello(), self.down.events(), network=self.follows)
        await self.client.connect(10.0)
        await until(lambda: self.server.can_send)
        self.http = aiohttp.ClientSession()
        return self

    async def __aexit__(self, *_):
        await self.http.close()
        await self.client.disconnect()
        await self.server.stop()

    async def put(self, **what):
        async with self.http.put(f"{self.url}/network", **what) as response:
            return response.status, await response.json()


async def test_both_directions_are_emulated_and_the_readers_count():
    async with Linked(loss=0.3, duplicate=0.3, delay_ms=10, jitter_ms=10, reorder=True) as link:
        for sequence in range(300):
            link.client.send_frames(frames(sequence))
            link.server.send_commands(commands(sequence))
            await asyncio.sleep(0.001)
        await link.client.end("enough")
        await until(lambda: link.up.ends)
        above, below = link.server.statistics, link.client.statistics
    for statistics in (above, below):
        assert statistics.emulated["messages"] == 300
        assert statistics.emulated["lost"] > 0
        assert statistics.repeated > 0
        assert statistics.out_of_order > 0
    # the leader heard the end: from the first that came, each frame is accepted, late, or lost
    before = link.up.sequences[0]
    assert above.frames + above.lost == 300 - before
    assert above.lost == below.emulated["lost"] + above.out_of_order - before
    assert link.up.sequences == sorted(set(link.up.sequences))


async def test_one_direction_alone():
    async with Linked(loss=1.0, direction="up") as link:
        for sequence in range(20):
            link.client.send_frames(frames(sequence))
            link.server.send_commands(commands(sequence))
        await until(lambda: len(link.down.sequences) == 20)
        assert link.client.statistics.emulated == {"messages": 20, "lost": 20, "repeated": 0}
        assert link.server.statistics.emulated == {"messages": 20, "lost": 0, "repeated": 0}


async def test_a_program_reads_and_replaces_the_settings_on_both_sides():
    async with Linked(profile="wifi") as link:
        async with link.http.get(f"{link.url}/network") as response:
            assert await response.json() == Network(profile="wifi").model_dump(mode="json")
        status, answer = await link.put(json={"profile": "bad", "loss": 0.5, "seed": 3})
        assert status == 200
        wanted = Network(profile="bad", loss=0.5, seed=3)
        assert answer == wanted.model_dump(mode="json")
        assert link.leads.settings == wanted
        await until(lambda: link.follows.settings == wanted)
    assert len(link.said) == 2
    assert link.said[0] == ("emulated network: delay 150 +- 60 ms, 0.5 lost in bursts of 10")


async def test_a_follower_that_comes_later_hears_of_the_change():
    link = Linked()
    link.leads.change({"profile": "lan"})
    async with link:
        await until(lambda: link.follows.settings == Network(profile="lan"))


@pytest.mark.parametrize(
    ("what", "problem"),
    [
        ({"json": {"delay_ms": -1}}, "[network]: delay_ms is -1"),
        ({"json": {"delay": 1}}, "delay is not a key; allowed are profile, direction, delay_ms"),
        ({"json": [1]}, "[network]: [1]"),
        ({"json": {"delay_ms": 1, "jitter_ms": 2}}, "jitter_ms must not exceed delay_ms"),
        ({"data": b"{", "headers": {"Content-Type": "application/json"}}, "no JSON"),
        ({"data": b"[" * 4000, "headers": {"Content-Type": "application/json"}}, "no JSON"),
        ({"data": b" " * 5000, "headers": {"Content-Type": "application/json"}}, "longer than"),
        ({"data": b"{}", "headers": {"Content-Type": "text/plain"}}, "Content-Type"),
    ],
)
async def test_wrong_settings_are_refused_with_a_sentence(what, problem):
    async with Linked() as link:
        status, answer = await link.put(**what)
        assert status == 400
        assert problem in answer["error"]
        assert link.leads.settings == Network()


@pytest.mark.parametrize("payload", [None, 3, {"delay_ms": "x"}, {"unknown": 1}, [{}]])
async def test_a_malformed_event_changes_nothing_and_is_counted(payload):
    async with Linked(profile="lan") as link:
        link.server.endpoint.outbox.put(0, encode_event("network", payload))
        await until(lambda: link.client.statistics.rejected)
        assert link.client.statistics.rejected == {"malformed network": 1}
        assert link.follows.settings == Network(profile="lan")


async def test_without_the_table_there_is_nothing_to_change():
    server = LeaderServer(Link(port=0), CHANNELS, LeaderNotes().events())
    await server.start()
    try:
        async with (
            aiohttp.ClientSession() as http,
            http.get(f"http://127.0.0.1:{server.port}/network") as response,
        ):
            assert response.status == 404
    finally:
        await server.stop()


async def test_back_fill_waits_while_the_emulated_bandwidth_is_taken():
    async with outbox(bandwidth_kbit_s=80) as (box, sent):
        assert box.idle
        box.put(1, bytes(1000))  # takes 100 ms
        assert not box.idle
        await until(lambda: sent.messages)
        await until(lambda: box.idle)


async def test_settings_that_arrive_in_two_segments_are_taken_and_late_ones_refused(monkeypatch):
    monkeypatch.setattr(mmt.link.emulated.network, "HANDSHAKE_S", 0.5)
    network = EmulatedNetwork(Network(), "down", 1, lambda _: None)
    server = LeaderServer(Link(port=0), CHANNELS, LeaderNotes().events(), network=network)
    await server.start()
    try:
        for rest, status in ((b"15}", b"200"), (b"", b"400")):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(
                b"PUT /network HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
                b'Content-Length: 16\r\n\r\n{"delay_ms": '
            )
            await asyncio.sleep(0.1)
            writer.write(rest)
            async with asyncio.timeout(5):
                assert (await reader.readline()).split()[1] == status
            writer.close()
    finally:
        await server.stop()
    assert network.settings.delay_ms == 15


async def test_what_is_under_way_at_the_end_is_lost_once_and_repeated_by_nobody():
    async with outbox(delay_ms=1000, jitter_ms=1, duplicate=0.5) as (box, sent):
        for index in range(40):
            box.put(1, bytes([index]))
        assert box.emulated["repeated"] > 5
    assert sent.messages == []
    assert box.emulated == {"messages": 40, "lost": 40, "repeated": 0}
