"""Who listens and how far they are behind, as the process that serves them knows it."""

import math
from contextlib import AsyncExitStack

import numpy as np
import pytest
import socketio
from sharing_samples import listening, shared, until

from mmt.core.errors import InputError
from mmt_share import relay as relay_module
from mmt_share import server as server_module
from mmt_share.lag import Lag, ListenerState
from mmt_share.messages import PING_S, SHARING_VERSION
from mmt_share.parts.listeners import Listeners
from mmt_share.relay import Relay

MS = 1_000_000


@pytest.mark.parametrize("offset_ns", [0, 3 * 10**15, -(10**12)])
@pytest.mark.parametrize("jitter_ms", [0.0, 40.0])
def test_the_lag_is_that_of_the_way_there_whatever_the_clocks(offset_ns, jitter_ms):
    """40 ms each way at least; the lag is known to what the quickest of some seconds differ by."""
    rng, lag, true_ms = np.random.default_rng(5), Lag(), []
    for k in range(600):
        made_ns = 10**13 + k * 1000 * MS
        there_ms, back_ms = 40.0 + jitter_ms * rng.random(2) ** 2
        there_ns, back_ns = round(there_ms * MS), round(back_ms * MS)
        true_ms.append(there_ms)
        have = ListenerState(k, made_ns + there_ns + offset_ns, 0.05 * k)
        lag.record_answer(have, made_ns, made_ns + there_ns + back_ns)
        assert (lag.last_ms is None) == (k < 7)
        if lag.last_ms is not None and k > 60:
            assert lag.last_ms == pytest.approx(there_ms, abs=0.1 + 0.1 * jitter_ms)
    figures = lag.figures(made_ns + 2000 * MS)
    assert figures["number"] == 599
    assert figures["lag_p50_ms"] == pytest.approx(np.quantile(true_ms, 0.5), abs=1.5)
    assert figures["lag_p99_ms"] == pytest.approx(np.quantile(true_ms, 0.99), abs=3.0)
    assert 1.8 < figures["answered_s"] < 2.0


def test_a_stall_is_lag_and_moves_no_clock():
    lag = Lag()
    for k in range(60):
        made_ns = 10**12 + k * 1000 * MS
        there_ns = (4000 if k == 40 else 10) * MS
        lag.record_answer(
            ListenerState(1, made_ns + there_ns, float(k)), made_ns, made_ns + there_ns + 10 * MS
        )
        if k >= 7:
            assert lag.last_ms == pytest.approx(4000.0 if k == 40 else 10.0, abs=0.5)


def test_a_state_that_is_not_known_gives_no_lag():
    lag = Lag()
    for k in range(20):
        lag.record_answer(ListenerState(3, k * MS, 0.0), None, k * MS)
    assert (lag.number, lag.last_ms) == (3, None)
    relay = Relay()
    for k in range(700):
        relay.offer_state(b"", 0.05 * k, k)
    assert [relay.made_ns(0.05 * k) for k in (0, 99, 100, 699)] == [None, None, 100, 699]
    relay.offer_state(b"", 0.05 * 699, 1000)  # the session's time stood still
    assert relay.made_ns(0.05 * 699) is None
    assert relay.made_ns(math.nan) is None


def test_what_is_malformed_is_refused():
    for data in (None, b"", b"x" * 21, 5, {"number": 1}):
        with pytest.raises(InputError, match="malformed"):
            ListenerState.unpack(data)
    with pytest.raises(InputError, match="clock"):
        ListenerState.unpack(ListenerState(1, -1, 0.0).pack())


async def test_who_listens_since_when_and_how_far_behind():
    async with shared() as sharing, listening(sharing.url, name="ann") as heard:
        sharing.publish(10)
        await until(lambda: heard.models)
        for k in range(1, 10):
            sharing.offer_state(0.05 * k)
            await until(lambda k=k: len(heard.states) == k)
        (guest,) = sharing.server.figures()["rows"]
        assert (guest["id"], guest["name"], guest["rejected"]) == (1, "ann", 0)
        await until(lambda: sharing.server.figures()["rows"][0]["lag_ms"] is not None)
        figures = sharing.server.figures()
        (guest,) = figures["rows"]
        assert (guest["number"], guest["wholes"], guest["states"], guest["skipped"]) == (1, 1, 9, 0)
        assert 0.0 <= guest["lag_ms"] < 5000.0
        assert guest["lag_ms"] == pytest.approx(figures["lag_most_ms"], abs=1e-3)
        assert figures["lag_most_ms"] == figures["lag_median_ms"]
        assert guest["listened_s"] > 0.0
        assert guest["states_bytes"] == figures["sent"]["states_bytes"] > 9 * 37
    joined, left = sharing.details
    assert (joined["kind"], joined["listeners"]) == ("listener joined", 1)
    assert joined["listener"] == {"id": 1, "name": "ann"}
    assert (left["kind"], left["listeners"]) == ("listener left", 0)
    assert left["listener"]["why"] in {"it disconnected", "the connection was closed"}
    assert left["listener"]["states"] == 9


