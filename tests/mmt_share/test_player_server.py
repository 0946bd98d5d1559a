"""The player's server, with pages that have no screen, and what it records of them."""

import asyncio
import json
import time

import aiohttp
import numpy as np
import pytest
from player_samples import (
    LONGEST_S,
    NAMES,
    RMS_M_S2,
    address,
    flat_texture,
    playing,
    rows_of,
    textures,
    visiting,
)
from sharing_samples import about, playing_shared, shared

import mmt
from mmt.core.errors import InputError
from mmt.evaluation.evaluate import evaluate_session
from mmt.session.data import missing_frames
from mmt.session.files import read_session
from mmt.session.info import info
from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.messages import Step
from mmt_share.player.recording import TouchRecorder
from mmt_share.player.results import ResultsFile
from mmt_share.player.server import TAKEN_OVER


async def test_a_page_gets_models_and_what_they_become_but_none_too_large(tmp_path, monkeypatch):
    async with playing(tmp_path) as server, visiting(server) as page:
        hello = await page.until("hello")
        assert (hello["names"], hello["scenarios"]) == (list(NAMES), True)
        for number, (name, texture) in enumerate(zip(NAMES, textures(), strict=True)):
            message = await page.until("model")
            assert message["texture"] == number
            assert message["form"] == model_json(texture, name)
            assert message["arrays"]["picture"].shape == (96, 96)
        grown = flat_texture(7.0)
        server.player.set_models([grown, *textures()[1:]])
        assert await page.model() == json.loads(model_json(grown, NAMES[0]))
        monkeypatch.setattr("mmt.texture.model.json_form.MOST_ROWS", 3)
        sent = server.player.model_messages
        with pytest.raises(InputError, match="select fewer samples"):
            server.player.set_models([flat_texture(1.0), *textures()[1:]])
        assert server.player.model_messages is sent


async def test_what_makes_no_sense_is_counted_and_the_page_goes_on(tmp_path):
    async with playing(tmp_path) as server, visiting(server) as page:
        for text in ("", "[]", "null", '{"do": 3}', '{"do": "stroke", "tile": 0}'):
            await page.socket.send_str(text)
        await page.socket.send_str('{"do": "jump", "id": 4}')
        assert (await page.until("answer"))["text"] == "begin a scenario first"
        assert not (await page.order(do="begin", scenario="none", participant="P"))["ok"]
        assert not (await page.order(do="begin", scenario="matching", participant=" "))["ok"]
        assert (await page.order(do="begin", scenario="matching", participant="P"))["ok"]
        while (await page.until("status"))["rejected"] < 5:
            pass


async def test_no_stroke_is_longer_than_the_time_that_has_passed(tmp_path):
    record = tmp_path / "touch.mcap"
    async with playing(tmp_path, record=record, count=1) as server, visiting(server) as page:
        steps = [[1000, 0.0, 0.0, 100.0, 0.0, 1.0]] * 4
        for _ in range(20):
            await page.say(do="stroke", tile=0, steps=steps, id=9)
        assert "longer than the time" in (await page.until("answer"))["text"]
        while (status := await page.until("status"))["rejected"] < 20:
            pass
        assert status["recorded_s"] <= 4.0


async def test_a_page_that_floods_is_closed(tmp_path):
    async with playing(tmp_path) as server, visiting(server) as page:
        async with asyncio.timeout(LONGEST_S):
            for _ in range(300):
                await page.lift()
            while (await page.socket.receive()).type is not aiohttp.WSMsgType.CLOSE:
                pass
        assert page.socket.close_code == 1008
        async with visiting(server) as another:
            assert await another.model()


async def test_the_newest_page_is_connected(tmp_path):
    async with playing(tmp_path) as server, visiting(server) as first:
        await first.model()
        async with visiting(server) as second:
            assert await second.model()
            async with asyncio.timeout(60):
                while (await first.socket.receive()).type is not aiohttp.WSMsgType.CLOSE:
                    pass
            assert first.socket.close_code == TAKEN_OVER


async def test_a_page_without_the_token_gets_nothing(tmp_path):
    token = "a token that nobody guesses"
    async with playing(tmp_path, token=token) as server:
        async with visiting(server, "another one") as page:
            async with asyncio.timeout(60):
                assert (await page.socket.receive()).data == 4401  # and no message before
        async with visiting(server, token) as page:
            assert await page.model()


