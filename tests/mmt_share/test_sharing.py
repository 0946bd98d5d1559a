"""A shared model: what listeners get, when they are slow, late or strangers, or it is full."""

import asyncio
import json
import re
import threading
import time
from contextlib import AsyncExitStack
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import socketio
from sharing_samples import ENDED, about, listening, model_of, refused, shared, until

from mmt.core.errors import InputError
from mmt.leader.part import Session
from mmt.link.protocol import encode_event
from mmt.link.socket_client import SocketClient
from mmt.scene import Scene
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_share import relay as relay_module
from mmt_share.messages import SHARING_VERSION, STATE, Hello
from mmt_share.parts.sharing import ModelPublisher, SharingPart
from mmt_share.relay import ListenerFeed, Relay
from mmt_share.tables import Sharing

TOKEN = "0123456789abcdef0123"


def rendered(model):
    synthesizer = Synthesizer(seed=7)
    synthesizer.model = model
    return synthesizer.render(np.linspace(5.0, 250.0, 500), np.linspace(0.2, 2.8, 500))


async def test_a_listener_renders_each_state_to_the_bit_and_a_late_one_gets_the_whole_first():
    async with shared() as sharing, listening(sharing.url, name="ann") as heard:
        for count in (10, 11, 14):
            sharing.publish(count)
            await until(lambda count=count: heard.client.replica.about == about(count))
            same = rendered(heard.client.replica.build())
            np.testing.assert_array_equal(same, rendered(model_of(count)))
        assert heard.models == [1, 2, 3]
        assert (heard.client.wholes, heard.client.changes) == (1, 2)
        assert heard.client.session == {"session_id": "abc", "name": "a table"}
        async with listening(sharing.url) as late:
            await until(lambda: late.models)
            sharing.publish(15)
            await until(lambda: late.models == [3, 4])
            assert (late.client.wholes, late.client.changes) == (1, 1)
    assert sharing.said[0] == "listener ann joined, 1 listening"
    assert re.fullmatch(r"listener ann left after \d+ s \(.+\), 0 listening", sharing.said[-1])


async def test_a_listener_that_lacks_a_change_asks_for_the_whole():
    async with shared() as sharing, listening(sharing.url) as heard:
        sharing.publish(10)
        await until(lambda: heard.models == [1])
        replica = heard.client.replica
        replica.about = replace(replica.about, number=7)  # as if it had come from another state
        sharing.publish(11)
        await until(lambda: heard.models == [1, 2])
        assert (heard.client.wholes, heard.client.rejected) == (2, 1)
        sharing.relay.offer_state(encode_event(STATE, b"short"), 0.6, 0)
        await until(lambda: heard.client.rejected == 2)
        np.testing.assert_array_equal(
            rendered(heard.client.replica.build()), rendered(model_of(11))
        )


def no_model():
    raise InputError("the arrays are no model")


async def test_states_are_waited_for_and_the_newest_is_given(monkeypatch):
    async with shared() as sharing, listening(sharing.url) as heard:
        client = heard.client
        sharing.publish(10, ready=False)
        assert await client.next_state() == (about(10, ready=False), None)
        waiting = asyncio.create_task(client.next_state())
        await asyncio.sleep(0.05)
        assert not waiting.done()  # one that was given is not given again
        sharing.publish(11)
        said, model = await waiting
        assert said == about(11)
        np.testing.assert_array_equal(rendered(model), rendered(model_of(11)))
        for count in (12, 13):
            sharing.publish(count)
            await until(lambda count=count: client.replica.about == about(count))
        assert (await client.next_state())[0] == about(13)
        monkeypatch.setattr(client.replica, "build", no_model)
        sharing.publish(14)
        waiting = asyncio.create_task(client.next_state())
        await until(lambda: heard.said[-1].startswith("the shared model cannot be rendered"))
        assert not waiting.done()
        monkeypatch.undo()
        sharing.publish(15)
        assert (await waiting)[0] == about(15)


async def test_listeners_that_come_and_go_for_ever_do_not_fill_log_and_recording():
    said, output = [], asyncio.StreamReader()
    left = {"kind": "listener left", "listeners": 3, "listener": {}}
    output.feed_data(2000 * (json.dumps({"event": "one left", "details": left}).encode() + b"\n"))
    output.feed_eof()
    part = SharingPart(Session(Scene(), said.append), Sharing(most=200), None)
    await part._read(SimpleNamespace(stdout=output))
    assert 400 <= len(said) < 1000
    assert part.status() == {"listeners": 3}


