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
