"""The texture player in a real browser: what a person strokes, hears, and says of it."""

import asyncio
import csv
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from page_browser import DESKTOP, LONGEST_MS, MARKS, TABLET, a_page, api, browser, shows
from player_samples import NAMES, address, playing

from mmt_share.player.server import PlayerServer

__all__ = ["browser"]
pytestmark = MARKS

HEARD = "Number.parseFloat(document.querySelector('#level-text').textContent)"


@asynccontextmanager
async def a_player(
    browser: Any,
    directory: Path,
    size: tuple[int, int] = DESKTOP,
    *,
    script: str = "",
    port: int = 0,
    **how: Any,
) -> AsyncIterator[tuple[Any, PlayerServer]]:
    """A page at a player, with its sound on."""
    async with (
        playing(directory, port=port) as server,
        a_page(browser, size, **how) as (page, problems),
    ):
        await page.add_init_script(script)
        await page.goto(address(server))
        await shows(page, "#connection", "live")
        await api.expect(page.locator(".tile")).to_have_count(3)
        await page.click("#start")
        yield page, server
        assert problems == []


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def silent(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Any]:
    """A page at a player, without sound, for what takes none."""
    directory = tmp_path_factory.mktemp("silent")
    async with playing(directory) as server, a_page(browser) as (page, problems):
        await page.goto(address(server))
        await api.expect(page.locator(".tile")).to_have_count(3)
        yield page
        assert problems == []


async def fits(page: Any) -> bool:
    """Whether nothing has to be scrolled sideways, and every tile is on the screen."""
    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    bottom = "innerHeight - document.querySelector('#grid').getBoundingClientRect().bottom"
    return bool(await page.evaluate(overflow) <= 0 <= await page.evaluate(bottom))


async def hears(page: Any, least: float, most: float) -> None:
    """Wait until a quarter of a second has a level (m/s2) within these."""
    async with asyncio.timeout(LONGEST_MS / 1000):
        while not least <= await page.evaluate(HEARD) <= most:
            await asyncio.sleep(0.05)


async def stroke(page: Any, tile: int) -> None:
    await page.keyboard.press("abc"[tile])
    await page.keyboard.down("ArrowRight")


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "results.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


async def test_arrow_keys_stroke_each_texture_at_its_level(browser: Any, tmp_path: Path) -> None:
    async with a_player(browser, tmp_path) as (page, _):
        await stroke(page, 0)  # 1 m/s2
        await hears(page, 0.7, 1.3)
        await page.keyboard.up("ArrowRight")
        await hears(page, 0.0, 0.0)
        await stroke(page, 2)  # 4 m/s2
        await hears(page, 3.0, 5.0)
        await page.keyboard.up("ArrowRight")
        await hears(page, 0.0, 0.0)
        latency = page.locator("#latency")
        await api.expect(latency).to_have_attribute("data-by", "worklet")
        text = await latency.text_content()
        assert 8.0 < float(text.split("pointer to sound ")[1].split(" ms")[0]) < 10_000.0
        assert "of which" not in text  # a slow round trip is longer than the time ahead
        assert await fits(page)


async def test_pictures_differ(silent: Any) -> None:
    pictures = await silent.evaluate(
        "[...document.querySelectorAll('.tile canvas')].map(canvas => canvas.toDataURL())"
    )
    assert len(set(pictures)) == 3
    assert min(map(len, pictures)) > 2000


async def test_a_mouse_is_heard_while_it_strokes_and_not_beyond_the_grid(
    browser: Any, tmp_path: Path
) -> None:
    async with a_player(browser, tmp_path) as (page, _):
        box = await page.locator(".tile").nth(1).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        await page.mouse.move(x, y)
        await page.mouse.down()
        await page.evaluate("window.loudest = 0")
        watch = f"setInterval(() => {{ window.loudest = Math.max(window.loudest, {HEARD}); }}, 50)"
        await page.evaluate(watch)
        for step in range(2000):
            await page.mouse.move(x + 80 * (step % 2), y + 2 * (step % 9))
            if step % 20 == 0 and await page.evaluate("window.loudest > 0.5"):
                break
        assert await page.evaluate("window.loudest > 0.5")
        await page.mouse.move(2, 2)  # still pressed
        await hears(page, 0.0, 0.0)
        await page.mouse.up()