@pytest.mark.parametrize("is_sent", [False, True])
async def test_the_last_growth_comes_before_the_end(is_sent, monkeypatch):
    """Whether it is being sent when the session ends, or has only just come."""
    publish, begun = ModelPublisher.publish, threading.Event()

    def slow(self, *given):
        begun.set()
        time.sleep(0.2)
        return publish(self, *given)

    monkeypatch.setattr(ModelPublisher, "publish", slow)
    model = SimpleNamespace(newest=model_of(10), takes_over=True)
    session = Session(Scene())
    part = SharingPart(session, Sharing(port=0), model)
    running = asyncio.create_task(part.tasks()["sharing"])
    await until(lambda: part.port is not None)
    async with listening(f"http://127.0.0.1:{part.port}") as heard:
        await until(lambda: heard.models == [1])
        begun.clear()
        model.newest = model_of(200)
        if is_sent:
            await until(begun.is_set)
        running.cancel()
        session.ending.stop("completed")
        await part.stop()
        await until(lambda: ENDED in heard.said)
        assert heard.client.replica.about.samples == 200
    part.close()


def test_a_slow_listener_gets_what_is_newest_and_nothing_waits_for_it():
    relay, publisher = Relay(), ModelPublisher()
    listener = ListenerFeed(relay)
    messages = [publisher.publish(model_of(count), about(count)) for count in (10, 11, 12, 13)]
    relay.offer_model(*messages[0])
    assert listener.next() == messages[0].whole
    assert listener.next() is None
    relay.offer_model(*messages[1])
    assert listener.next() == messages[1].change
    for message in messages[2:]:  # two of them while it could take none
        relay.offer_model(*message)
    for number in range(50):
        relay.offer_state(b"%d" % number, float(number), 0)
    assert listener.next() == messages[3].whole
    assert listener.next() == b"49"
    assert listener.next() is None
    figures = listener.figures(0)
    assert (figures["wholes"], figures["changes"], figures["states"]) == (2, 1, 1)
    assert figures["skipped"] == 1 + 49
    assert figures["wholes_bytes"] == len(messages[0].whole) + len(messages[3].whole)
    assert (figures["number"], figures["lag_ms"], figures["answered_s"]) == (None, None, None)
    assert relay.sent == listener.sent


async def test_a_listener_that_takes_nothing_is_let_go(monkeypatch):
    monkeypatch.setattr(relay_module, "STALLED_S", 0.05)
    relay = Relay()
    listener = ListenerFeed(relay)

    async def stall(_):
        await asyncio.sleep(60.0)

    relay.offer_state(b"a state", 0.0, 0)
    with pytest.raises(TimeoutError):
        await listener.serve(stall)


