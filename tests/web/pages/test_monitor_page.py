"""The monitor's page in a real browser: what is on the screen while a leader runs."""

import asyncio
import re
from pathlib import Path

import numpy as np
import pytest
from page_browser import (
    DESKTOP,
    MARKS,
    PHONE,
    PICTURES,
    TABLET,
    a_page,
    api,
    browser,
    fits,
    inked,
    shows,
)
from sharing_samples import listening, until

from mmt.follower.service import Follower
from mmt.leader.service import Leader
from mmt.link.access import TOKEN_VARIABLE
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.model.texture_model import TextureModel
from mmt.web.page_server import monitor_files
from mmt_share.control_messages import MOTION_DTYPE
from mmt_share.parts.control import ControlPart
from mmt_share.parts.sharing import SharingPart

__all__ = ["browser"]
pytestmark = MARKS

LARGEST_BYTES = 250_000
TOKEN = "a token that nobody guesses"


PARTS = ("simulated", "hand", "texture", "rendering", "playout", "actuator", "monitor")


def scene(port=0, **tables):
    usual = {
        "session": {"name": "shown", "duration_s": 600.0},
        "link": {"port": port},
        "network": {"profile": "lan"},
        **{name: {} for name in PARTS},
    }
    return scene_from_tables({**usual, **tables})


class Leading:
    """A leader whose frames a test hands over itself, so that no clock is waited for."""

    def __init__(self, port=0, **tables):
        self.service = Leader(scene(port, **tables))
        self._sent = 0

    async def __aenter__(self):
        ready = asyncio.Event()
        self.running = asyncio.create_task(self.service.run(ready.set))
        await ready.wait()
        return self

    async def __aexit__(self, *_):
        self.service.stop()
        await self.running

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.service.port}/"

    @property
    def url(self) -> str:
        return f"{self.origin}monitor/"

    async def model(self, seconds):
        """Let the model take a simulated session of this length."""
        frames, _ = simulate_session(self.service.scene, "plastic", seconds)
        frames["sequence"] += self._sent
        frames["time_ns"] += 1_000_000 * self._sent
        self._sent += len(frames)
        modelling = self.service.parts.modelling
        assert modelling is not None
        for second in np.array_split(frames, round(seconds)):
            self.service.parts.call("on_frames", second, 0)
            await modelling.finish(10.0)


async def operate(control, who):
    """Send the motion of a hand at rest, as an operator at another machine does."""
    records = np.zeros(1, MOTION_DTYPE)
    while True:
        records["time_ns"] += 20_000_000
        data = (1).to_bytes(4, "little") + records.tobytes()
        control.receive({"control": "motion", "who": who, "data": data.hex()})
        await asyncio.sleep(0.02)


@pytest.mark.parametrize(
    ("size", "scheme"), [(DESKTOP, "light"), (TABLET, "dark")], ids=["desktop", "tablet"]
)
async def test_a_person_sees_the_model_grow(browser, size, scheme):
    published = {"method": "published"}
    async with a_page(browser, size, scheme) as page, Leading(texture=published) as leading:
        await page.goto(leading.url)
        await shows(page, "#connection", "live")
        await shows(page, "#session", "shown")
        await shows(page, "#now", "waiting for the follower")
        await shows(page, "#plane-text", "No model yet")
        await leading.model(6.0)
        await shows(page, "#plane-text", "samples, order")
        await shows(page, "#plane-text", "A stroke at about")
        await shows(page, "#h-completion", "Completion sum")
        await shows(page, "#completion-text", "start met at")
        await shows(page, "#events", "start criterion met")
        await page.wait_for_function(
            "document.querySelector('#tick-figures').innerText.includes('ms')"
        )
        for canvas in PICTURES:
            assert await inked(page, canvas) > 100, canvas
        await api.expect(page.locator("#surface")).to_be_hidden()
        await api.expect(page.locator("#listeners-panel")).to_be_hidden()
        await fits(page, scheme)