async def test_a_pen_presses(browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with a_player(browser, tmp_path, TABLET, touch=True) as (page, server):
        felt: list[float] = []
        monkeypatch.setattr(
            server.player, "record", lambda _, motion, __: felt.append(motion.force_n)
        )
        cdp = await page.context.new_cdp_session(page)
        box = await page.locator(".tile").first.bounding_box()

        async def touch(kind: str, *points: dict[str, float]) -> None:
            await cdp.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [*points]})

        at = {"x": box["x"] + 40, "y": box["y"] + 40}
        await touch("touchStart", {**at, "force": 0.7})
        for step in range(10):
            await touch("touchMove", {"x": at["x"] + 8 * step, "y": at["y"], "force": 0.7})
        await shows(page, "#force-name", "Force at full pressure")
        async with asyncio.timeout(LONGEST_MS / 1000):
            while pytest.approx(max(felt, default=0.0), abs=0.02) != 0.7:  # of the slider's 1 N
                await asyncio.sleep(0.05)
        await touch("touchEnd")
        await hears(page, 0.0, 0.0)


async def test_exploration_from_begin_to_the_last_rating(browser: Any, tmp_path: Path) -> None:
    async with a_player(browser, tmp_path, TABLET, scheme="dark") as (page, server):
        dark = await page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert dark == "rgb(20, 24, 27)"
        await page.fill("#participant", "P1")
        await page.click("#begin-form button")
        for trial in range(3):
            await shows(page, "#prompt", f"{trial + 1} of 3")
            study = server.player.study
            assert study is not None
            asked = study.order[trial]
            await api.expect(page.locator(".tile.asked")).to_contain_text(NAMES[asked])
            rating = page.locator("#rating-buttons button").nth(trial)
            await api.expect(rating).to_be_disabled()
            await stroke(page, asked)
            await api.expect(rating).to_be_enabled(timeout=LONGEST_MS)
            await page.keyboard.up("ArrowRight")
            await page.keyboard.press(str(trial + 1))
        await shows(page, "#prompt", "All 3 textures are rated")
        written = rows(tmp_path)
        assert [row["event"] for row in written] == ["begin", "rating", "rating", "rating"]
        assert [row["rating"] for row in written[1:]] == ["1", "2", "3"]
        assert [row["sample"] for row in written[1:]] == [NAMES[texture] for texture in study.order]
        assert await fits(page)
        await page.click("#leave")
        await api.expect(page.locator("#begin-form")).to_be_visible()


async def test_matching_from_begin_to_the_count(browser: Any, tmp_path: Path) -> None:
    async with a_player(browser, tmp_path) as (page, server):
        await page.select_option("#scenario", "matching")
        await page.fill("#participant", "P2")
        await page.keyboard.press("Enter")
        await shows(page, "#prompt", "Which tile feels like")
        await api.expect(page.locator(".tile.hidden")).to_have_count(3)
        assert await fits(page)
        grid = await page.locator("#grid").inner_text()
        assert not any(name in grid for name in NAMES)
        study = server.player.study
        assert study is not None
        under = [study.texture(tile) for tile in range(3)]
        for sample in study.order:
            await shows(page, "#prompt", f"feels like {NAMES[sample]}?")
            await page.keyboard.press("abc"[under.index(sample)])
            await page.keyboard.press("Enter")
            await shows(page, "#answer", f"{NAMES[sample]} is tile")
        await page.click("#finish")
        await shows(page, "#prompt", "3 of 3 match. How real")
        await api.expect(page.locator(".tile.right")).to_have_count(3)
        assert NAMES[0] in await page.locator("#grid").inner_text()
        await page.locator("#rating-buttons button").nth(4).click()
        await shows(page, "#prompt", "Thank you")
        written = rows(tmp_path)
        assert [row["event"] for row in written] == ["begin", *["answer"] * 3, "finish", "rating"]
        assert [row["correct"] for row in written] == ["", "1", "1", "1", "3", ""]
        assert written[-1]["rating"] == "5"