async def test_neither_pages_of_other_sites_nor_other_machines_reach_the_player(tmp_path):
    async with playing(tmp_path) as server, aiohttp.ClientSession() as http:
        for headers in ({"Origin": "http://elsewhere.example"}, {"Host": "elsewhere.example"}):
            async with http.get(address(server, "/player/socket"), headers=headers) as answer:
                assert answer.status == 403
        with pytest.raises(InputError, match="--token-file"):
            await server.start("0.0.0.0", 0)


async def test_a_scenario_outlasts_its_page(tmp_path):
    async with playing(tmp_path) as server:
        async with visiting(server) as page:
            assert (await page.order(do="begin", scenario="exploration", participant="P7"))["ok"]
            assert not (await page.order(do="rate", rating=4))["ok"]
            await page.stroke(server.player.study.order[0], 1.2)
            assert (await page.order(do="rate", rating=4))["ok"]
        async with visiting(server) as page:
            state = await page.until("study")
            assert (state["trial"], state["participant"]) == (2, "P7")
    written = rows_of(tmp_path / "results.csv")
    assert [row["event"] for row in written] == ["begin", "rating", "leave"]


async def test_a_page_that_is_loaded_again_while_its_rating_is_written_rates_no_pair_twice(
    tmp_path, monkeypatch
):
    write = ResultsFile.write

    def write_slowly(results, row):
        time.sleep(1.0 if row["event"] == "rating" else 0.0)
        write(results, row)

    monkeypatch.setattr(ResultsFile, "write", write_slowly)
    async with playing(tmp_path) as server:
        async with visiting(server) as page:
            assert (await page.order(do="begin", scenario="exploration", participant="P8"))["ok"]
            study = server.player.study
            await page.stroke(study.order[0], 1.2)
            while not (await page.until("study"))["rates"]:
                pass
            await page.say(do="rate", rating=4, id=1)
            await asyncio.sleep(0.3)
        async with visiting(server) as page:
            assert not (await page.order(do="rate", rating=5))["ok"]
        assert study.trial == 1
    written = rows_of(tmp_path / "results.csv")
    assert [row["rating"] for row in written if row["event"] == "rating"] == ["4"]


async def test_touches_are_recorded_as_sessions_that_can_be_evaluated(tmp_path):
    record = tmp_path / "touch.mcap"
    async with playing(tmp_path, record=record) as server, visiting(server) as page:
        await page.stroke(1, 1.0, 60.0)
        await page.lift()
        for speed_mm_s in (100.0, 180.0):
            await page.stroke(1, 1.0, speed_mm_s)
        await page.stroke(0, 0.3)
        while (await page.until("status"))["recorded_s"] < 3.3:
            pass
    session = read_session(tmp_path / "touch-linen.mcap")
    frames = session.frames
    assert missing_frames(frames) == 1  # the pointer was lifted once
    assert len(frames) == 3000
    fast = frames[2200:2900]
    speed = np.abs(np.diff(fast["position_mm"][:, 0])) * 1000.0
    assert np.median(speed) == pytest.approx(180.0, rel=0.05)
    assert fast["force_n"][:, 2] == pytest.approx(1.0)
    assert np.std(fast["acceleration_m_s2"][:, 2]) == pytest.approx(RMS_M_S2[1], rel=0.25)
    assert info(tmp_path / "touch-linen.mcap").rate_hz == pytest.approx(1000.0)
    assert info(tmp_path / "touch-cork.mcap").frames == 300
    ((_, attached),) = session.models
    (tmp_path / "again.npz").write_bytes(attached)
    assert TextureModel.load(tmp_path / "again.npz").order == 6
    result = evaluate_session(session)
    assert result.at_end.samples > 0


