"""A real browser for the pages' tests."""

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
import pytest_asyncio

api = pytest.importorskip("playwright.async_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
MARKS = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.asyncio(loop_scope="module"),
]

DESKTOP, TABLET = (1440, 900), (820, 1180)
LONGEST_MS = 60_000
LEAST_TARGET_PX = 40
"""Of what a finger is to meet."""


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Any]:
    async with api.async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        await browser.close()


@asynccontextmanager
async def a_page(
    browser: Any, size: tuple[int, int] = DESKTOP, scheme: str = "light", *, touch: bool = False
) -> AsyncIterator[tuple[Any, list[str]]]:
    """A page of that size, and what it complains of."""
    page = await browser.new_page(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, has_touch=touch
    )
    page.set_default_timeout(LONGEST_MS)
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    try:
        yield page, problems
    finally:
        await page.close()


async def shows(page: Any, selector: str, text: str) -> None:
    await api.expect(page.locator(selector)).to_contain_text(text, timeout=LONGEST_MS)


async def inked(page: Any, selector: str) -> int:
    """Return how many pixels of a canvas are not empty."""
    count: int = await page.evaluate(
        """selector => {
            const canvas = document.querySelector(selector);
            const { width, height } = canvas;
            const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
            return data.filter((value, index) => index % 4 === 3 && value > 0).length;
        }""",
        selector,
    )
    return count


async def fits(page: Any, scheme: str) -> None:
    """See that a page has the scheme's colours, nothing beside its edge, and room for fingers."""
    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert await page.evaluate(overflow) <= 0
    ground = await page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(20, 24, 27)") is (scheme == "dark")
    heights = await page.evaluate(
        """() => [...document.querySelectorAll("button, select, input")]
            .filter((node) => node.checkVisibility())
            .map((node) => [node.id || node.textContent, node.getBoundingClientRect().height])"""
    )
    assert heights
    assert [item for item in heights if item[1] < LEAST_TARGET_PX] == []
