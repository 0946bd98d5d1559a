"""The texture player in a real browser: what a person strokes, hears, and says of it."""

import asyncio
import json
from contextlib import asynccontextmanager

import numpy as np
import pytest
import pytest_asyncio
from page_browser import (
    DESKTOP,
    LONGEST_MS,
    MARKS,
    OVERFLOW,
    PHONE,
    TABLET,
    a_page,
    api,
    browser,
    shows,
    until,
)
from player_samples import NAMES, RMS_M_S2, address, flat_texture, playing, rows_of, textures
from sharing_samples import about, playing_shared, shared

from mmt.texture.model.json_form import model_json
from mmt.web.page_server import pack

__all__ = ["browser"]
pytestmark = MARKS

HEARD = "Number.parseFloat(document.querySelector('#level-text').textContent)"


@asynccontextmanager
async def a_player(browser, directory, size=DESKTOP, *, script="", port=0, record=False, **how):
    """A page at a player, with all its models."""
    async with (
        playing(
            directory, port=port, record=directory / "touch.mcap" if record else None
        ) as server,
        a_page(browser, size, **how) as page,
    ):
        await page.add_init_script(script)
        await page.goto(address(server))
        await shows(page, "#connection", "live")
        await painted(page)
        yield page, server


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def silent(browser, tmp_path_factory):
    """A page at a player, without sound, for what takes none."""
    directory = tmp_path_factory.mktemp("silent")
    async with playing(directory) as server, a_page(browser) as page:
        await page.goto(address(server))
        await painted(page)
        yield page


async def painted(page):
    """Wait until all textures have come."""
    count = "[...document.querySelectorAll('.tile canvas')].filter((node) => node.width > 1).length"
    await until(page, f"{count} === 3")


async def fits(page):
    """Whether nothing has to be scrolled sideways, and every tile is on the screen."""
    bottom = "innerHeight - document.querySelector('#grid').getBoundingClientRect().bottom"
    return bool(await page.evaluate(OVERFLOW) <= 0 <= await page.evaluate(bottom))


async def hears(page, least, most):
    """Wait until a quarter of a second has a level (m/s2) within these."""
    await until(page, f"(({HEARD}) - {least}) * (({HEARD}) - {most}) <= 0")


async def stroke(page, tile):
    await page.keyboard.press("abc"[tile])
    await page.keyboard.down("ArrowRight")


async def test_arrow_keys_stroke_each_texture_at_its_level(browser, tmp_path):
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
        figures = await page.evaluate("window.mmtTexture.figures()")
        assert figures["conversion"] == pytest.approx(8.0, abs=0.1)
        total = float((await latency.text_content()).split("hand to sound ")[1].split(" ms")[0])
        assert 8.0 < total < 10_000.0
        assert await fits(page)


async def test_a_mouse_is_heard_while_it_strokes_and_not_beyond_the_grid(browser, tmp_path):
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
        await page.evaluate("window.loudest = 0")
        for step in range(60):
            await page.mouse.move(2 + 80 * (step % 2), 2)
            await page.wait_for_timeout(10)
        assert await page.evaluate("window.loudest") == 0.0
        await page.mouse.up()


async def test_a_pen_presses(browser, tmp_path, monkeypatch):
    async with a_player(browser, tmp_path, TABLET, has_touch=True, record=True) as (page, server):
        felt = []
        monkeypatch.setattr(
            server.player, "stroke", lambda _, steps: felt.extend(step.force_n for step in steps)
        )
        cdp = await page.context.new_cdp_session(page)
        box = await page.locator(".tile").first.bounding_box()

        async def touch(kind, *points):
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


