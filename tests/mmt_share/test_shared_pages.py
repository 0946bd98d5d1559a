"""Pages that play a shared model: several at once, and each change of it."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
from player_samples import flat_texture, visiting
from sharing_samples import Shared, about, playing_shared, shared, until


def rms(sound: np.ndarray) -> float:
    return float(np.sqrt(np.mean(sound**2)))


async def become_ready(sharing: Shared) -> None:
    """Share a model that is ready after the page has said that it is not."""
    sharing.offer(flat_texture(1.0), about(49, ready=False))
    await until(lambda: any("not ready yet" in text for text in sharing.said))
    sharing.offer(flat_texture(1.0), about(49))


async def test_two_pages_feel_one_surface_and_what_becomes_of_it(tmp_path: Path) -> None:
    async with shared() as sharing:
        becoming = asyncio.create_task(become_ready(sharing))
        async with playing_shared(sharing, tmp_path) as server:
            await becoming
            player = server.player
            (model,) = player.models
            assert player.names == ("a table",)
            async with visiting(server) as one, visiting(server) as other:
                for page in (one, other):
                    await page.open()
                    await page.stroke(0, 0.2)
                    assert rms(await page.stroke(0, 1.0)) == pytest.approx(1.0, rel=0.25)
                sharing.offer(flat_texture(4.0), about(49))
                await until(lambda: player.models[0] is not model)
                for page in (one, other):
                    await page.stroke(0, 0.2)
                    assert rms(await page.stroke(0, 1.0)) == pytest.approx(4.0, rel=0.25)
                refused = await one.order(do="begin", scenario="matching", participant="P")
                assert refused["text"] == "this page plays a shared surface: it has no scenarios"
