"""A shared surface in a real browser: a visitor feels it, and what becomes of it."""

from page_browser import MARKS, OVERFLOW, PHONE, a_page, api, browser, shows
from player_samples import address, flat_texture
from sharing_samples import about, playing_shared, shared
from test_player_page import hears, stroke

__all__ = ["browser"]
pytestmark = MARKS


async def test_a_visitor_feels_the_model_as_it_becomes_and_after_its_end(browser, tmp_path):
    async with shared() as sharing, a_page(browser, PHONE) as page:
        async with playing_shared(sharing, tmp_path) as server:
            await page.goto(address(server))
            await shows(page, ".tile", "not ready yet: the leader still explores the surface")
            sharing.publish(40, ready=False)
            await shows(page, ".tile", "not ready yet: completion sum 5.00")
            for hidden in ("#study", "#help", "#controls"):
                await api.expect(page.locator(hidden)).to_be_hidden()
            sharing.offer(flat_texture(1.0), about(49))
            await shows(page, ".tile", "touch to feel")
            box = await page.locator(".tile").bounding_box()
            assert box["width"] > 0.85 * PHONE[0]
            assert box["height"] > 0.5 * PHONE[1]
            assert await page.evaluate(OVERFLOW) <= 0
            sharing.offer_state(1.0, force_n=1.0)
            await api.expect(page.locator(".tile.led")).to_have_count(1)
            await stroke(page, 0)
            await hears(page, 0.7, 1.3)
            sharing.offer(flat_texture(4.0), about(49))
            await hears(page, 3.0, 5.0)
            sharing.relay.finish("done")
            await shows(page, "#recording", "has ended: done: the last state stays")
        await shows(page, "#connection", "this page plays on")
        await hears(page, 3.0, 5.0)
