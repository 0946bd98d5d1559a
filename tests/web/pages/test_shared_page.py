"""A shared surface in a real browser: a visitor feels it, and what becomes of it."""

import asyncio
from pathlib import Path
from typing import Any

from page_browser import MARKS, TABLET, a_page, api, browser, shows
from player_samples import address, flat_texture
from sharing_samples import about, shared, until
from test_player_page import hears, stroke

from mmt.scene.sharing_tables import Listening
from mmt.web.player.following import SharedTexture
from mmt.web.player.player import Player
from mmt.web.player.results import ResultsFile
from mmt.web.player.server import PlayerServer

__all__ = ["browser"]
pytestmark = MARKS


async def test_a_visitor_feels_the_model_as_it_becomes(browser: Any, tmp_path: Path) -> None:
    async with shared() as sharing, a_page(browser, TABLET) as (page, problems):
        sharing.relay.offer_model(*sharing.publisher.publish(flat_texture(1.0), about(49)))
        texture = SharedTexture(Listening(url=sharing.url), lambda _: None)
        model = await texture.first()
        player = Player(
            [texture.name], [model], results=ResultsFile(tmp_path / "r.csv"), scenarios=False
        )
        following = asyncio.create_task(texture.follow(player))
        server = PlayerServer(player, several=True)
        await server.start("127.0.0.1", 0)
        try:
            await page.goto(address(server))
            await shows(page, "#connection", "live")
            await api.expect(page.locator(".tile")).to_have_count(1)
            await page.click("#start")
            await stroke(page, 0)
            await hears(page, 0.7, 1.3)
            sharing.relay.offer_model(*sharing.publisher.publish(flat_texture(4.0), about(49)))
            await until(lambda: player.models[0] is not model)
            await hears(page, 3.0, 5.0)
            assert problems == []
        finally:
            following.cancel()
            await server.stop()
            await texture.close()