async def test_exploration_from_begin_to_the_last_rating(browser, tmp_path):
    async with a_player(browser, tmp_path, TABLET, scheme="dark") as (page, server):
        dark = await page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert dark == "rgb(20, 24, 27)"
        await page.click("#study summary")
        await page.fill("#participant", "P1")
        await page.click("#begin-form button")
        for trial in range(3):
            await shows(page, "#prompt", f"{trial + 1} of 3")
            study = server.player.study
            asked = study.order[trial]
            await api.expect(page.locator(".tile.asked")).to_contain_text(NAMES[asked])
            rating = page.locator("#rating-buttons button").nth(trial)
            await api.expect(rating).to_be_disabled()
            await stroke(page, asked)
            await api.expect(rating).to_be_enabled(timeout=LONGEST_MS)
            await page.keyboard.up("ArrowRight")
            await page.keyboard.press(str(trial + 1))
        await shows(page, "#prompt", "All 3 textures are rated")
        written = rows_of(tmp_path / "results.csv")
        assert [row["event"] for row in written] == ["begin", "rating", "rating", "rating"]
        assert [row["rating"] for row in written[1:]] == ["1", "2", "3"]
        assert [row["sample"] for row in written[1:]] == [NAMES[texture] for texture in study.order]
        assert await fits(page)
        await page.click("#leave")
        await api.expect(page.locator("#begin-form")).to_be_visible()


async def test_matching_from_begin_to_the_count(browser, tmp_path):
    async with a_player(browser, tmp_path) as (page, server):
        await page.click("#study summary")
        await page.select_option("#scenario", "matching")
        await page.fill("#participant", "P2")
        await page.keyboard.press("Enter")
        await shows(page, "#prompt", "Which tile feels like")
        await api.expect(page.locator(".tile.hidden")).to_have_count(3)
        assert await fits(page)
        grid = await page.locator("#grid").inner_text()
        assert not any(name in grid for name in NAMES)
        study = server.player.study
        under = [study.texture(tile) for tile in range(3)]
        for sample in study.order:
            await shows(page, "#prompt", f"feels like {NAMES[sample]}?")
            await page.keyboard.press("abc"[under.index(sample)])
            await page.dblclick("#answer-tile")  # still one answer
        await page.click("#finish")
        await shows(page, "#prompt", "3 of 3 match. How real")
        await api.expect(page.locator(".tile.right")).to_have_count(3)
        assert NAMES[0] in await page.locator("#grid").inner_text()
        await page.locator("#rating-buttons button").nth(4).click()
        await shows(page, "#prompt", "Thank you")
        written = rows_of(tmp_path / "results.csv")
        assert [row["event"] for row in written] == ["begin", *["answer"] * 3, "finish", "rating"]
        assert [row["correct"] for row in written] == ["", "1", "1", "1", "3", ""]
        assert written[-1]["rating"] == "5"
        await page.click("#leave")
        await page.fill("#participant", "P3")
        await page.click("#begin-form button")
        await shows(page, "#answer", "matching of P3 begins")
        await shows(page, "#prompt", f"feels like {NAMES[server.player.study.order[0]]}?")


async def test_a_hidden_page_is_silent_and_goes_on_when_it_is_back(browser, tmp_path):
    hide = """hidden => {
        Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });
        document.dispatchEvent(new Event('visibilitychange'));
    }"""
    async with a_player(browser, tmp_path) as (page, _):
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await page.evaluate(hide, True)
        await api.expect(page.locator(".tile.touched")).to_have_count(0)
        await page.keyboard.up("ArrowRight")
        await page.evaluate(hide, False)
        await hears(page, 0.0, 0.0)
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)


async def test_a_page_plays_on_without_its_server_and_says_so(browser, tmp_path, unused_tcp_port):
    async with a_player(browser, tmp_path, port=unused_tcp_port) as (page, server):
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await server.stop()
        await shows(page, "#connection", "this page plays on with the last models")
        await page.keyboard.up("ArrowRight")
        await hears(page, 0.0, 0.0)
        await stroke(page, 2)  # a stroke that begins without it is heard as well
        await hears(page, 3.0, 5.0)
        await page.click("#study summary")
        await page.fill("#participant", "P")
        await page.click("#begin-form button")
        await shows(page, "#answer", "there is no connection to the player")
        await server.start("127.0.0.1", unused_tcp_port)
        await shows(page, "#connection", "live")
        await hears(page, 3.0, 5.0)


LIVE = """async ([forms, turns]) => {
    const { FULL_SCALE_M_S2, LiveRenderer, parseModel } = await import('/player/mmt-texture.js');
    const models = forms.map(parseModel), renderer = new LiveRenderer(48000, 3), all = [];
    for (const turn of turns) {
        const hand = { vx: 120, vy: 0, force: 1, holdMs: Infinity, touches: turn !== null };
        renderer.take({ hand, ...(turn === null ? {} : { model: models[turn] }) });
        const output = new Float32Array(240);
        renderer.fill(output);
        all.push(...output.map((sample) => sample * FULL_SCALE_M_S2));
    }
    return all;
}"""


