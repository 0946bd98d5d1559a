"""A page for visitors: of `mmt demo --share` until Ctrl-C, of `mmt-leader --page` while it runs."""

import asyncio
import base64
import re
import signal
import sys
from contextlib import suppress

import aiohttp
import numpy as np
from player_samples import Browserless
from service_processes import Service, scene, session
from sharing_samples import LONGEST_S, shared, until

from mmt_share.commands.visitors_page import VisitorsPage, qr_code

SOON = {
    "MMT_SHARING__PORT": "0",
    "MMT_TEXTURE__METHOD": "published",
    "MMT_TEXTURE__START_DISTANCE": "30",
}
"""A model is ready with a few samples, whatever the surface, and also where load leaves few."""


def page_of(service):
    """Wait until visitors are let in, and return where their page's socket is."""
    service.wait_for(lambda: "feel it at http://" in service.stderr + service.stdout)
    found = re.search(r"feel it at http://[^:]+:(\d+)/player/", service.stderr + service.stdout)
    return f"http://127.0.0.1:{found[1]}/player/socket"


async def felt_at(url):
    """Return the level of what a stroke on the page feels, as soon as there is a model."""
    async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
        await socket.send_str('{"token": null}')
        form = await Browserless(socket).model()
        rows = np.frombuffer(base64.b64decode(form["rows"]["data"])).reshape(form["rows"]["shape"])
        return float(np.sqrt(rows[:, 2].max()))


def test_a_visitor_feels_the_surface_until_the_demo_is_interrupted(tmp_path):
    arguments = ("demo", "--share", "--duration", 12, "--output", tmp_path / "out")
    with Service("main", *arguments, cwd=tmp_path, **SOON) as demo:
        assert asyncio.run(felt_at(page_of(demo))) > 0.01
        demo.wait_for(lambda: "until Ctrl-C it can be felt" in demo.stderr + demo.stdout)
        demo.signal(signal.SIGINT)
        assert demo.end() == 0, demo.stderr
    assert (tmp_path / "out" / "report.html").exists()


def test_a_leader_lets_visitors_in_while_it_runs(tmp_path):
    token = tmp_path / "token"
    token.write_text(32 * "a")
    secured = {**SOON, "MMT_SHARING__TOKEN_FILE": str(token)}
    with session(tmp_path, "demo", "--page", "--duration", 60, **secured) as (leader, _):
        assert asyncio.run(felt_at(page_of(leader))) > 0.01
        leader.signal(signal.SIGINT)
        assert leader.end() == 0, leader.stderr


def test_a_page_of_a_leader_with_certificates_is_refused(tmp_path):
    secured = {"MMT_SHARING__CERTIFICATE": "leader.pem", "MMT_SHARING__KEY": "leader.key"}
    with Service("leader", scene("demo"), "--page", cwd=tmp_path, **secured) as leader:
        assert leader.end() == 2
    assert "mmt play --from URL --certificate FILE" in leader.stderr


async def test_a_page_that_cannot_be_served_says_why():
    page = VisitorsPage()
    try:
        said = await page.open("nonsense")
        assert said.startswith("no page for visitors: error: leader's URL 'nonsense'")
        assert page.address is None
    finally:
        page.close()


STARTER = """
import asyncio, sys
from mmt_share.commands.visitors_page import VisitorsPage
page = VisitorsPage(code=False)
print(asyncio.run(page.open(sys.argv[1])), flush=True)
page.wait()
"""


async def test_the_page_ends_with_whoever_started_it_and_is_killed():
    async with shared() as leader:
        leader.publish(6)
        starter = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", STARTER, leader.url), stdout=asyncio.subprocess.PIPE
        )
        try:
            said = (await starter.stdout.readline()).decode()
            assert said.startswith("feel it at http://"), said
            await until(lambda: len(leader.said) == 1)
        finally:
            starter.kill()
            await starter.wait()
        await until(lambda: len(leader.said) == 2)  # the page has left
        port = said.rpartition(":")[2].partition("/")[0]
        async with asyncio.timeout(LONGEST_S):
            with suppress(ConnectionRefusedError):
                while True:
                    _, writer = await asyncio.open_connection("127.0.0.1", int(port))
                    writer.close()
                    await asyncio.sleep(0.05)


def test_a_qr_code_is_a_square_of_blocks():
    lines = qr_code("http://192.0.2.1:8770/player/").splitlines()
    assert lines[0] == ""
    assert len({len(line) for line in lines[1:]}) == 1
    assert set("".join(lines)) <= set(" ▀▄█")