async def test_a_tile_that_a_scenario_disables_is_not_recorded_and_does_not_count(tmp_path):
    record = tmp_path / "touch.mcap"
    async with playing(tmp_path, record=record) as server, visiting(server) as page:
        await page.order(do="begin", scenario="exploration", participant="P8")
        study = server.player.study
        asked = study.order[0]
        assert study.state()["textures"] == [t if t == asked else None for t in range(3)]
        await page.stroke((asked + 1) % 3, 1.2)
        assert not (await page.order(do="rate", rating=4))["ok"]
        await page.stroke(asked, 0.5)
        await page.stroke(asked, 0.8, speed_mm_s=1.0)  # held still
        assert not (await page.order(do="rate", rating=4))["ok"]
        await page.stroke(asked, 0.6)
        assert (await page.order(do="rate", rating=4))["ok"]
    assert [path.name for path in tmp_path.glob("*.mcap")] == [f"touch-{NAMES[asked]}.mcap"]


async def test_a_recording_that_cannot_be_made_is_told(tmp_path):
    folder = tmp_path / "folder"
    record = folder / "t.mcap"
    folder.write_text("")
    with pytest.raises(InputError, match=r"cannot write .*t\.mcap"):
        TouchRecorder(record, ["oak"], [mmt.load_model("oak")])
    folder.unlink()
    async with playing(tmp_path, record=record, count=1) as server, visiting(server) as page:
        folder.rmdir()
        folder.write_text("")
        await page.stroke(0, 0.1)
        while (problem := (await page.until("status"))["problem"]) is None:
            pass
        assert "recording" in problem


@pytest.mark.parametrize("k", [1, 3])
def test_a_touch_is_recorded_at_the_rate_of_its_model(tmp_path, k):
    shipped = mmt.load_model("oak")
    model = TextureModel(shipped.samples, method="published", rate_hz=1000.0 * k)
    recorder = TouchRecorder(tmp_path / "touch.mcap", ["oak"], [model])
    recorder.record(0, [Step(10, 0.0, 0.0, 150.0, 0.0, 1.0)] * 50)
    assert recorder.problem is None
    ((file, seconds),) = recorder.close()
    session = mmt.read_session(file)
    assert seconds == pytest.approx(0.5)
    assert len(session.frames) == 500
    assert session.samples_per_frame == k
    along = session.frames["acceleration_m_s2"].reshape(-1, 3)[:, 2]
    assert len(along) == 500 * k
    density = np.abs(np.fft.rfft(along)) ** 2
    above = np.fft.rfftfreq(len(along), 1e-3 / k) > 500.0
    assert (density[above].sum() > 0.1 * density.sum()) == (k > 1)


def form(model):
    return json.loads(model_json(model, "a table"))


async def said(page, sentence):
    while sentence not in (await page.until("status"))["said"]:
        pass


async def test_pages_get_one_surface_and_what_becomes_of_it(tmp_path):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as one,
        visiting(server) as other,
    ):
        hello = await one.until("hello")
        assert hello["names"] == ["a table"]
        assert not hello["scenarios"]
        sharing.offer(flat_texture(2.0), about(20, ready=False))
        await said(one, "listening to a table")
        assert server.player.model_messages == ()  # it is not ready
        for rms_m_s2 in (1.0, 4.0):
            model = flat_texture(rms_m_s2)
            sharing.offer(model, about(49))
            for page in (one, other):
                assert await page.model() == form(model)
        refused = await one.order(do="begin", scenario="matching", participant="P")
        assert refused["text"] == "this page plays a shared surface: it has no scenarios"
        sharing.relay.finish("done")
        await said(other, "the shared session has ended: done: the last state stays")


async def test_a_model_that_no_page_can_render_is_told_and_the_last_one_stays(
    tmp_path, monkeypatch
):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as page,
    ):
        sharing.offer(flat_texture(1.0), about(49))
        first = await page.model()
        with monkeypatch.context() as patch:
            patch.setattr("mmt.texture.model.json_form.MOST_ROWS", 3)
            sharing.offer(flat_texture(2.0), about(49))
            await said(page, "select fewer samples")
        sharing.offer(flat_texture(4.0), about(49))
        assert await page.model() == form(flat_texture(4.0)) != first


async def test_pages_see_the_leaders_hand(tmp_path):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as page,
    ):
        sharing.publish(6)
        await page.model()
        for step in range(4):
            sharing.offer_state(0.1 * step, force_n=float(step % 2), position_mm=(step, -2.0, 9.0))
            hand = await page.until("hand")
            assert (hand["x_mm"], hand["y_mm"]) == (step, -2.0)
            assert hand["touches"] is bool(step % 2)