async def test_a_hidden_page_is_silent_and_goes_on_when_it_is_back(
    browser: Any, tmp_path: Path
) -> None:
    hide = """hidden => {
        Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });
        document.dispatchEvent(new Event('visibilitychange'));
    }"""
    async with a_player(browser, tmp_path) as (page, _):
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await page.evaluate(hide, True)
        await shows(page, "#start", "Start sound")
        await api.expect(page.locator(".tile.touched")).to_have_count(0)
        await page.keyboard.up("ArrowRight")
        await page.evaluate(hide, False)
        await shows(page, "#start", "Stop sound")
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)


async def test_a_lost_connection_falls_silent_and_is_found_again(
    browser: Any, tmp_path: Path, unused_tcp_port: int
) -> None:
    async with a_player(browser, tmp_path, port=unused_tcp_port) as (page, server):
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await server.stop()
        await shows(page, "#connection", "connection lost")
        await hears(page, 0.0, 0.0)
        await server.start("127.0.0.1", unused_tcp_port)
        await shows(page, "#connection", "live")
        await hears(page, 1.4, 2.6)


async def test_without_a_worklet_the_page_plays_by_itself(browser: Any, tmp_path: Path) -> None:
    lacking = "Object.defineProperty(BaseAudioContext.prototype, 'audioWorklet', {get() {}});"
    async with a_player(browser, tmp_path, script=lacking) as (page, _):
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await shows(page, "#latency", "no worklet")


async def test_what_is_played_is_bounded_and_never_breaks_off(silent: Any) -> None:
    bounds = await silent.evaluate(
        """async () => {
            const { limited } = await import('/player/playout.js');
            return [0, 0.5, -0.5, 0.9, 1e9, -1e9, NaN, Infinity].map(limited);
        }"""
    )
    assert bounds[:3] == [0, 0.5, -0.5]
    assert bounds[3:] == pytest.approx([0.8924, 1, -1, 0, 1], abs=1e-4)
    played, lacked = await silent.evaluate(
        """async () => {
            const { Playout } = await import('/player/playout.js');
            const playout = new Playout(), output = new Float32Array(1024);
            playout.add(new Float32Array(500).fill(15), 1, 1 / 30);
            playout.fill(output, 0);
            playout.add(new Float32Array(500).fill(15), 2, 1 / 30);
            const more = new Float32Array(256);
            playout.fill(more, 1024);
            return [[...output, ...more], playout.report().lacked];
        }"""
    )
    steps = [abs(b - a) for a, b in zip([0.0, *played], played, strict=False)]
    assert max(steps) < 0.02  # of 0.5: no click at the start, the gap, and the return
    assert max(played) == pytest.approx(0.5)
    assert max(played[900:1024]) < 1e-3
    assert lacked == 524


async def test_the_buffer_follows_what_is_lacking_and_spare(silent: Any) -> None:
    first, more, most, least = await silent.evaluate(
        """async () => {
            const { Lead } = await import('/player/sound.js');
            const lead = new Lead(48000), sizes = [lead.samples];
            lead.take({ lacked: 300, least: 0, counted: 256 });
            sizes.push(lead.samples);
            for (let i = 0; i < 99; i++) lead.take({ lacked: 256, least: 0, counted: 256 });
            sizes.push(lead.samples);
            for (let i = 0; i < 9999; i++) {
                lead.take({ lacked: 0, least: lead.samples, counted: 256 });
            }
            return [...sizes, lead.samples];
        }"""
    )
    assert (first, more, most, least) == (960, 1260, 14_400, 288)