async def test_a_listener_gets_as_many_states_as_it_wants_or_can_take(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(relay_module, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    relay = Relay()
    got = {None: [], 1.0: [], 5.0: []}
    serving = []
    for states_hz, taken in got.items():

        async def take(message, taken=taken):
            taken.append(message)

        listener = relay.listeners[str(states_hz)] = ListenerFeed(relay, states_hz)
        serving.append(asyncio.create_task(listener.serve(take)))
    slow, gate = [], asyncio.Event()

    async def take_slowly(message):
        await gate.wait()
        slow.append(message)

    relay.listeners["slow"] = ListenerFeed(relay)
    serving.append(asyncio.create_task(relay.listeners["slow"].serve(take_slowly)))
    await asyncio.sleep(0)
    for number in range(8 + 200):
        relay.offer_state(b"%d" % number, float(number), 0)
        await until(lambda number=number: len(got[None]) == number + 1)
        now_s[0] += 0.05
    gate.set()
    await until(lambda: len(slow) == 2)
    relay.offer_model(1, b"whole", None)
    relay.finish("completed")
    await asyncio.gather(*serving)
    for states_hz, expected in ((1.0, 8 + 10), (5.0, 8 + 50)):
        *states, whole, end = got[states_hz]
        assert states[:8] == got[None][:8]
        assert len(states) == pytest.approx(expected, abs=1)
        assert (whole, end) == (b"whole", relay.end)
    assert slow == [got[None][0], got[None][207], b"whole", relay.end]
    assert relay.sent["skipped"] == 206  # by the slow one alone


def test_a_rate_of_states_that_makes_no_sense_is_refused():
    for states_hz in (0.0, -1.0, 1e9, float("nan"), "often", [1.0]):
        auth = {"sharing": SHARING_VERSION, "role": "listener", "states_hz": states_hz}
        with pytest.raises(InputError, match=r"states_hz must be absent, or a number from 0\.01"):
            Hello.from_auth(auth)


@pytest.mark.parametrize("given", [None, "", "another0123456789abcd"])
async def test_without_the_token_nobody_listens(monkeypatch, given):
    monkeypatch.setenv("MMT_SHARING_TOKEN", TOKEN)
    async with shared() as sharing:
        monkeypatch.setenv("MMT_SHARING_TOKEN", given or "")
        await refused("give the listener the leader's token", sharing.url)
        monkeypatch.setenv("MMT_SHARING_TOKEN", TOKEN)
        sharing.publish(10)
        async with listening(sharing.url) as heard:
            await until(lambda: heard.models)
    assert len(sharing.said) == 2


async def test_who_cannot_listen_is_told_why():
    async with shared(most=1) as sharing, listening(sharing.url):
        await refused("1 are listening already: raise most", sharing.url)
    url = "http://127.0.0.1:9"
    await refused(f"at {url} .*: start mmt-leader with --share there", url, patience_s=0.5)
    with pytest.raises(InputError, match=r"lets everyone .* be a listener: set a token"):
        async with shared(host="0.0.0.0"):
            pass


@pytest.mark.parametrize(
    ("auth", "refusal"),
    [
        (None, "this port is for listeners"),
        ({"role": "follower", "sharing": 1}, "this port is for listeners"),
        ({"role": "operator", "sharing": 1}, "no control is given to this listener"),
        ({"role": "listener", "sharing": 99}, "version 99 of sharing"),
    ],
)
async def test_who_is_no_listener_is_refused(auth, refusal):
    async with shared() as sharing:
        stranger = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        said = []
        stranger.on("connect_error", lambda problem: said.append(problem["message"]))
        with pytest.raises(socketio.exceptions.ConnectionError):
            await stranger.connect(sharing.url, auth=auth, transports=["websocket"])
        assert refusal in said[0]


async def test_who_is_connected_stays_so_though_the_last_of_it_took_too_long(monkeypatch):
    opened = SocketClient.open

    async def late(self, *arguments):
        await opened(self, *arguments)
        return "it took too long"

    monkeypatch.setattr(SocketClient, "open", late)
    async with shared() as sharing, listening(sharing.url) as heard:
        sharing.publish(10)
        await until(lambda: heard.models == [1])
    assert [each["kind"] for each in sharing.details] == ["listener joined", "listener left"]


async def test_a_listener_turns_from_a_full_hub_to_another():
    async with AsyncExitStack() as stack:
        full, other = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        await full.server.send_hubs(["rubbish", other.url])
        await stack.enter_async_context(listening(full.url))
        other.publish(10)
        heard = await stack.enter_async_context(listening(full.url))
        await until(lambda: heard.models)
        assert f"{full.url} is full: connected to {other.url}" in heard.said
        assert (len(full.said), len(other.said)) == (1, 1)


async def test_where_all_are_full_the_first_ones_refusal_is_told_at_once():
    async with AsyncExitStack() as stack:
        hubs = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        for one, another in (hubs, hubs[::-1]):
            await one.server.send_hubs([another.url])
            await stack.enter_async_context(listening(one.url))
        async with asyncio.timeout(4.0):  # each is asked once
            await refused(f"{hubs[0].url} refused: 1 are listening already", hubs[0].url)
            for hub in hubs:
                new = SimpleNamespace(get=lambda _: [f"{hubs[1].url}?{time.monotonic_ns()}"])
                hub.server._welcome = new  # names another one each time
            await refused(f"{hubs[0].url} refused: 1 are listening already", hubs[0].url)


async def test_a_listener_that_comes_back_to_a_full_hub_turns_to_another():
    async with AsyncExitStack() as stack:
        first, other = [await stack.enter_async_context(shared(most=1)) for _ in range(2)]
        heard = await stack.enter_async_context(listening(first.url))
        first.server._welcome["hubs"] = [other.url]
        line = heard.client._connection.line
        line.drop()
        await until(lambda: len(first.said) == 2)  # it has left
        late = await stack.enter_async_context(listening(first.url, name="quicker"))
        await until(lambda: other.said and heard.client.connected)
        assert late.client.connected


@pytest.mark.parametrize("token", ["0123456789abcdef0123", "another0123456789abcd"])
async def test_a_stock_client_is_told_the_others_if_it_shows_the_token(token, monkeypatch):
    monkeypatch.setenv("MMT_SHARING_TOKEN", "0123456789abcdef0123")
    refusals = []
    async with shared(most=1) as full, listening(full.url):
        await full.server.send_hubs(["http://hub2.lab:8766"])
        stock = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        stock.on("connect_error", refusals.append)
        hello = {"sharing": SHARING_VERSION, "role": "listener", "token": token}
        with pytest.raises(socketio.exceptions.ConnectionError):
            await stock.connect(full.url, auth=hello, transports=["websocket"])
        await stock.disconnect()
    if token.startswith("0"):
        assert refusals[0]["message"].startswith("1 are listening already")
        assert refusals[0]["data"] == {"hubs": ["http://hub2.lab:8766"]}
    else:
        assert "data" not in refusals[0]
