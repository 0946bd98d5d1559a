"""The monitor of a leader that runs, as a browser without a screen sees it and orders there."""

import asyncio
import json
from pathlib import Path

import aiohttp
import pytest
from frame_samples import made_frames
from monitor_browser import address, monitored, open_browser
from monitor_messages import unpack, until
from service_runs import MadeSource

from mmt.core.errors import MmtError
from mmt.link import access
from mmt.link.access import TOKEN_VARIABLE, Access
from mmt.session.files import read_session
from mmt.web.monitor.live import MOST_VIEWERS
from mmt.web.monitor.order_client import give_order

TOKEN = "a token that nobody guesses"


@pytest.fixture
async def browser():
    async with open_browser() as browser:
        yield browser


async def test_a_run_is_shown_while_it_lasts_and_at_last_how_it_has_ended(tmp_path, browser):
    together = await monitored(tmp_path)
    socket = await browser.look_on(together)
    hello = await until(socket, "hello")
    assert hello["id"] == together.leader.log.session_id
    waiting = await until(socket, "live")
    assert waiting["mode"] == "streamed"
    assert waiting["verdict"]["now"] == "waiting for the follower"
    source = MadeSource([made_frames(k, 1) for k in range(2500)])
    following = asyncio.create_task(together.follow(source))
    while (live := await until(socket, "live"))["measured_count"] < 100:
        assert live["viewers"] == 1
    assert live["verdict"]["now"] == "streamed"
    assert live["played_count"] > 0
    assert 0 < live["time_s"] <= together.leader.time_s
    link = await until(socket, "link")
    assert len(link["counts"]) == len(link["bounds_ms"]) + 1
    assert sum((await until(socket, "ticks"))["counts"]) > 100
    late = (await until(await browser.look_on(together), "events"))["events"]
    assert "follower connected (simulated)" in [sentence for _, sentence in late]
    shown = {}
    while "end" not in shown:
        message = unpack(await socket.receive_bytes(timeout=30.0))
        shown[message["kind"]] = message
    assert (await socket.receive()).type is aiohttp.WSMsgType.CLOSE
    await following
    summary = await together.end()
    assert shown["ticks"]["ticks"] == summary.ticks["ticks"]
    assert shown["link"]["frames"] == shown["live"]["measured_count"] == 2500
    assert shown["end"]["outcome"] == summary.outcome == "source ended"


async def test_the_page_is_served_and_nothing_beside_it(tmp_path, browser):
    together = await monitored(tmp_path)
    async with browser.http.get(address(together, "/monitor")) as answer:
        assert answer.status == 200
        assert answer.url.path == "/monitor/"
        assert "Where to stroke next" in await answer.text()
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    for name, kind in {"monitor.js": "text/javascript", "uPlot.css": "text/css"}.items():
        async with browser.http.get(address(together, f"/monitor/{name}")) as answer:
            assert (answer.status, answer.content_type) == (200, kind)
    for name in ("none.js", "..%2f__init__.py", "%2e%2e/__init__.py"):
        async with browser.http.get(address(together, f"/monitor/{name}")) as answer:
            assert answer.status == 404
    await together.stop()


async def test_a_request_makes_the_leader_look_no_name_up(tmp_path, browser, monkeypatch):
    together = await monitored(tmp_path, link={"host": "localhost", "port": 0})
    looked_up = []
    monkeypatch.setattr(access.socket, "getaddrinfo", lambda *name, **_: looked_up.append(name))
    headers = {"Host": "elsewhere.example"}
    async with browser.http.get(address(together, "/health"), headers=headers) as answer:
        assert answer.status == 403
    assert not looked_up
    await together.stop()


async def test_with_a_token_the_socket_asks_for_it(tmp_path, browser, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, TOKEN)
    together = await monitored(tmp_path)
    for wrong in (None, "another token than it has"):
        socket = await browser.look_on(together, wrong)
        message = await socket.receive()
        assert (message.type, message.data) == (aiohttp.WSMsgType.CLOSE, 4401)
    for rubbish in ("[1, 2]", "[" * 4000):
        async with browser.http.ws_connect(address(together)) as socket:
            await socket.send_str(rubbish)
            assert (await socket.receive()).data == 4401
    async with browser.http.ws_connect(address(together), autoping=False) as socket:
        await socket.ping(b"who is there")
        assert (await socket.receive()).data == 4401
    assert (await until(await browser.look_on(together, TOKEN), "hello"))["session"] == "session"
    async with browser.http.ws_connect(address(together), autoping=False) as socket:
        await socket.send_json({"token": TOKEN})
        await socket.pong(b"not asked for")
        await socket.ping(b"who is there")
        while (message := await socket.receive(10.0)).type is aiohttp.WSMsgType.BINARY:
            pass
        assert (message.type, message.data) == (aiohttp.WSMsgType.PONG, b"who is there")
    await together.stop()


async def test_only_so_many_may_look_on_and_nothing_is_kept_once_the_last_has_left(
    tmp_path, browser
):
    together = await monitored(tmp_path)
    monitor = together.leader.parts.monitor
    assert not monitor.live.watched
    sockets = [await browser.look_on(together) for _ in range(MOST_VIEWERS)]
    for socket in sockets:
        await until(socket, "live")
    assert monitor.live.watched
    with pytest.raises(MmtError, match="has too many viewers"):
        await give_order(f"http://127.0.0.1:{together.leader.port}", Access(), {"do": "mark"})
    for socket in sockets:
        await socket.close()
    await together.until(lambda: not monitor.live.watched)
    await together.stop()


