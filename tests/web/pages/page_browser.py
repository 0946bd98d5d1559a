"""A real browser for the pages' tests."""

import asyncio
import shutil
from contextlib import asynccontextmanager

import pytest
import pytest_asyncio

api = pytest.importorskip("playwright.async_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
MARKS = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.asyncio(loop_scope="module"),
]

DESKTOP, TABLET, PHONE = (1280, 800), (820, 1180), (390, 844)
LONGEST_MS = 60_000
LEAST_TARGET_PX = 40
"""Of what a finger is to meet."""
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

PICTURES = (
    "#plane", "#completion canvas", "#vibration canvas", "#spectra canvas", "#force-plot canvas",
    "#position canvas",
)  # fmt: skip
"""Of the monitor and of a recording."""

api.expect.set_options(timeout=LONGEST_MS)  # of a busy machine


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser():
    async with api.async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        await browser.close()


@asynccontextmanager
async def a_page(browser, size=DESKTOP, scheme="light", **options):
    """A page of that size, in which no error may go unhandled; options are those of `new_page`."""
    page = await browser.new_page(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, **options
    )
    page.set_default_timeout(LONGEST_MS)
    problems = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    try:
        yield page
        assert problems == []
    finally:
        await page.close()


@asynccontextmanager
async def a_file(browser, path, *how, may_warn=False):
    """A page from disk without a network, that asks for nothing and complains of nothing."""
    asked = []
    said = []
    async with a_page(browser, *how, offline=True) as page:
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: said.append((message.type, message.text)))
        await page.goto(path.as_uri())
        yield page
        assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
        assert [text for kind, text in said if kind == "error" or not may_warn] == []


async def until(page, condition):
    """Wait for a condition; a page's own policy may forbid the browser's way to wait."""
    async with asyncio.timeout(LONGEST_MS / 1000):
        while not await page.evaluate(condition):
            await asyncio.sleep(0.05)


async def shows(page, selector, text):
    await api.expect(page.locator(selector)).to_contain_text(text)


async def inked(page, selector):
    """Return how many pixels of a canvas are not empty."""
    return await page.evaluate(
        """selector => {
            const canvas = document.querySelector(selector);
            const { width, height } = canvas;
            const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
            return data.filter((value, index) => index % 4 === 3 && value > 0).length;
        }""",
        selector,
    )


ILLEGIBLE = """() => {
    const channels = (colour) => colour.match(/[0-9.]+/g).map(Number);
    const light = ([r, g, b]) => [r, g, b].map((c) => c / 255)
        .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
        .reduce((sum, c, i) => sum + [0.2126, 0.7152, 0.0722][i] * c, 0);
    const contrast = (node) => {
        const ink = channels(getComputedStyle(node).color);
        let opacity = 1, ground = null;
        for (let at = node; at; at = at.parentElement) {
            const style = getComputedStyle(at), under = channels(style.backgroundColor);
            opacity *= Number(style.opacity);
            if (!ground && (under[3] ?? 1) === 1) ground = under;
        }
        const seen = ink.slice(0, 3).map((c, i) => ground[i] + opacity * (c - ground[i]));
        const [dark, bright] = [light(seen), light(ground)].sort((a, b) => a - b);
        return (bright + 0.05) / (dark + 0.05);
    };
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
    while (texts.nextNode()) {
        const { parentElement: node, data } = texts.currentNode;
        if (!data.trim() || !node.checkVisibility() || contrast(node) >= 4.5) continue;
        found.push([data.trim(), contrast(node)]);
    }
    return found;
}"""
"""Texts whose contrast to what they stand on is too small."""


UNNAMED = """() =>
    [...document.querySelectorAll("button, select, input, a, [tabindex], [role=img]")]
    .filter((node) => node.checkVisibility() && !node.matches("[aria-labelledby], [aria-label]"))
    .filter((node) => !(node.textContent || node.title || node.labels?.length))
    .map((node) => node.outerHTML)"""
"""What a screen reader has no words for."""


async def fits(page, scheme):
    """See that a page has the scheme's colours, nothing beside its edge, names, large targets."""
    assert await page.evaluate(OVERFLOW) <= 0
    ground = await page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(20, 24, 27)") is (scheme == "dark")
    heights = await page.evaluate(
        """() => [...document.querySelectorAll("button, select, input")]
            .filter((node) => node.checkVisibility())
            .map((node) => [node.id || node.textContent, node.getBoundingClientRect().height])"""
    )
    assert heights
    assert [item for item in heights if item[1] < LEAST_TARGET_PX] == []
    assert await page.evaluate(ILLEGIBLE) == []
    assert await page.evaluate(UNNAMED) == []
