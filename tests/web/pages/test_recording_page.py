"""A recording's page in a real browser: what is on the screen while a person looks through it."""

import re

import numpy as np
import pytest
from page_browser import (
    DESKTOP,
    MARKS,
    PICTURES,
    TABLET,
    a_page,
    api,
    browser,
    fits,
    inked,
    shows,
)
from recording_server import serving

from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.data import OutputBlock, RecordedSession
from mmt.session.files import export_session
from mmt.session.stream import open_windows
from mmt.testing.simulation.offline import simulate_session
from mmt.web.viewing.rebuilding import ModelRebuild
from mmt.web.viewing.recording import ViewedRecording

__all__ = ["browser"]
pytestmark = MARKS

SECONDS = 8.0
EVENTS = [
    {"time_s": 0.0, "event": "follower connected (simulated)"},
    {"time_s": 0.5, "event": "clocks compared", "clock_time_ns": 0, "clock_offset_ns": 2_000_000}
    | {"clock_drift_ppm": 0.0, "clock_uncertainty_ns": 50_000},
    {"time_s": 3.0, "kind": "gap", "event": "frames are missing", "frames": 12},
    {"time_s": 4.0, "event": "vibration synthesized", "mode": "synthesized"},
    {"time_s": 5.25, "event": "marked: knock", "mark": "knock"},
]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    tables = {"link": {}, "simulated": {}, "hand": {}, "texture": {"surfaces": {}}}
    frames, _ = simulate_session(Scene(), "plastic", SECONDS)
    rng = np.random.default_rng(1)
    outputs = [
        OutputBlock(begin / 1e3, "streamed" if begin < 4000 else "synthesized", rng.normal(size=20))
        for begin in range(0, 8000, 20)
    ]
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    scene = scene_from_tables(tables).dump()
    export_session(RecordedSession(frames, scene=scene, events=EVENTS, outputs=outputs), path)
    return path


def viewing(path):
    """Serve a recording; give the page's address."""
    return serving(ViewedRecording(open_windows(path)))


async def at(page):
    """Return the moment that is shown, in seconds."""
    text = await page.locator("#time").inner_text()
    return text.removesuffix(" s")


async def built(page):
    """Wait until the model is built: the remark that leaves then moves what stands below it."""
    await api.expect(page.locator("#remarks")).to_have_text("")


@pytest.mark.parametrize(
    ("size", "scheme"), [(DESKTOP, "light"), (TABLET, "dark")], ids=["desktop", "tablet"]
)
async def test_a_person_goes_through_a_recording(browser, recorded, size, scheme):
    async with viewing(recorded) as url, a_page(browser, size, scheme) as page:
        await page.goto(url)
        await shows(page, "#session", "run.mcap")
        await built(page)
        await shows(page, "#time", "4.00 s")  # the switch
        await page.keyboard.press("End")
        await shows(page, "#plane-text", "samples, order")
        await shows(page, "#completion-text", "start met at")
        await shows(page, "#now", "from the model")
        await shows(page, "#surface", "surface 1 (1 known)")
        await shows(page, "#link-figures", "12")
        await shows(page, "#link-figures", "2.000 ± 0.050 ms")
        for canvas in PICTURES:
            await page.wait_for_function(
                "selector => document.querySelector(selector)?.width > 100", arg=canvas
            )
            assert await inked(page, canvas) > 100, canvas
        await fits(page, scheme)
        for absent in ("#controls", "#token-form", "#tick-figures"):
            await api.expect(page.locator(absent)).to_be_hidden()
        await page.keyboard.press("Home")
        await shows(page, "#time", "0.00 s")
        await shows(page, "#plane-text", "No model yet")
        await page.keyboard.press("ArrowRight")
        await shows(page, "#time", "1.00 s")
        await shows(page, "#now", "streamed")
        await shows(page, "#connection", "recorded")
        await shows(page, "#h-plane", "at this moment")
        assert "gains most" not in await page.locator("main").inner_text()


async def test_a_moment_before_any_model_is_not_said_to_be_built_for_ever(
    browser, recorded, monkeypatch
):
    recording = ViewedRecording(open_windows(recorded))
    with monkeypatch.context() as held:
        held.setattr(ModelRebuild, "start", lambda _: None)
        async with serving(recording) as url, a_page(browser) as page:
            await page.goto(f"{url}#t=0.1")
            await shows(page, "#plane-text", "The model of this moment is being built.")
            held.undo()
            recording.start()
            await shows(page, "#plane-text", "No model yet.")


async def test_panels_share_a_time_line(browser, recorded):
    async with viewing(recorded) as url, a_page(browser) as page:
        await page.goto(url + "#t=2")
        await built(page)
        await shows(page, "#time", "2.00 s")
        moment = page.locator("#time")
        await page.locator("#position").scroll_into_view_if_needed()
        box = await page.locator("#force-plot .u-over").bounding_box()

        async def point(share):
            await page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)

        async def click(share, time_s):
            """Click once what is there shows the span, as a person does."""
            await point(share)
            await read("#force-plot", time_s)
            await page.mouse.down()
            await page.mouse.up()
            await api.expect(moment).to_have_text(re.compile(time_s))

        async def read(panel, time_s):
            value = page.locator(f"{panel} .u-value").first
            await api.expect(value).to_have_text(re.compile(time_s))

        await point(0.5)
        for panel in ("#force-plot", "#position", "#completion"):
            await read(panel, r"^[34]\.\d*$|^4$")  # of 8 s, the half
        await page.mouse.down()
        await point(0.6)
        await point(0.75)
        await page.mouse.up()
        await click(0.5, r"^(4\.9|5\.0|5$|5 )")  # of 4 to 6 s
        await page.keyboard.press("Home")  # the span follows
        await shows(page, "#time", "0.00 s")
        await click(0.5, r"^(0\.9|1\.0|1$)")
        await page.keyboard.press("[")
        await click(0.99, r"^(2\.[5-9]|3\.)")


