"""What a person orders on the monitor's page, and what the leader answers."""

import asyncio
import json
from pathlib import Path

import pytest
from frame_samples import made_frames
from monitor_browser import monitored, open_browser
from monitor_messages import until
from service_runs import MadeSource

from mmt.session.files import read_session


@pytest.fixture
async def browser():
    async with open_browser() as browser:
        yield browser


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