@pytest.mark.parametrize(("inputs", "place"), [("isotropic", "mm/s and"), ("anisotropic", "°")])
async def test_a_model_that_knows_its_error_says_where_to_stroke_next(browser, inputs, place):
    texture = {"inputs": inputs, "stop_share": 0.999}
    async with a_page(browser, TABLET, "dark") as page, Leading(texture=texture) as leading:
        await page.goto(leading.url)
        await shows(page, "#h-completion", "Expected share")
        await shows(page, "#completion-text", "Nothing is modelled yet")
        before = await inked(page, "#plane")
        await leading.model(4.0)
        await shows(page, "#plane-text", "A stroke at about")
        await shows(page, "#plane-text", place)
        await shows(page, "#plane-text", "gains most.")
        # another cell may lack most: said beside the stroke, one would contradict the other
        assert "Lacks most" not in await page.inner_text("#plane-text")
        await shows(page, "#plane-numbers", "share of a cell's strokes")
        await shows(page, "#completion-text", "now; start")
        await shows(page, "#completion-text", "stop at 1.00")
        assert await inked(page, "#plane") > before
        leading.service.reset_model()
        await shows(page, "#plane-text", "No model yet.")
        await shows(page, "#completion-text", "Nothing is modelled yet")
        assert "A stroke" not in await page.inner_text("#plane-text")


async def test_the_surface_under_the_tool_is_named_where_there_are_several(browser):
    several = {"surfaces": {}}
    async with a_page(browser, TABLET) as page, Leading(texture=several) as leading:
        await page.goto(leading.url)
        await leading.model(2.0)
        await shows(page, "#surface", "surface 1 (1 known)")
        await page.select_option("#surface-said", label="another surface")
        await shows(page, "#answer", "a new surface, 2")
        await leading.model(1.0)
        await shows(page, "#surface", "surface 2 (2 known)")
        await page.select_option("#surface-said", label="surface 1 again")
        await leading.model(1.0)
        await shows(page, "#surface", "surface 1 (2 known)")


async def test_another_leader_at_the_address_is_found_and_shown_with_nothing_of_the_last(
    browser, unused_tcp_port, monkeypatch
):
    monkeypatch.setenv("MMT_CONTROL_TOKEN", TOKEN)
    async with a_page(browser) as page:
        async with Leading(unused_tcp_port, sharing={"port": 0}, control={}) as leading:
            await page.goto(leading.url)
            await shows(page, "#connection", "live")
            await shows(page, "#listeners-text", "0 listening")
            await shows(page, "#control-text", "The leader's hand moves the robot.")
            await api.expect(page.locator("#network")).to_have_value("lan")
            leading.service.stop()
            await shows(page, "#connection", "session over: stopped")
            for control in ("#save", "#record", "#reset", "#mark", "#force"):
                await api.expect(page.locator(control)).to_be_disabled()
            await fits(page, "light")  # what is over can be read as well
        held = []  # by a tunnel to a machine that is gone, for instance
        deaf = await asyncio.start_server(
            lambda *pair: held.append(pair), "127.0.0.1", unused_tcp_port
        )
        await until(lambda: held)
        deaf.close()
        async with Leading(unused_tcp_port, network={"profile": "wifi"}):
            await shows(page, "#connection", "live")
            await api.expect(page.locator("#answer")).to_be_empty()
            await api.expect(page.locator("body.lost")).to_have_count(0)
            await api.expect(page.locator("#network")).to_have_value("wifi")
            await api.expect(page.locator("#control")).to_be_hidden()
            await api.expect(page.locator("#listeners-panel")).to_be_hidden()
        for _, writer in held:
            writer.close()


