"""Pages that play a shared model: several at once, and each change of it."""

import json

from player_samples import flat_texture, visiting
from sharing_samples import about, playing_shared, shared

from mmt.texture.model.json_form import model_json


def form(model):
    return json.loads(model_json(model, "a table"))


async def said(page, sentence):
    while sentence not in (await page.until("status"))["said"]:
        pass


async def test_pages_get_one_surface_and_what_becomes_of_it(tmp_path):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as one,
        visiting(server) as other,
    ):
        hello = await one.until("hello")
        assert hello["names"] == ["a table"]
        assert not hello["scenarios"]
        sharing.offer(flat_texture(2.0), about(20, ready=False))
        await said(one, "listening to a table")
        assert server.player.model_messages == ()  # it is not ready
        for rms_m_s2 in (1.0, 4.0):
            model = flat_texture(rms_m_s2)
            sharing.offer(model, about(49))
            for page in (one, other):
                assert await page.model() == form(model)
        refused = await one.order(do="begin", scenario="matching", participant="P")
        assert refused["text"] == "this page plays a shared surface: it has no scenarios"
        sharing.relay.finish("done")
        await said(other, "the shared session has ended: done: the last state stays")


async def test_a_model_that_no_page_can_render_is_told_and_the_last_one_stays(
    tmp_path, monkeypatch
):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as page,
    ):
        sharing.offer(flat_texture(1.0), about(49))
        first = await page.model()
        with monkeypatch.context() as patch:
            patch.setattr("mmt.texture.model.json_form.MOST_ROWS", 3)
            sharing.offer(flat_texture(2.0), about(49))
            await said(page, "select fewer samples")
        sharing.offer(flat_texture(4.0), about(49))
        assert await page.model() == form(flat_texture(4.0)) != first


async def test_pages_see_the_leaders_hand(tmp_path):
    async with (
        shared() as sharing,
        playing_shared(sharing, tmp_path) as server,
        visiting(server) as page,
    ):
        sharing.publish(6)
        await page.model()
        for step in range(4):
            sharing.offer_state(0.1 * step, force_n=float(step % 2), position_mm=(step, -2.0, 9.0))
            hand = await page.until("hand")
            assert (hand["x_mm"], hand["y_mm"]) == (step, -2.0)
            assert hand["touches"] is bool(step % 2)
