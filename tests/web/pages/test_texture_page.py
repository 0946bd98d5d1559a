"""The page of one file in a real browser, opened from disk without a network."""

import base64
import json
from contextlib import asynccontextmanager

import numpy as np
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer
from library_samples import directed, model, stiff
from page_browser import (
    DESKTOP,
    MARKS,
    PHONE,
    a_file,
    a_page,
    api,
    browser,
    fits,
    inked,
    shows,
    until,
)

from mmt.core.errors import InputError
from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import load_model
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt.web.page_server import add_page
from mmt.web.texture_page import MODULE, MOST_BYTES, texture_page

__all__ = ["browser"]
pytestmark = MARKS

RENDER = "([inputs, excitation]) => [...window.mmtTexture.render(...inputs, excitation)]"
PLAYED = "document.querySelector('#played-title').textContent"
LEVEL = f"Number.parseFloat(/level ([\\d.]+)/.exec({PLAYED})?.[1] ?? '0')"


def written(folder, models):
    path = folder / "page.html"
    path.write_bytes(texture_page([model_json(made, name) for name, made in models.items()]))
    return path


@asynccontextmanager
async def of_models(browser, folder, models, *how):
    """The page of models, from disk."""
    async with a_file(browser, written(folder, models), *how, may_warn=True) as page:
        await until(page, "window.mmtTexture !== undefined")
        yield page


async def stroke(page):
    """Stroke until the page plays."""
    box = await page.locator("#surface").bounding_box()
    x, y = box["x"] + 40, box["y"] + box["height"] / 2
    await page.mouse.move(x, y)
    await page.mouse.down()
    for step in range(1500):  # on a busy machine sound begins late
        await page.mouse.move(x + 8 * (step % 30), y)
        if await page.evaluate(LEVEL) > 0.05:
            return
        await page.wait_for_timeout(16)
    pytest.fail("stroking moved no sound")


async def renders_as_python(page, made):
    """See that the page's renderer gives the samples that Python's gives."""
    count = 3000
    time_s = np.arange(count) / 1000.0
    inputs = [200.0 * np.sin(5.0 * time_s), 120.0 * np.cos(3.0 * time_s), 1.0 + np.sin(time_s)]
    if not made.space.directed:
        inputs = [np.hypot(*inputs[:2]), inputs[2]]
    white = np.random.default_rng(1).standard_normal(count)
    expected = Synthesizer(made, seed=4).render(*inputs, excitation=white)
    given = [[values.tolist() for values in inputs], white.tolist()]
    samples = np.array(await page.evaluate(RENDER, given))
    assert np.abs(samples - expected).max() < 1e-9 * expected.std()


@pytest.mark.parametrize("name", ["oak", "felt"])
async def test_the_page_gives_the_samples_that_python_gives(browser, tmp_path, name):
    made = load_model(name)
    async with of_models(browser, tmp_path, {name: made}) as page:
        await renders_as_python(page, made)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE])
async def test_a_stroke_is_heard_shown_and_ends(browser, tmp_path, size, scheme):
    models = {"one": model(), "two": directed()}
    async with of_models(browser, tmp_path, models, size, scheme) as page:
        await fits(page, scheme)
        for name in models:
            await page.click(f"#choice button:text-is('{name}')")
            await stroke(page)
            await shows(page, "#state", "plays here, without a network")
            for picture in ("#plane", "#spectrum", "#played"):
                assert await inked(page, picture) > 500
            await page.mouse.up()
            await until(page, f"{LEVEL} === 0")
        figures = await page.evaluate("window.mmtTexture.figures()")
        assert figures["by"] == "worklet"
        assert 7.0 < figures["conversion"] < 9.0
        await shows(page, "#scale-text", "an amplitude of 1 is 150 m/s²")


async def test_without_a_worklet_the_same_module_plays(browser, tmp_path):
    async with of_models(browser, tmp_path, {"one": model()}) as page:
        await page.evaluate("delete BaseAudioContext.prototype.audioWorklet")
        await stroke(page)
        assert (await page.evaluate("window.mmtTexture.figures()"))["by"] == "script"


async def test_what_is_no_model_is_refused_in_the_page(browser, tmp_path):
    bad, good = tmp_path / "bad.json", tmp_path / "good.json"
    form = json.loads(model_json(model(), "made"))
    bad.write_text(json.dumps({**form, "order": 10_000}))
    good.write_text(json.dumps({**form, "name": "</script><img src=x onerror=alert(1)>"}))
    large = tmp_path / "large.json"
    large.write_bytes(b" " * 10**7)
    async with of_models(browser, tmp_path, {"one": model()}) as page:
        await page.set_input_files("#open", bad)
        await shows(page, "#problem", "its order must be 1 to 64")
        await page.set_input_files("#open", large)
        await shows(page, "#problem", "large.json has 10.0 MB")
        await page.set_input_files("#open", good)
        await shows(page, "#name", "<img src=x")
        await api.expect(page.locator("#problem")).to_be_hidden()


async def test_nothing_from_outside_and_no_other_script_runs(browser, tmp_path):
    name = "</script><script>window.evil = 1</script>"
    said = []
    async with a_page(browser) as page:
        page.on("console", lambda message: said.append(message.text))
        await page.goto(written(tmp_path, {name: stiff(1)}).as_uri())
        await shows(page, "#name", name)
        refused = await page.evaluate(
            """async () => {
                const script = document.createElement("script");
                script.textContent = "window.evil = 2";
                document.body.append(script);
                try { await fetch("http://127.0.0.1:9/"); } catch { return window.evil; }
            }"""
        )
        assert refused is None
        assert any("Content Security Policy" in each for each in said)


