"""Pages that play a shared model: several at once, and each change of it."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
from player_samples import flat_texture, visiting
from sharing_samples import about, shared, until

from mmt.scene.sharing_tables import Listening
from mmt.web.player.following import SharedTexture
from mmt.web.player.player import Player
from mmt.web.player.results import ResultsFile
from mmt.web.player.server import PlayerServer


def rms(sound: np.ndarray) -> float:
    return float(np.sqrt(np.mean(sound**2)))


async def test_two_pages_feel_one_surface_and_what_becomes_of_it(tmp_path: Path) -> None:
    said: list[str] = []
    async with shared() as sharing:
        texture = SharedTexture(Listening(url=sharing.url), said.append)
        waiting = asyncio.create_task(texture.first())
        sharing.relay.offer_model(
            *sharing.publisher.publish(flat_texture(1.0), about(49, ready=False))
        )
        await until(lambda: any("not ready yet" in text for text in said))
        sharing.relay.offer_model(*sharing.publisher.publish(flat_texture(1.0), about(49)))
        model = await waiting
        assert texture.name == "a table"
        player = Player(
            [texture.name], [model], results=ResultsFile(tmp_path / "r.csv"), scenarios=False
        )
        following = asyncio.create_task(texture.follow(player))
        server = PlayerServer(player, several=True)
        await server.start("127.0.0.1", 0)
        try:
            async with visiting(server) as one, visiting(server) as other:
                for page in (one, other):
                    await page.open()
                    await page.stroke(0, 0.2)
                    assert rms(await page.stroke(0, 1.0)) == pytest.approx(1.0, rel=0.25)
                sharing.relay.offer_model(*sharing.publisher.publish(flat_texture(4.0), about(49)))
                await until(lambda: player.models[0] is not model)
                for page in (one, other):
                    await page.stroke(0, 0.2)
                    assert rms(await page.stroke(0, 1.0)) == pytest.approx(4.0, rel=0.25)
                refused = await one.order(do="begin", scenario="matching", participant="P")
                assert refused["text"] == "this page plays a shared surface: it has no scenarios"
        finally:
            following.cancel()
            await server.stop()
            await texture.close()
