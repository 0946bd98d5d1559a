"""Measure the texture page in headless Chromium: processor time, underruns, delay of the hand.

Usage, after ./scripts/test has set up .venv:
.venv/bin/python scripts/player_cost.py [MINUTES [TEXTURES]]

The page plays oak at 48 kHz while a pointer strokes it 60 times a second; further textures are
nodes in the same audio graph that follow the same pointer. A line of JSON goes to stdout. Without a
sound device Chromium plays into a simulated one, by the clock. Underruns are those of
`AudioContext.playbackStats`. A delay lasts from a pointer event until the page reports the first
sample for it, which is later than the sample itself.
"""

import asyncio
import json
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
from playwright.async_api import async_playwright

from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import load_model
from mmt.web.texture_page import texture_page

CONTEXT = """window.AudioContext = class extends AudioContext {
    constructor(options) { window.context = super({ ...options, sampleRate: 48000 }); }
};"""
MORE = """async (count) => {
    const source = btoa(document.getElementById("module").textContent);
    const module = await import(`data:text/javascript;base64,${source}`);
    const model = module.parseModel(document.querySelector("script.model").textContent);
    for (let i = 1; i < count; i++) {
        const node = await new module.TextureNode(window.context).ready;
        node.setModel(model);
        const gain = new GainNode(window.context, { gain: 0.1 });
        node.connect(gain).connect(window.context.destination);
        const hand = new module.PointerMotion();
        document.getElementById("surface").addEventListener("pointermove", (event) => {
            hand.add(event.timeStamp, event.clientX / 4, -event.clientY / 4, 1);
            node.setMotion(hand.vx, hand.vy, hand.force, hand);
        });
    }
}"""
LOOK = """() => {
    const { underrunEvents, underrunDuration } = window.context.playbackStats;
    return { ...window.mmtTexture.figures(), underruns: underrunEvents, lost_s: underrunDuration };
}"""
PERIOD_S = 1 / 60
LOOK_S = 2.5
"""The page remembers its last 200 delays, some three seconds."""


def used_s() -> dict[str, float]:
    """Return processor seconds of this process's children, by their kind."""
    found: dict[str, float] = {}
    for process in psutil.Process().children(recursive=True):
        options = [a.rpartition("=")[2] for a in process.cmdline() if a.startswith("--type")]
        options += [a for a in process.cmdline() if "AudioService" in a][:1]
        kind = options[-1].rpartition("=")[2] if options else process.name()
        times = process.cpu_times()
        found[kind] = found.get(kind, 0.0) + times.user + times.system
        for thread in process.threads() if kind == "renderer" else ():
            name = Path(f"/proc/{process.pid}/task/{thread.id}/comm").read_text().strip()
            if "Audio" in name:
                used = thread.user_time + thread.system_time
                found["sound in it"] = found.get("sound in it", 0.0) + used
    return found


async def main(minutes: float = 1.0, textures: int = 1) -> None:
    """Stroke for these minutes, then print the figures."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        path.write_bytes(texture_page([model_json(load_model("oak"), "oak")]))
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
            )
            page = await browser.new_page()
            await page.add_init_script(CONTEXT)
            await page.goto(path.as_uri())
            box: Any = await page.locator("#surface").bounding_box()
            await page.mouse.move(box["x"] + 40, box["y"] + 40)
            await page.mouse.down()
            while await page.evaluate("window.mmtTexture.figures() === null"):
                await asyncio.sleep(0.1)
            await page.evaluate(MORE, textures)
            await asyncio.sleep(2)
            delays: list[float] = []
            before, first, begun_s = used_s(), await page.evaluate(LOOK), time.monotonic()
            looked_s, number = begun_s, 0
            while (now_s := time.monotonic()) < begun_s + 60 * minutes:
                number += 1
                way = abs(number % 120 - 60)
                await page.mouse.move(box["x"] + 40 + 8 * way, box["y"] + 40 + way)
                if now_s > looked_s + LOOK_S:
                    looked_s, last = now_s, await page.evaluate(LOOK)
                    delays += last["delays"]
                await asyncio.sleep(max(0.0, begun_s + number * PERIOD_S - time.monotonic()))
            lasted_s, after = time.monotonic() - begun_s, used_s()
    hundredths = statistics.quantiles(delays, n=100)
    found = {
        "minutes": round(lasted_s / 60, 2),
        "textures": textures,
        "core_shares": {kind: round((after[kind] - before[kind]) / lasted_s, 4) for kind in before},
        "delay_p50_ms": round(hundredths[49], 2),
        "delay_p99_ms": round(hundredths[98], 2),
        **{name: round(last[name] - first[name], 3) for name in ("underruns", "lost_s")},
    }
    print(json.dumps(found))


if __name__ == "__main__":
    kinds = (float, int)
    asyncio.run(main(*(kind(value) for kind, value in zip(kinds, sys.argv[1:], strict=False))))
