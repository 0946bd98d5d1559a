"""`mmt demo --share`: a page for visitors, from the model's readiness until Ctrl-C."""

import asyncio
import re
import signal
from pathlib import Path

import aiohttp
import numpy as np
from player_samples import Browserless
from service_processes import Service

from mmt.cli.visiting import VisitorsPage, qr_code


def test_a_visitor_feels_the_surface_until_the_demo_is_interrupted(tmp_path: Path) -> None:
    arguments = ("demo", "--share", "--duration", 20, "--output", tmp_path / "out")
    with Service("main", *arguments, cwd=tmp_path, MMT_SHARING__PORT="0") as demo:
        demo.wait_for(lambda: "feel it at http://" in demo.stderr + demo.stdout)
        found = re.search(r"feel it at http://[^:]+:(\d+)/player/", demo.stderr + demo.stdout)
        assert found is not None

        async def feel() -> float:
            url = f"http://127.0.0.1:{found[1]}/player/socket"
            async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
                await socket.send_str('{"token": null}')
                page = Browserless(socket)
                await page.open()
                await page.stroke(0, 0.2)
                return float(np.std(await page.stroke(0, 0.5)))

        assert asyncio.run(feel()) > 0.01
        demo.wait_for(lambda: "until Ctrl-C it can be felt" in demo.stderr + demo.stdout)
        demo.signal(signal.SIGINT)
        assert demo.end() == 0, demo.stderr
    assert (tmp_path / "out" / "report.html").exists()


async def test_a_page_that_cannot_be_served_says_why() -> None:
    page = VisitorsPage()
    try:
        said = await page.open("nonsense")
        assert said.startswith("no page for visitors: error: leader's URL 'nonsense'")
        assert page.address is None
    finally:
        page.close()


def test_a_qr_code_is_a_square_of_blocks() -> None:
    lines = qr_code("http://192.0.2.1:8770/player/").splitlines()
    assert lines[0] == ""
    assert len({len(line) for line in lines[1:]}) == 1
    assert set("".join(lines)) <= set(" ▀▄█")