async def test_the_element_plays_in_anothers_page(browser):
    page_text = """<!doctype html><script type="module" src="mmt-texture.js"></script>
        <mmt-texture src="a.json"></mmt-texture><mmt-texture src="bad.json"></mmt-texture>"""
    texts = {
        "index.html": page_text,
        "mmt-texture.js": MODULE.read_text(),
        "a.json": model_json(model(), "a"),
        "bad.json": '{"format": "mmt-texture", "version": 7}',
    }
    application = web.Application()
    files = {name: text.encode() for name, text in texts.items()}
    add_page(application, "/page", files)
    async with TestServer(application) as server, a_page(browser) as page:
        await page.goto(str(server.make_url("/page/")))
        bad = page.locator("mmt-texture").nth(1)
        await api.expect(bad).to_contain_text("its version is 7, this page reads 1")
        box = await page.locator("mmt-texture").nth(0).bounding_box()
        await page.mouse.move(box["x"] + 9, box["y"] + 9)
        sound = "document.querySelector('mmt-texture').sound"
        await until(page, f"{sound} !== undefined")
        await page.evaluate(f"void ({sound}.onReport = (rms) => {{ window.rms = rms; }})")
        await page.mouse.down()
        for step in range(400):
            await page.mouse.move(box["x"] + 9 + 8 * (step % 30), box["y"] + 9)
            if await page.evaluate("window.rms > 0.05"):
                break
        assert await page.evaluate("window.rms > 0.05")
        assert (await page.evaluate(f"{sound}.figures()"))["by"] == "worklet"
        await page.mouse.up()
        await until(page, "window.rms === 0")
        await page.focus("mmt-texture")
        await page.keyboard.down("ArrowRight")
        await until(page, "window.rms > 0.05")
        await page.evaluate(f"void (window.context = {sound}.context)")
        await page.evaluate("document.querySelector('mmt-texture').remove()")
        await until(page, "window.context.state === 'closed'")


FOLLOW = """async ([source, strokes]) => {
    const { PointerMotion, heldShare } = await import(`data:text/javascript;base64,${source}`);
    const told = ({ vx, vy, force, touches, holdMs }) =>
        [vx, vy, force, touches, holdMs, heldShare(holdMs, 20), heldShare(holdMs, 300)];
    return strokes.map((points) => {
        const motion = new PointerMotion();
        return points.map((point) => {
            if (point === null) motion.lift();
            else motion.add(...point);
            return told(motion);
        });
    });
}"""
"""What each report of a pointer, or null for its lift, makes of velocity and force."""


async def followed(page, *strokes):
    source = base64.b64encode(MODULE.read_bytes()).decode()
    return await page.evaluate(FOLLOW, [source, strokes])


async def test_what_velocity_and_force_a_pointer_is_taken_to_have(browser, tmp_path):
    intervals = [4.0, 8.3, 16.7, 33.3]
    steady = [[(t, 0.15 * t, -0.15 * t, 1.5) for t in np.arange(40) * each] for each in intervals]
    moved = [*steady[2], None, (5000.0, 900.0, 900.0, 2.0)]
    random = np.random.default_rng(5)
    least, largest = [0.0, -1e4, -1e4, 0.0], [1e6, 1e4, 1e4, 100.0]
    wild = random.uniform(least, largest, (200, 20, 4)).tolist()
    close = [(1.0, 0.0, 0.0, 1.0), (1.0, 50.0, 0.0, 1.0), (1.02, 50.0, 0.0, 1.0)]
    async with of_models(browser, tmp_path, {"one": model()}) as page:
        for told in await followed(page, *steady):
            vx, vy, force, touches, _, held, left = told[-1]
            assert (vx, vy) == pytest.approx((150.0, -150.0), rel=1e-3)
            assert force == pytest.approx(1.5)
            assert touches
            assert held == 1.0  # between two reports
            assert left < 1e-7  # after the last one
        ((*_, lifted, elsewhere),) = await followed(page, moved)
        assert lifted[:4] == [0.0, 0.0, 0.0, False]
        assert elsewhere[:4] == [0.0, 0.0, 2.0, True]  # it has not moved there
        for told in await followed(page, close, *wild):
            for vx, vy, force, touches, hold_ms, *_ in told:
                assert np.hypot(vx, vy) <= 5000.0 * (1 + 1e-9)
                assert 0.0 <= force <= 100.0 * (1 + 1e-9)
                assert touches
                assert 20.0 <= hold_ms <= 50.0


async def test_keys_stroke_to_and_fro_within_the_surface(browser, tmp_path):
    async with of_models(browser, tmp_path, {"one": model()}, PHONE) as page:
        await page.fill("#speed", "300")
        await page.focus("#surface")
        await page.keyboard.down("ArrowRight")
        await page.evaluate(
            """() => {
                window.places = [];
                const box = document.querySelector("#surface"), dot = box.lastElementChild;
                const look = () => {
                    const at = dot.getBoundingClientRect(), edge = box.getBoundingClientRect();
                    if (at.width) window.places.push((at.x + at.width / 2 - edge.x) / edge.width);
                    requestAnimationFrame(look);
                };
                look();
            }"""
        )
        await until(page, "Math.max(...window.places) > 0.9")
        await until(page, "Math.min(...window.places) < 0.1")
        await page.keyboard.up("ArrowRight")
        assert await page.evaluate("window.places.every((place) => place > 0 && place < 1)")


async def test_a_page_is_small_or_refused():
    forms = [model_json(load_model(name), name) for name in ("oak", "felt")]
    assert len(texture_page(forms)) < MOST_BYTES
    assert MODULE.stat().st_size <= 80_000
    with pytest.raises(InputError, match="write fewer into one page"):
        texture_page(forms * 4)
    with pytest.raises(InputError, match="no model was given"):
        texture_page([])
