"""The warm start beside the tick: when it looks, what it hands over, and that it ends."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
from sharing_samples import shared

from mmt.core.errors import InputError
from mmt.leader.warming import WarmingPart, load_library
from mmt.models import shipped_models
from mmt.scene import Scene
from mmt.sharing.store import Entry, ModelStore
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.library.identification import Choice
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings, SurfaceSettings

Handed = list[tuple[TextureModel, Choice]]


async def until(handed: Handed, count: int) -> None:
    async with asyncio.timeout(30):
        while len(handed) < count:
            await asyncio.sleep(0.001)


async def test_models_follow_frames_until_the_end() -> None:
    frames, _ = simulate_session(Scene(), "felt", 4.0, 3)
    library = load_library([Path("felt")])
    task = WarmingPart(library, ModellingSettings())
    handed: Handed = []
    task.on_model = lambda model, choice: handed.append((model, choice))
    running = asyncio.create_task(task.run())
    for n in range(1000):
        task.on_frames(frames[n : n + 1], 0)
    task.on_frames(frames[1000:2000], 0)
    await until(handed, 1)
    assert handed[0][1].name == "felt"
    before = len(handed)
    task.reset()
    task.on_frames(frames[:2000], 0)
    await until(handed, before + 1)
    task.hand_over()
    task.on_frames(frames[2000:], 0)
    running.cancel()
    assert task.finished


async def test_on_another_surface_what_came_since_is_looked_at_again() -> None:
    frames, _ = simulate_session(Scene(), "felt", 4.0, 3)
    library = load_library([Path("felt")])
    task = WarmingPart(library, ModellingSettings(surfaces=SurfaceSettings()))
    handed: Handed = []
    task.on_model = lambda model, choice: handed.append((model, choice))
    running = asyncio.create_task(task.run())
    task.hand_over()  # the model of the former surface was rendered
    for n in range(0, 3000, 5):
        task.on_frames(frames[n : n + 5], 0)
    task.reset(1500)
    await until(handed, 1)
    assert handed[0][1].name == "felt"
    running.cancel()


def test_a_library_is_files_and_names(tmp_path: Path) -> None:
    own = tmp_path / "mine.npz"
    own.write_bytes(shipped_models()["felt"].read_bytes())
    library = load_library([Path("felt"), own])
    assert list(library) == ["felt", "mine"]
    np.testing.assert_array_equal(library["mine"].samples.lsf, library["felt"].samples.lsf)
    with pytest.raises(InputError, match="two models are called felt"):
        load_library([Path("felt"), Path("felt")])
    with pytest.raises(InputError, match="no such file; shipped are"):
        load_library([Path("nothing")])


async def test_a_library_is_of_a_store_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store = ModelStore(tmp_path / "store")
    felt, oak = (shipped_models()[name].read_bytes() for name in ("felt", "oak"))
    store.add(felt, Entry("cloth"))
    store.add(oak, Entry("felt"))
    async with shared(store=str(tmp_path / "store")) as sharing:
        library = await asyncio.to_thread(load_library, ["felt", sharing.url])
        assert set(library) == {"felt", "cloth"}  # a file goes before the store's of its name
        assert library["felt"].to_bytes() == library["cloth"].to_bytes()
        assert await asyncio.to_thread(load_library, [sharing.url], 2000.0) == {}