async def test_a_stock_client_that_answers_nothing_is_known_by_what_it_was_sent():
    async with shared() as sharing:
        stranger = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        hello = {"sharing": SHARING_VERSION, "role": "listener", "name": "stock"}
        await stranger.connect(sharing.url, auth=hello, transports=["websocket"])
        assert (stranger.eio.ping_interval, stranger.eio.ping_timeout) == PING_S
        await stranger.emit("again", None)
        await until(lambda: sharing.relay.listeners)
        sharing.offer_state(0.5)
        await until(lambda: sharing.server.figures()["rows"][0]["states"] == 1)
        for rubbish in (b"short", {"a": 1}, None):
            await stranger.emit("have", rubbish)
        await until(lambda: sharing.server.figures()["rows"][0]["rejected"] == 3)
        (guest,) = sharing.server.figures()["rows"]
        assert (guest["number"], guest["lag_ms"], guest["answered_s"]) == (None, None, None)
        await stranger.disconnect()
        await until(lambda: len(sharing.details) == 2)


async def test_why_a_listener_was_let_go_is_told(monkeypatch):
    async def stall(*_):
        raise TimeoutError

    monkeypatch.setattr(relay_module.ListenerFeed, "serve", stall)
    async with shared() as sharing, listening(sharing.url, name="ann"):
        await until(lambda: len(sharing.said) >= 2)
        assert "(it took nothing for 10 s)" in sharing.said[1]
        assert sharing.details[1]["listener"]["why"] == "it took nothing for 10 s"


async def test_of_many_the_figures_are_those_furthest_behind(monkeypatch):
    monkeypatch.setattr(server_module, "_MOST_SHOWN", 2)
    async with shared() as sharing:
        async with AsyncExitStack() as stack:
            for _ in range(4):
                await stack.enter_async_context(listening(sharing.url))
            await until(lambda: len(sharing.relay.listeners) == 4)
            lags_ms = (5.0, None, 9.0, 7.0)
            for listener, lag_ms in zip(sharing.relay.listeners.values(), lags_ms, strict=True):
                listener.lag.last_ms = lag_ms
            figures = sharing.server.figures()
        assert (figures["listeners"], figures["joined"]) == (4, 4)
        assert (figures["lag_median_ms"], figures["lag_most_ms"]) == (7.0, 9.0)
        assert [row["id"] for row in figures["rows"]] == [3, 4]


def test_the_leader_keeps_what_a_person_wants_to_know_at_the_end():
    pytest.importorskip("prometheus_client")
    from mmt.core.output.exposition import registry_of

    listeners = Listeners()
    assert registry_of(listeners.metrics).get_sample_value("mmt_listeners") == 0
    for number in range(150):
        for kind, now in (("listener joined", 1), ("listener left", 0)):
            details = {"kind": kind, "listeners": now, "listener": {"id": number}}
            listeners.record_event(details)
    sent = {"wholes": 150, "wholes_bytes": 300_000, "skipped": 7}
    figures = {"joined": 150, "sent": sent, "lag_median_ms": 20.0, "lag_most_ms": None}
    listeners.take_figures(figures, 12.5)
    summary = listeners.summary()
    assert (summary["joined"], summary["most_listeners"]) == (150, 1)
    assert summary["sent"] == {**sent, "listened_s": 12.5}
    assert [each["id"] for each in summary["listeners"]] == list(range(50, 150))
    value = registry_of(listeners.metrics).get_sample_value
    assert value("mmt_listeners_joined_total") == 150
    assert value("mmt_shared_bytes_total", {"kind": "wholes"}) == 300_000
    assert value("mmt_shared_messages_total", {"kind": "states"}) == 0
    assert value("mmt_shared_skipped_messages_total") == 7
    assert value("mmt_listener_lag_seconds", {"of": "median"}) == 0.02
    assert value("mmt_listener_lag_seconds", {"of": "most"}) is None
