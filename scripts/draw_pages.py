"""Take the pictures of the pages: monitor, recording, report, player; see ``scripts/screenshots``.

The monitor is pictured in each of its states, for desktop and phone, light and dark, while a leader
and a follower run. Pictures are taken when the page shows the state; on a slow machine that may be
a second or two later.
"""

import asyncio
import io
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from image_files import write_screen
from PIL import Image
from playwright.async_api import async_playwright

DESKTOP: Final = {"width": 1280, "height": 1000}
PHONE: Final = {"width": 390, "height": 844}
PLAYER: Final = {"width": 960, "height": 720}
LONGEST_MS: Final = 60_000

SHEETS: Final = {"monitor-states": (DESKTOP, 0.27, 3), "monitor-states-phone": (PHONE, 0.5, 6)}
"""Pictures of all states: size of the screen, its scale in the picture, and states in a row."""
SCHEMES: Final = ("light", "dark")

REACHED: Final = "parseFloat(document.querySelector('#time').textContent) >= {}"
MET: Final = "document.querySelector('#completion-text').textContent.includes('start met')"
LOST: Final = "document.body.classList.contains('lost')"
PAINTED: Final = "[...document.querySelectorAll('#grid canvas')].every((one) => one.width > 1)"
SHOWS: Final = "document.querySelector('header').textContent.includes('{}')"


async def main() -> None:
    """Take pictures of the monitor in all its states, a report, a recording and the player."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        with tempfile.TemporaryDirectory() as folder:
            await picture_monitor(browser, Path(folder))
            await picture_report(browser, Path(folder) / "report" / "report.html")
            recording = str(Path(folder) / "session.mcap")
            async with serving("main", "session", "view", recording, "--no-open") as (_, url):
                await picture_recording(browser, url)
            results = f"{folder}/results.csv"
            async with serving("main", "play", "--port", "0", "--results", results) as (_, url):
                await picture_player(browser, url)
        await browser.close()


async def picture_monitor(browser: Any, folder: Path) -> None:
    """Take the monitor in each state: one run to its end, and one whose services are killed."""
    leader = ("leader", "demo", "--monitor", "--port", "0")
    whole = (*leader, "--record", f"{folder}/session.mcap", "--report", f"{folder}/report")
    states: dict[str, list[bytes]] = {}
    async with serving(*whole) as (process, url):
        pages = [
            await a_page(browser, url, size, scheme)
            for size, _, _ in SHEETS.values()
            for scheme in SCHEMES
        ]

        async def keep(state: str, condition: str) -> None:
            await asyncio.gather(*(page.wait_for_function(condition) for page in pages))
            states[state] = [await page.screenshot() for page in pages]

        await keep("before", SHOWS.format("follower"))
        async with following(url):
            await keep("during", REACHED.format(1))
            await keep("switch", MET)
            await pages[0].wait_for_function(REACHED.format(12))
            await take("monitor", pages[0])
            await process.wait()
        await keep("end", SHOWS.format("over"))
    async with serving(*leader) as (process, url):
        for page in pages:
            await page.goto(url)
        async with following(url) as follower:
            await asyncio.gather(*(page.wait_for_function(REACHED.format(5)) for page in pages))
            follower.kill()
            await follower.wait()
            await keep("follower gone", SHOWS.format("follower"))
        process.kill()
        await process.wait()
        await keep("server gone", LOST)
    order = ("before", "during", "switch", "follower gone", "server gone", "end")
    for place, (name, (_, scale, columns)) in enumerate(SHEETS.items()):
        shots = [
            states[state][len(SCHEMES) * place + scheme]
            for scheme in range(len(SCHEMES))
            for state in order
        ]
        write_screen(name, sheet(shots, scale, columns))


def sheet(shots: list[bytes], scale: float, columns: int) -> bytes:
    """Return pictures of one size on one sheet, row by row."""
    drawn = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    width, height = (round(scale * side) for side in drawn[0].size)
    gap = 6
    rows = -(-len(drawn) // columns)
    whole = Image.new("RGB", (columns * (width + gap) - gap, rows * (height + gap) - gap))
    for place, one in enumerate(drawn):
        row, column = divmod(place, columns)
        small = one.resize((width, height), Image.Resampling.LANCZOS)
        whole.paste(small, (column * (width + gap), row * (height + gap)))
    png = io.BytesIO()
    whole.save(png, "PNG")
    return png.getvalue()


@asynccontextmanager
async def following(url: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run the demo's follower with the leader that serves a page."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "mmt.cli.entry", "follower", "demo"),
        *("--leader", url.removesuffix("/monitor/")),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
        await process.wait()


@asynccontextmanager
async def serving(*command: str) -> AsyncIterator[tuple[asyncio.subprocess.Process, str]]:
    """Run a command that serves a page; yield its process and the page's address."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-u", "-m", "mmt.cli.entry", *command),
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


async def picture_report(browser: Any, report: Path) -> None:
    """Take the top of a report."""
    await take("report", await a_page(browser, report.as_uri(), DESKTOP, "light"))


async def picture_recording(browser: Any, url: str) -> None:
    """Take a recording at the switch, at which the page opens."""
    page = await a_page(browser, url, DESKTOP, "light")
    await page.wait_for_function(MET)
    await page.wait_for_timeout(1000)  # for plots that are drawn in turns
    await take("recording", page)


async def picture_player(browser: Any, url: str) -> None:
    """Take the player's grid, while a texture is stroked."""
    page = await a_page(browser, url, PLAYER, "light")
    await page.wait_for_function(PAINTED)
    box = await page.locator("#grid > *").nth(4).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    await page.mouse.move(x - 60, y)
    await page.mouse.down()
    for step in range(60):
        await page.mouse.move(x + 60 * (1 - abs(step % 40 - 20) / 10), y)
        await page.wait_for_timeout(20)
    await take("player", page)
    await page.mouse.up()


async def take(name: str, page: Any) -> None:
    """Write a screenshot of a page."""
    write_screen(name, await page.screenshot())


async def a_page(browser: Any, url: str, size: dict[str, int], scheme: str) -> Any:
    """Open a page."""
    page = await browser.new_page(viewport=size, color_scheme=scheme, bypass_csp=True)
    page.set_default_timeout(LONGEST_MS)
    await page.goto(url)
    return page


if __name__ == "__main__":
    asyncio.run(main())