async def live(page, turns):
    """Return what the page plays (m/s2) if each 5 ms another texture is touched, or none."""
    forms = [model_json(model, "made") for model in textures()]
    return np.array(await page.evaluate(LIVE, [forms, turns]))


async def test_each_texture_has_its_level_and_falls_silent_without_a_click(silent):
    for texture, rms_m_s2 in enumerate(RMS_M_S2):
        sound = await live(silent, [texture] * 2000 + [None] * 40)
        stroked, after = np.split(sound, [480_000])
        assert np.sqrt(np.mean(stroked[48_000:] ** 2)) == pytest.approx(rms_m_s2, rel=0.1)
        assert np.abs(after[:240]).max() > 0.1 * rms_m_s2
        assert np.abs(after[4800:]).max() < 1e-6
        assert np.abs(np.diff(after)).max() < 1.2 * np.abs(np.diff(stroked)).max()


async def test_quick_changes_between_textures_stay_within_what_each_does(silent):
    sound = await live(silent, [turn % 3 for turn in range(600)])
    assert np.abs(sound).max() < 6.0 * max(RMS_M_S2)
    assert min(RMS_M_S2) < np.sqrt(np.mean(sound**2)) < max(RMS_M_S2)
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)))) ** 2
    beyond = spectrum[np.fft.rfftfreq(len(sound), 1 / 48_000) > 650.0]
    assert beyond.sum() < 1e-4 * spectrum.sum()  # a click would be heard there


async def test_a_hostile_model_is_refused_with_a_sentence_and_the_last_one_stays(browser, tmp_path):
    async with a_player(browser, tmp_path) as (page, server):
        form = json.loads(model_json(textures()[0], NAMES[0]))
        message = {"texture": 0, "form": json.dumps({**form, "order": 10_000})}
        server.player.model_messages = (pack("model", message, {}),)
        await shows(page, "#answer", f"{NAMES[0]}: This is no texture model")
        await shows(page, "#answer", "its order must be 1 to 64")
        await stroke(page, 0)
        await hears(page, 0.7, 1.3)


async def test_without_a_sound_device_the_page_says_so_and_tries_again(browser, tmp_path):
    lacking = """window.resume = AudioContext.prototype.resume;
        AudioContext.prototype.resume = () => new Promise(() => {});"""
    async with a_player(browser, tmp_path, script=lacking) as (page, _):
        await stroke(page, 1)
        await shows(page, "#answer", "No sound: the browser finds no sound device")
        await page.evaluate("void (AudioContext.prototype.resume = window.resume)")
        await page.keyboard.up("ArrowRight")
        await stroke(page, 1)
        await hears(page, 1.4, 2.6)
        await api.expect(page.locator("#answer")).to_be_empty()


async def test_a_visitor_feels_the_model_as_it_becomes_and_after_its_end(browser, tmp_path):
    async with shared() as sharing, a_page(browser, PHONE) as page:
        async with playing_shared(sharing, tmp_path) as server:
            await page.goto(address(server))
            await shows(page, ".tile", "not ready yet: the leader still explores the surface")
            sharing.publish(40, ready=False)
            await shows(page, ".tile", "not ready yet: completion sum 5.00")
            for hidden in ("#study", "#help", "#controls"):
                await api.expect(page.locator(hidden)).to_be_hidden()
            sharing.offer(flat_texture(1.0), about(49))
            await shows(page, ".tile", "touch to feel")
            box = await page.locator(".tile").bounding_box()
            assert box["width"] > 0.85 * PHONE[0]
            assert box["height"] > 0.5 * PHONE[1]
            assert await page.evaluate(OVERFLOW) <= 0
            sharing.offer_state(1.0, force_n=1.0)
            await api.expect(page.locator(".tile.led")).to_have_count(1)
            await stroke(page, 0)
            await hears(page, 0.7, 1.3)
            sharing.offer(flat_texture(4.0), about(49))
            await hears(page, 3.0, 5.0)
            sharing.relay.finish("done")
            await shows(page, "#recording", "has ended: done: the last state stays")
        await shows(page, "#connection", "this page plays on")
        await hears(page, 3.0, 5.0)