async def test_a_fault_of_the_monitor_does_not_end_the_session(tmp_path, browser, monkeypatch):
    together = await monitored(tmp_path)
    monitor = together.leader.parts.monitor

    def fail():
        raise ValueError("as a test wants it")

    socket = await browser.look_on(together)
    await until(socket, "live")
    monkeypatch.setattr(monitor, "publish_changes", fail)
    assert (await until(socket, "end"))["outcome"] == "the monitor has failed"
    ticks = together.leader.ticker.statistics.ticks
    await together.until(lambda: together.leader.ticker.statistics.ticks > ticks)
    assert (await together.stop()).outcome == "stopped"


async def order(socket, **what):
    """Send an order; return whether it was carried out, and the answer."""
    await socket.send_str(json.dumps({"id": 7, **what}))
    answer = await until(socket, "answer")
    assert answer["id"] == 7 or not answer["ok"]
    return answer["ok"], answer["text"]


async def test_a_recording_is_started_marked_and_ended(tmp_path, browser, monkeypatch):
    monkeypatch.chdir(tmp_path)
    together = await monitored(tmp_path, recording=None)
    following = asyncio.create_task(
        together.follow(MadeSource([made_frames(k, 1, ("acceleration",)) for k in range(30_000)]))
    )
    await together.until(lambda: together.leader.time_s > 0.1)
    socket = await browser.look_on(together)
    assert (await until(socket, "controls"))["recording"] is None
    good, sentence = await order(socket, do="mark", text="before")
    assert (good, sentence) == (True, "marked: before (nothing is being recorded)")
    journal = together.leader.session.journal
    journal.record({"event": "actuator response", "gain": [0.4], "low_hz": 40.0})
    response = {"event": "actuator response", "gain": [0.5], "low_hz": 40.0}
    journal.record(response)
    journal.event("model frozen", frozen=True)
    journal.event("nothing more than said")
    for number in (1, 2):
        file = Path("mmt-monitor") / f"session-{number}.mcap"
        assert await order(socket, do="record", on=True) == (True, f"recording into {file}")
        assert await order(socket, do="record", on=True) == (False, "a recording runs already")
        await together.until(lambda: together.leader.parts.recording.recorder.frames > 0)
        assert await order(socket, do="mark", text="wood begins") == (True, "marked: wood begins")
        good, sentence = await order(socket, do="record", on=False)
        assert good
        recorded = read_session(file)
        assert sentence == f"recorded {len(recorded.frames)} frames into {file}"
        assert recorded.annotations == b"as made"
        marks = [event["mark"] for event in recorded.events if "mark" in event]
        assert marks == ["wood begins"]
        responses = [e for e in recorded.events if e.get("event") == response["event"]]
        assert [{**each, **response} for each in responses] == responses != []
        assert [e["frozen"] for e in recorded.events if "frozen" in e] == [True]
        assert "nothing more than said" not in [event["event"] for event in recorded.events]
    assert await order(socket, do="record", on=False) == (False, "no recording runs")
    summary = await together.stop()
    assert summary.recording["file"] == str(file)
    await following


async def test_what_cannot_be_done_is_said_in_words(tmp_path, browser):
    together = await monitored(tmp_path)
    socket = await browser.look_on(together)
    for what, words in (
        ({"do": "save"}, "there is no model yet"),
        ({"do": "reset"}, "this scene builds no model"),
        ({"do": "freeze", "on": True}, "this scene builds no model"),
        ({"do": "mode", "mode": "synthesized"}, "this scene renders from no model"),
        ({"do": "mode", "mode": "loud"}, "allowed are auto, streamed, synthesized"),
        ({"do": "mode", "mode": ["auto"]}, "allowed are auto, streamed, synthesized"),
        ({"do": "record", "on": 1}, "allowed are true and false"),
        ({"do": "control", "decision": "give", "who": 1}, "allowed are mark, reset"),
        ({"do": "dance"}, "allowed are mark, reset"),
        ({"do": ["mark"]}, "allowed are mark, reset"),
        ({"do": "mark", "text": "x" * 201}, "200 printable characters"),
        ({"do": "mark", "text": "two\nlines"}, "a mark is a line"),
        ({"do": "mark", "id": -1}, "id of an order"),
        ({"do": "mark", "id": "1"}, "id of an order"),
    ):
        good, sentence = await order(socket, **what)
        assert (good, words in sentence) == (False, True), sentence
    for text in ("", "[]", "{", "null", "[" * 3000):
        await socket.send_str(text)
        answer = await until(socket, "answer")
        assert not answer["ok"]
        assert "a JSON object" in answer["text"]
    await together.stop()


async def test_the_disk_says_why_it_takes_no_recording(tmp_path, browser, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mmt-monitor").write_text("a file where the folder would be")
    together = await monitored(tmp_path, recording=None)
    socket = await browser.look_on(together)
    good, sentence = await order(socket, do="record", on=True)
    assert not good
    assert "mmt-monitor" in sentence
    assert (await together.stop()).outcome == "stopped"


async def test_streamed_vibration_can_be_held_on_to(tmp_path, browser):
    together = await monitored(tmp_path)
    socket = await browser.look_on(together)
    assert await order(socket, do="mode", mode="streamed") == (True, "held to streamed vibration")
    while (await until(socket, "controls"))["forced"] != "streamed":
        pass
    good, _ = await order(socket, do="mode", mode="auto")
    assert good
    while (await until(socket, "controls"))["forced"] != "auto":
        pass
    await together.stop()
