"""Take the pictures of the pages: monitor, recording, report, player; see ``scripts/screenshots``.

The pages are pictured while a demo runs, at moments that they show themselves; a machine that is
slow pictures them a second or two later.
"""

import asyncio
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from image_files import write_png
from playwright.async_api import async_playwright

DESKTOP: Final = {"width": 1280, "height": 1000}
TABLET: Final = {"width": 820, "height": 1180}
PLAYER: Final = {"width": 960, "height": 720}
LONGEST_MS: Final = 120_000

TOO_BUSY: Final = "the run went on before its picture was taken: the machine is too busy"
SAMPLES: Final = "parseInt(document.querySelector('#plane-text').textContent) >= {}"
MODE: Final = "document.querySelector('#mode').textContent === '{}'"


async def main() -> None:
    """Run the demo, look at its monitor, its report and its recording; then at the player."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        with tempfile.TemporaryDirectory() as folder:
            async with serving("demo", "--monitor", "--output", folder) as (demo, url):
                await watch(
                    *await asyncio.gather(
                        a_page(browser, url, DESKTOP, "light"), a_page(browser, url, TABLET, "dark")
                    )
                )
                await demo.wait()
            await picture_report(browser, Path(folder) / "report.html")
            recording = str(Path(folder) / "session.mcap")
            async with serving("session", "view", recording, "--no-open") as (_, url):
                await picture_recording(browser, url)
            async with serving("play", "--port", "0", "--results", f"{folder}/r.csv") as (_, url):
                await picture_player(browser, url)
        await browser.close()


@asynccontextmanager
async def serving(*command: str) -> AsyncIterator[tuple[asyncio.subprocess.Process, str]]:
    """Run a command that serves a page; give its process and the page's address."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-u", "-m", "mmt.cli.main", *command),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    assert process.stdout is not None  # noqa: S101 - it is a pipe
    said = b""
    while (found := re.search(rb"http://[\w.:]+/\S+/", said)) is None:
        line = await process.stdout.readline()
        if not line:
            raise SystemExit(said.decode(errors="replace"))
        said += line
    reading = asyncio.create_task(process.stdout.read())
    try:
        yield process, found.group().decode()
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
        await process.wait()
        await reading


async def watch(desk: Any, tablet: Any) -> None:
    """Take the monitor while the model is stroked, after the switch, and of 19 samples."""
    await desk.wait_for_function(SAMPLES.format(2))
    if not await desk.evaluate(MODE.format("streamed")):
        raise SystemExit(TOO_BUSY)
    await take("monitor-stroking", desk)
    await tablet.wait_for_function(MODE.format("synthesized"))
    await tablet.wait_for_function(SAMPLES.format(14))
    await take("monitor-tablet", tablet)
    await desk.wait_for_function(SAMPLES.format(19))
    await take("monitor", desk)
    if await desk.locator("body.lost").count():
        raise SystemExit(TOO_BUSY)


async def picture_report(browser: Any, report: Path) -> None:
    """Take a report where it shows the model as it grows."""
    page = await a_page(browser, report.as_uri(), DESKTOP, "light")
    heading = page.locator("h2", has_text="Session")
    await heading.evaluate("heading => heading.scrollIntoView()")
    await take("report", page)


async def picture_recording(browser: Any, url: str) -> None:
    """Take a recording at its fifth second."""
    page = await a_page(browser, url, DESKTOP, "light")
    await page.wait_for_function("document.querySelector('#plane-text').textContent !== ''")
    await page.keyboard.press("Home")
    for _ in range(5):
        await page.keyboard.press("ArrowRight")
    await page.wait_for_function(SAMPLES.format(5))
    await page.wait_for_timeout(1000)  # for plots that are drawn in turns
    await take("recording", page)


async def picture_player(browser: Any, url: str) -> None:
    """Take the player's grid, while a texture is stroked."""
    page = await a_page(browser, url, PLAYER, "light")
    await page.click("#start")
    box = await page.locator("#grid > *").nth(4).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    await page.mouse.move(x - 60, y)
    await page.mouse.down()
    for step in range(60):
        await page.mouse.move(x + 60 * (1 - abs(step % 40 - 20) / 10), y)
        await page.wait_for_timeout(20)
    await take("player", page, colours=64)
    await page.mouse.up()


async def take(name: str, page: Any, colours: int = 256) -> None:
    """Write what is on the screen; with too few colours, a few red dots turn brown."""
    write_png(name, await page.screenshot(), colours)


async def a_page(browser: Any, url: str, size: dict[str, int], scheme: str) -> Any:
    """Open a page."""
    page = await browser.new_page(viewport=size, color_scheme=scheme, bypass_csp=True)
    page.set_default_timeout(LONGEST_MS)
    await page.goto(url)
    return page


if __name__ == "__main__":
    asyncio.run(main())
