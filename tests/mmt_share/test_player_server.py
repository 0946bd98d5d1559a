"""The player's server, with pages that have no screen."""

import asyncio
import csv
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from player_samples import NAMES, RATE_HZ, RMS_M_S2, address, playing, visiting

from mmt.core.errors import InputError
from mmt.evaluation.evaluate import evaluate_session
from mmt.session import read_session
from mmt.session.data import missing_frames
from mmt.session.info import info
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.server import TAKEN_OVER


async def test_a_page_hears_the_texture_that_it_strokes(tmp_path: Path) -> None:
    async with playing(tmp_path) as server, visiting(server) as page:
        hello = await page.until("hello")
        assert hello["names"] == list(NAMES)
        assert hello["arrays"]["pictures"].shape[0] == 3
        assert (await page.open())["delay_ms"] == pytest.approx(8.0, abs=0.1)
        for tile in (2, 0):
            await page.stroke(tile, 0.2)
            heard = await page.stroke(tile, 1.0)
            assert np.sqrt(np.mean(heard**2)) == pytest.approx(RMS_M_S2[tile], rel=0.25)
        end = await page.rest(0.2)
        assert np.abs(end[: RATE_HZ // 100]).max() > 0.1
        assert np.abs(end[-RATE_HZ // 20 :]).max() < 1e-3


async def test_what_makes_no_sense_is_counted_and_the_page_goes_on(tmp_path: Path) -> None:
    async with playing(tmp_path) as server, visiting(server) as page:
        for text in ("", "[]", "null", '{"do": 3}', '{"do": "play"}', '{"do": "jump", "id": 4}'):
            await page.socket.send_str(text)
        assert (await page.until("answer"))["text"] == "begin a scenario first"
        assert not (await page.order(do="begin", scenario="none", participant="P"))["ok"]
        assert not (await page.order(do="begin", scenario="matching", participant=" "))["ok"]
        await page.open()
        assert len(await page.play(0, [[1.0, 0.0, 0.0, 1.0]])) == 240
        while (await page.until("status"))["rejected"] < 5:
            pass


async def test_the_newest_page_plays(tmp_path: Path) -> None:
    async with playing(tmp_path) as server, visiting(server) as first:
        await first.open()
        async with visiting(server) as second:
            await second.open()
            async with asyncio.timeout(60):
                while (await first.socket.receive()).type is not aiohttp.WSMsgType.CLOSE:
                    pass
            assert first.socket.close_code == TAKEN_OVER
            assert len(await second.play(None)) == 240


async def test_a_page_without_the_token_hears_nothing(tmp_path: Path) -> None:
    token = "a token that nobody guesses"
    async with playing(tmp_path, token=token) as server:
        async with visiting(server, "another one") as page:
            async with asyncio.timeout(60):
                assert (await page.socket.receive()).data == 4401
        async with visiting(server, token) as page:
            assert (await page.open())["rate_hz"] == RATE_HZ


async def test_pages_of_other_sites_are_refused(tmp_path: Path) -> None:
    async with playing(tmp_path) as server, aiohttp.ClientSession() as http:
        for headers in ({"Origin": "http://elsewhere.example"}, {"Host": "elsewhere.example"}):
            async with http.get(address(server, "/player/socket"), headers=headers) as answer:
                assert answer.status == 403


async def test_nobody_else_reaches_the_player_unless_that_is_allowed(tmp_path: Path) -> None:
    async with playing(tmp_path) as server:
        with pytest.raises(InputError, match="--token-file"):
            await server.start("0.0.0.0", 0)


async def test_a_scenario_outlasts_its_page(tmp_path: Path) -> None:
    async with playing(tmp_path) as server:
        async with visiting(server) as page:
            await page.open()
            assert (await page.order(do="begin", scenario="exploration", participant="P7"))["ok"]
            assert not (await page.order(do="rate", rating=4))["ok"]
            await page.stroke(server.player.study.order[0], 1.2)  # type: ignore[union-attr]
            assert (await page.order(do="rate", rating=4))["ok"]
        async with visiting(server) as page:
            state = await page.until("study")
            assert (state["trial"], state["participant"]) == (2, "P7")
    with (tmp_path / "results.csv").open(newline="") as stream:
        assert [row["event"] for row in csv.DictReader(stream)] == ["begin", "rating", "leave"]


async def test_touches_are_recorded_as_sessions_that_can_be_evaluated(tmp_path: Path) -> None:
    record = tmp_path / "touch.mcap"
    async with playing(tmp_path, record=record) as server, visiting(server) as page:
        await page.open()
        await page.stroke(1, 1.0, 60.0)
        await page.play(None)
        for speed_mm_s in (100.0, 180.0):
            await page.stroke(1, 1.0, speed_mm_s)
        await page.stroke(0, 0.3)
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


async def test_a_recording_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    record = tmp_path / "file" / "t.mcap"
    async with playing(tmp_path, record=record, count=1) as server, visiting(server) as page:
        await page.open()
        await page.stroke(0, 0.1)
        while (problem := (await page.until("status"))["problem"]) is None:
            pass
        assert "recording" in problem