async def test_a_leader_with_a_token_is_seen_by_who_has_it(browser, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, TOKEN)
    async with a_page(browser) as page, Leading() as leading:
        await page.goto(leading.url)
        await shows(page, "#connection", "token needed")
        await page.keyboard.type("not the token at all")  # the field has the focus
        await page.keyboard.press("Enter")
        await shows(page, "#token-problem", "not the leader's token")
        await page.keyboard.type(TOKEN)
        await page.keyboard.press("Enter")
        await shows(page, "#connection", "live")
        await api.expect(page.locator("#token-form")).to_be_hidden()
        monkeypatch.setattr("mmt.leader.monitoring.part.MOST_VIEWERS", 1)
        async with a_page(browser) as other:
            await other.goto(leading.url)
            await shows(other, "#connection", "token needed")
            await other.keyboard.type(TOKEN)
            await other.keyboard.press("Enter")
            await shows(other, "#connection", "too many viewers, trying again")


async def test_a_person_controls_the_run(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    async with a_page(browser, TABLET) as page, Leading() as leading:
        await page.goto(leading.url)
        await api.expect(page.locator("#record")).to_be_enabled()
        for control in ("#save", "#reset"):  # there is no model yet
            await api.expect(page.locator(control)).to_be_disabled()
        await leading.model(6.0)
        await shows(page, "#plane-text", "samples, order")
        await page.click("#save")
        await shows(page, "#answer", "samples as mmt-monitor/shown-model-1.npz")
        assert TextureModel.load(Path("mmt-monitor/shown-model-1.npz")).order > 0
        await page.click("#record")
        await shows(page, "#answer", "recording into mmt-monitor/shown-1.mcap")
        await shows(page, "#record", "Stop recording")
        await page.keyboard.press("m")  # which goes to the field
        await page.keyboard.type("wood begins")
        await page.keyboard.press("Enter")
        await shows(page, "#answer", "marked: wood begins")
        await shows(page, "#events", "marked: wood begins")
        await page.fill("#mark", "20\N{NO-BREAK SPACE}N")
        await page.keyboard.press("Enter")
        await shows(page, "#answer", "200 printable characters at most")
        await api.expect(page.locator("#mark")).to_have_value("20\N{NO-BREAK SPACE}N")
        await page.click("#record")
        await shows(page, "#answer", "recorded 0 frames into")
        await page.select_option("#force", "streamed")
        await shows(page, "#answer", "held to streamed vibration")
        await page.select_option("#network", "bad")
        await shows(page, "#answer", "emulated network: bad")
        await shows(page, "#events", "emulated network: delay 150")
        await page.click("#freeze")
        await shows(page, "#freeze", "Let the model grow")
        page.on("dialog", lambda dialog: dialog.accept())
        await page.click("#reset")
        await shows(page, "#plane-text", "No model yet")
        await shows(page, "#freeze", "Freeze model")


async def test_a_person_hands_control_over_and_takes_it_back(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MMT_CONTROL_TOKEN", TOKEN)
    tables = {"sharing": {"port": 0}, "control": {"silence_ms": 5000}}
    async with a_page(browser, TABLET) as page, Leading(**tables) as leading:
        control = leading.service.parts.get(ControlPart)
        await page.goto(leading.url)
        await shows(page, "#control-text", "The leader's hand moves the robot.")
        await api.expect(page.locator("#take-back")).to_be_disabled()
        for who, name in ((1, "ann"), (2, "<b>bob")):
            control.receive({"control": "ask", "who": who, "name": name})
        await shows(page, "#asking", "<b>bob asks for control")
        await page.get_by_role("button", name="Refuse: <b>bob").click()
        await shows(page, "#answer", "control is refused")
        await api.expect(page.locator("#asking li")).to_have_count(1)
        follower = Follower(leading.service.scene, leading.origin)
        following = asyncio.create_task(follower.run())
        await shows(page, "#events", "follower connected")
        while leading.service.time_s < 0.1:  # until a robot is commanded
            await asyncio.sleep(0.01)
        await page.get_by_role("button", name="Give: ann").click()
        moving = asyncio.create_task(operate(control, 1))
        await shows(page, "#control-text", "ann moves the robot.")
        await api.expect(page.locator("#asking li")).to_have_count(0)
        await fits(page, "light")
        await page.click("#take-back")
        await shows(page, "#control-text", "The leader's hand moves the robot.")
        await shows(page, "#events", "control taken from ann: the leader has taken it back")
        moving.cancel()
        follower.stop()
        await following


async def test_single_keys_are_listed_and_none_of_them_undoes_or_loads_anything(browser):
    async with a_page(browser) as page, Leading() as leading:
        asked = []
        page.on("request", lambda request: asked.append(request.url))
        await page.goto(leading.url)
        await shows(page, "#connection", "live")
        await api.expect(page.locator("#network")).to_have_value("lan")
        await page.keyboard.press("?")
        await shows(page, "#help", "to the choice of the vibration")
        await api.expect(page.locator("#help")).not_to_contain_text(
            "play, pause", use_inner_text=True
        )
        await page.keyboard.press("v")  # while the list is open keys do nothing
        await page.keyboard.press("Escape")
        await api.expect(page.locator("#help")).to_be_hidden()
        await page.select_option("#network", "wan")
        await shows(page, "#answer", "emulated network: wan")
        for key in "rf0123456789x":
            await page.keyboard.press(key)
        await api.expect(page.locator("#network")).to_have_value("wan")
        await shows(page, "#record", "Record")
        await shows(page, "#freeze", "Freeze model")
        await page.keyboard.press("v")
        assert await page.evaluate("document.activeElement.id") == "force"
        assert [url for url in asked if not url.startswith(leading.origin)] == []
    assert sum(map(len, monitor_files().values())) < LARGEST_BYTES


OUTSIDE = """() => [...document.querySelectorAll("section")].flatMap((card) => {
    const bottom = card.getBoundingClientRect().bottom;
    return [...card.querySelectorAll(".u-legend")]
        .filter((legend) => legend.getBoundingClientRect().bottom > bottom)
        .map(() => card.getAttribute("aria-labelledby"));
})"""


async def test_legends_stay_in_their_cards_on_a_telephone(browser):
    async with Leading() as leading, a_page(browser, PHONE) as page:
        await page.goto(leading.url)
        await shows(page, "#connection", "live")
        lines = await page.evaluate("document.querySelector('#vibration .u-legend').offsetHeight")
        assert lines > 40  # or there is nothing to see
        assert await page.evaluate(OUTSIDE) == []
        await page.emulate_media(color_scheme="dark")
        await page.wait_for_timeout(300)
        assert await page.evaluate(OUTSIDE) == []
        await page.set_viewport_size({"width": 300, "height": 844})
        await page.wait_for_timeout(300)
        assert await page.evaluate(OUTSIDE) == []


async def test_a_person_sees_who_listens(browser):
    sharing = Leading(sharing={"port": 0})
    async with a_page(browser, DESKTOP, "light") as page, sharing as leading:
        part = leading.service.parts.get(SharingPart)
        follower = Follower(leading.service.scene, leading.origin)
        await page.goto(leading.url)
        await shows(page, "#connection", "live")
        await shows(page, "#listeners-text", "0 listening")
        await until(lambda: part.port is not None)
        url = f"http://127.0.0.1:{part.port}"
        async with listening(url, name="<b>ann</b>"), listening(url):
            await shows(page, "#listeners-text", "2 listening, 2 have joined.")
            await shows(page, "#listeners", "<b>ann</b>")  # as text
            await shows(page, "#listeners", "listener 2")
            await shows(page, "#events", "listener <b>ann</b> joined, 1 listening")
            rows = page.locator("#listeners tr")
            await api.expect(rows).to_have_count(2)
            following = asyncio.create_task(follower.run())  # from now on there are states
            await until(lambda: (part.listeners.figures["lag_median_ms"] or -1.0) >= 0.0)
            for row in (0, 1):
                lag, messages = (rows.nth(row).locator("td").nth(k) for k in (1, 5))
                await api.expect(lag).to_have_text(re.compile(r"\d+\.\d"))
                await api.expect(messages).to_have_text(re.compile(r"\d\d+"))
            await fits(page, "light")
        await shows(page, "#listeners-text", "0 listening, 2 have joined.")
        await api.expect(rows).to_have_count(0)
        follower.stop()
        await following
