import asyncio
import time
from contextlib import asynccontextmanager

import aiohttp
import numpy as np
import pytest
from link_samples import (
    commands,
    follower,
    frames,
    leader,
    linked,
    until,
)

import mmt.core.running.ticking
from mmt.link.emulated.network import EmulatedNetwork, EmulatedSendQueue
from mmt.link.protocol import encode_event
from mmt.scene import Network


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
        monkeypatch.setattr(mmt.core.running.ticking, "open_timer", lambda: None)
    elif (timer := mmt.core.running.ticking.open_timer()) is None:
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


async def test_the_end_waits_for_what_is_held_but_no_longer_than_it_may():
    async with outbox(capacity=5, delay_ms=100) as (box, sent):
        for _ in range(30):
            box.put(1, b"message")
        await box.finish(5.0)
        assert len(sent.messages) == 30
    async with outbox(delay_ms=1000) as (box, sent):
        box.put(1, b"message")
        began_s = time.monotonic()
        await box.finish(0.05)
        assert time.monotonic() - began_s < 0.9
        assert box.emulated["lost"] == 1
    assert sent.messages == []


async def test_a_break_loses_what_is_held_and_a_change_holds_for_what_is_put_afterwards():
    async with outbox(delay_ms=20) as (box, sent):
        box.put(1, b"held")
        box.open(sent)
        box.change(Network(loss=1.0), seed=2)
        box.put(1, b"lost")
        box.change(Network(), seed=2)
        box.put(1, b"sent")  # at once
        await until(lambda: sent.messages)
        await asyncio.sleep(0.03)
    assert sent.messages == [b"sent"]
    assert box.emulated["lost"] == 2


async def asked(link, method, **what):
    """The leader's answer about its settings, as a program has it."""
    url = f"http://127.0.0.1:{link.server.port}/network"
    async with aiohttp.ClientSession() as http, http.request(method, url, **what) as response:
        return response.status, await response.json()


async def test_both_directions_are_emulated_and_the_readers_count():
    async with linked(loss=0.3, duplicate=0.3, delay_ms=10, jitter_ms=10, reorder=True) as link:
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


async def test_a_program_reads_and_replaces_the_settings_on_both_sides():
    async with linked(profile="wifi") as link:
        assert await asked(link, "GET") == (200, Network(profile="wifi").model_dump(mode="json"))
        status, answer = await asked(link, "PUT", json={"profile": "bad", "loss": 0.5, "seed": 3})
        assert status == 200
        wanted = Network(profile="bad", loss=0.5, seed=3)
        assert answer == wanted.model_dump(mode="json")
        await until(lambda: link.follows.settings == link.leads.settings == wanted)
    assert len(link.said) == 2
    assert link.said[0] == ("emulated network: delay 150 +- 60 ms, 0.5 lost in bursts of 10")


JSON = {"Content-Type": "application/json"}
WRONG = [
    ({"json": {"delay_ms": -1}}, "[network]: delay_ms is -1"),
    ({"json": {"delay": 1}}, "delay is not a key; allowed are profile, direction, delay_ms"),
    ({"json": [1]}, "[network]: [1]"),
    ({"json": {"delay_ms": 1, "jitter_ms": 2}}, "jitter_ms must not exceed delay_ms"),
    ({"data": b"{", "headers": JSON}, "no JSON"),
    ({"data": b"[" * 4000, "headers": JSON}, "no JSON"),
    ({"data": b" " * 5000, "headers": JSON}, "longer than"),
    ({"data": b"{}", "headers": {"Content-Type": "text/plain"}}, "Content-Type"),
]


async def test_wrong_settings_are_refused_with_a_sentence():
    async with linked() as link:
        for what, problem in WRONG:
            status, answer = await asked(link, "PUT", **what)
            assert status == 400
            assert problem in answer["error"]
            assert link.leads.settings == Network()


async def test_a_follower_that_comes_later_hears_of_the_change():
    async with linked() as link:
        await link.client.disconnect()
        link.leads.change({"profile": "lan"})
        async with follower(link.server.port, made={"network": link.follows}):
            await until(lambda: link.follows.settings == Network(profile="lan"))


async def test_a_malformed_event_changes_nothing_and_is_counted():
    async with linked(profile="lan") as link:
        for payload in (None, 3, {"delay_ms": "x"}, {"unknown": 1}, [{}]):
            link.server.endpoint.outbox.put(0, encode_event("network", payload))
        await until(lambda: link.client.statistics.rejected.get("malformed network") == 5)
        assert link.follows.settings == Network(profile="lan")


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
    async with leader(made={"network": network}) as server:
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
    assert network.settings.delay_ms == 15
