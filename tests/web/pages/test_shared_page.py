"""A shared surface in a real browser: a visitor feels it, and what becomes of it."""

from pathlib import Path
from typing import Any

from page_browser import MARKS, TABLET, a_page, api, browser, shows
from player_samples import address, flat_texture
from sharing_samples import about, playing_shared, shared, until
from test_player_page import hears, stroke

__all__ = ["browser"]
pytestmark = MARKS


async def test_a_visitor_feels_the_model_as_it_becomes(browser: Any, tmp_path: Path) -> None:
    async with shared() as sharing, a_page(browser, TABLET) as (page, problems):
        sharing.offer(flat_texture(1.0), about(49))
        async with playing_shared(sharing, tmp_path) as server:
            model = server.player.models[0]
            await page.goto(address(server))
            await shows(page, "#connection", "live")
            await api.expect(page.locator(".tile")).to_have_count(1)
            await page.click("#start")
            await stroke(page, 0)
            await hears(page, 0.7, 1.3)
            sharing.offer(flat_texture(4.0), about(49))
            await until(lambda: server.player.models[0] is not model)
            await hears(page, 3.0, 5.0)
            assert problems == []