async def test_a_moment_is_reached_by_address_event_and_slider(browser, recorded):
    async with viewing(recorded) as url, a_page(browser, TABLET) as page:
        await page.goto(url + "#t=6.5")
        await built(page)
        await shows(page, "#time", "6.50 s")
        await page.keyboard.press("ArrowLeft")
        await api.expect(page).to_have_url(f"{url}#t=5.50")
        await page.reload()
        await shows(page, "#time", "5.50 s")
        await built(page)
        await page.get_by_role("button", name="marked: knock").click()
        await shows(page, "#time", "5.25 s")
        await shows(page, "#events li[aria-current]", "marked: knock")
        assert await page.locator("#slider-marks .mark").count() == 1
        assert await page.locator("#slider-marks .gap").count() == 1
        assert await page.locator("#events li").count() == 4  # clocks are not for a person
        await page.evaluate("scrollTo(0, 0)")
        box = await page.locator("#slider").bounding_box()
        await page.mouse.move(box["x"] + 8, box["y"] + box["height"] / 2)
        await page.mouse.down()
        await page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        await page.mouse.up()
        at = await page.evaluate("document.querySelector('#slider').valueAsNumber")
        assert at == pytest.approx(SECONDS / 2, abs=0.5)
        await shows(page, "#time", f"{at:.2f} s")


async def test_a_recording_is_played_by_keys_that_are_listed(browser, recorded):
    async with viewing(recorded) as url, a_page(browser) as page:
        await page.goto(url + "#t=0")
        await shows(page, "#at", "0.00 of 8.0")
        await page.click("#help-open")
        help_text = await page.locator("#help").inner_text()
        assert "play, pause" in help_text
        assert "save the model" not in help_text
        await page.keyboard.press("ArrowRight")  # while the list is open keys do nothing
        await page.click("#help-close")
        await shows(page, "#at", "0.00 of 8.0")
        await page.keyboard.press("+")
        await api.expect(page.locator("#speed")).to_have_value("2")
        await page.select_option("#speed", "50")
        await page.click("#play")
        await shows(page, "#play", "Play")  # it stops at the end by itself
        await shows(page, "#now", "from the model")
        length = await page.evaluate("document.querySelector('#slider').max")
        assert float(length) == pytest.approx(SECONDS, abs=0.1)
        await shows(page, "#time", f"{float(length):.2f} s")
        await page.select_option("#speed", "0.1")
        await page.evaluate("document.activeElement.blur()")
        await page.keyboard.press("Home")
        await page.keyboard.press("Space")
        await shows(page, "#play", "Pause")
        await page.wait_for_function("document.querySelector('#slider').valueAsNumber > 0")
        await page.keyboard.press("Space")
        await shows(page, "#play", "Play")


async def test_without_recorded_output_the_model_of_the_moment_is_rendered(browser, tmp_path):
    frames, _ = simulate_session(Scene(), "plastic", 6.0)
    export_session(RecordedSession(frames), tmp_path / "raw.npz")
    async with viewing(tmp_path / "raw.npz") as url, a_page(browser) as page:
        await page.goto(url)
        await shows(page, "#remarks", "by the defaults")
        await api.expect(page.locator("#remarks")).not_to_contain_text("being built")
        await shows(page, "#completion-text", "start met at")
        met = await page.locator("#completion-text").inner_text()
        switch = re.search(r"start met at ([\d.]+) s", met)
        assert float(await at(page)) == pytest.approx(float(switch[1]), abs=0.06)
        await page.keyboard.press("End")
        await shows(page, "#why", "this is rendered from the model of this moment")
        await api.expect(page.locator("#link-panel")).to_be_hidden()


CHANGES = """() => {
    window.changes = 0;
    new MutationObserver(() => { window.changes += 1; }).observe(
        document.querySelector('#connection'), { childList: true });
}"""


async def test_the_page_says_what_has_failed_and_leaves_it_with_the_person(
    browser, recorded, monkeypatch
):
    async with a_page(browser) as page:
        recording = ViewedRecording(open_windows(recorded))
        state_at = recording.state_at

        def broken(time_s):
            if time_s > 6.0:
                raise InputError("the end is broken")
            return state_at(time_s)

        monkeypatch.setattr(recording, "state_at", broken)
        async with serving(recording) as url:
            await page.goto(url)
            await built(page)
            await page.keyboard.press("End")
            await shows(page, "#connection", "the end is broken")
            await page.evaluate(CHANGES)
            await page.wait_for_timeout(2500)  # other answers come meanwhile
            assert await page.evaluate("window.changes") == 0
            await page.keyboard.press("Home")
            await shows(page, "#time", "0.00 s")
            await shows(page, "#connection", "recorded")
        await shows(page, "#connection", "mmt session view has ended")
