"""The pages in Firefox: they open, render, are felt or say why not, and complain of nothing."""

import pytest
import pytest_asyncio
from firefox_browser import FIREFOX, a_firefox
from page_browser import fits, until
from test_monitor_page import Leading
from test_texture_page import renders_as_python

from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import load_model
from mmt.web.texture_page import texture_page

pytestmark = [
    pytest.mark.skipif(FIREFOX is None, reason="firefox-esr is not installed"),
    pytest.mark.asyncio(loop_scope="module"),
]
WIDTHS_PX = (390, 1280)
SAID = "document.querySelector('#state').textContent"
PROBLEM = "document.querySelector('#problem').textContent"


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def firefox(tmp_path_factory):
    async with a_firefox(tmp_path_factory.mktemp("firefox")) as page:
        yield page


@pytest.mark.parametrize(("width", "pointer"), [(390, "touch"), (1280, "mouse")])
async def test_the_page_of_one_file_renders_and_its_first_touch_sounds_or_says_why_not(
    firefox, tmp_path, width, pointer
):
    made, path = load_model("oak"), tmp_path / "page.html"
    path.write_bytes(texture_page([model_json(made, "oak")]))
    await firefox.goto(path.as_uri(), width)
    await until(firefox, "window.mmtTexture !== undefined")
    await fits(firefox, "light")
    await renders_as_python(firefox, made)
    box = await firefox.evaluate("document.querySelector('#surface').getBoundingClientRect()")
    at = {"type": "pointerMove", "x": int(box["x"]) + 40, "y": int(box["y"]) + 40}
    moves = [{**at, "x": at["x"] + 8 * (step % 9), "duration": 20} for step in range(20)]
    down, up = ({"type": f"pointer{which}", "button": 0} for which in ("Down", "Up"))
    await firefox.act(pointer, at, down)
    if pointer == "touch":
        assert "when the finger is lifted" in await firefox.evaluate(PROBLEM)
        await firefox.act(pointer, up)
    await until(firefox, f"['plays here, without a network', 'no sound'].includes({SAID})")
    if await firefox.evaluate(SAID) == "no sound":  # nor is there a device to play it
        assert "the browser finds no sound device" in await firefox.evaluate(PROBLEM)
    else:
        assert await firefox.evaluate(PROBLEM) == ""
        await firefox.act(pointer, up, at, down, *moves)
        await until(firefox, "window.mmtTexture.figures().delays.length > 9")
        assert (await firefox.evaluate("window.mmtTexture.figures()"))["by"] == "worklet"
    await firefox.act(pointer, up)
    assert firefox.problems == []


@pytest.mark.parametrize("width", WIDTHS_PX)
async def test_the_monitor_shows_its_verdict(firefox, width):
    async with Leading() as leading:
        await firefox.goto(leading.url, width)
        now = "document.querySelector('#now').textContent"
        await until(firefox, f"{now}.includes('waiting for the follower')")
        await leading.model(6.0)
        plane = "document.querySelector('#plane-text').textContent"
        await until(firefox, f"{plane}.includes('samples, order')")
        await fits(firefox, "light")
        await firefox.goto("about:blank", width)  # which looks for no leader
    assert firefox.problems == []
