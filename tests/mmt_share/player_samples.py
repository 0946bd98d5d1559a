"""Textures and a server for the player's tests, and a page without a screen."""

import asyncio
import csv
import itertools
import json
from contextlib import asynccontextmanager

import aiohttp
import numpy as np
from monitor_messages import until

from mmt.link.access import Access
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt_share.player.player import Player
from mmt_share.player.results import ResultsFile
from mmt_share.player.server import PlayerServer

NAMES = ("cork", "linen", "slate")
RMS_M_S2 = (1.0, 2.0, 4.0)
LONGEST_S = 60.0


def flat_texture(rms_m_s2, lowest=0.3, *, rate_hz=1000.0):
    """A texture of one filter and one level between 30 and 270 mm/s, 0.3 and 2.7 N."""
    inputs = np.array(
        list(itertools.product(np.arange(30.0, 271.0, 40.0), np.arange(0.3, 2.8, 0.4)))
    )
    lsf = np.tile(np.linspace(lowest, 2.4, 6), (len(inputs), 1))
    unit = output_power(np.ones(len(inputs)), lsf_to_reflection(lsf))
    power = np.full(len(inputs), rms_m_s2**2)
    return TextureModel(TextureSamples(inputs, lsf, power / unit, power), rate_hz=rate_hz)


def textures():
    return [flat_texture(rms, 0.2 + 0.1 * number) for number, rms in enumerate(RMS_M_S2)]


def rows_of(results):
    with results.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@asynccontextmanager
async def playing(directory, *, record=None, token=None, count=3, port=0):
    player = Player(
        NAMES[:count],
        textures()[:count],
        results=ResultsFile(directory / "results.csv"),
        record=record,
        seed=3,
    )
    server = PlayerServer(player, Access(token))
    await server.start("127.0.0.1", port)
    try:
        yield server
    finally:
        await server.stop()


def address(server, path="/player/"):
    return f"http://127.0.0.1:{server.port}{path}"


class Browserless:
    """A page that does what it is told."""

    def __init__(self, socket):
        self.socket = socket
        self.number = 0
        self.x_mm = 0.0

    async def say(self, **message):
        await self.socket.send_str(json.dumps(message))

    async def until(self, kind):
        return await until(self.socket, kind)

    async def order(self, **order):
        self.number += 1
        await self.say(id=self.number, **order)
        return await self.until("answer")

    async def model(self):
        """Return the JSON form of the next model that comes."""
        return json.loads((await self.until("model"))["form"])

    async def stroke(self, tile, seconds, speed_mm_s=120.0):
        """Stroke at 1 N in steps of 10 ms, in as much time as that takes."""
        for _ in range(round(seconds * 10)):
            await asyncio.sleep(0.1)
            steps = []
            for _ in range(10):
                self.x_mm += speed_mm_s * 0.01
                steps.append([10, self.x_mm, 0.0, speed_mm_s, 0.0, 1.0])
            await self.say(do="stroke", tile=tile, steps=steps)

    async def lift(self):
        await self.say(do="stroke", tile=None)


@asynccontextmanager
async def visiting(server, token=None):
    async with (
        aiohttp.ClientSession() as http,
        http.ws_connect(address(server, "/player/socket")) as socket,
    ):
        page = Browserless(socket)
        await page.say(token=token)
        yield page
