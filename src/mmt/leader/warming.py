"""A first model until the local one is ready: made from a short look in a worker thread.

Frames are looked at as they come, twenty times a second and not once a period as for the model: the
choice needs a fifth of a second of stroking. What is lost and filled in later is not waited for.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import numpy as np
import platformdirs

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.leader.part import Part, Session
from mmt.models import find_model, shipped_models
from mmt.texture.library.conversion import into_space
from mmt.texture.library.identification import Choice
from mmt.texture.library.warm_start import WarmStart
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings

_ADDRESSES: Final = ("http://", "https://")

LOOK_FRAMES: Final = 50
"""Frames that are looked at together."""

_MOST_FRAMES: Final = 10_000
"""So many wait at most; what would come on top is not looked at."""

_KEPT_FRAMES: Final = 2000
"""So many are kept for a change of surface."""


def load_library(names: Sequence[str | Path], rate_hz: float = 1000.0) -> dict[str, TextureModel]:
    """Return models by name.

    Parameters
    ----------
    names
        Files, names of shipped models, and addresses of stores (``http://HOST:PORT``); all shipped
        ones where there are none.
    rate_hz
        Models of another rate that a store has are left out.

    Raises
    ------
    InputError
        A file is no model, or two have the same name.
    MmtError
        A store does not answer, and nothing of it was fetched before.
    """
    stores = [str(name) for name in names if str(name).startswith(_ADDRESSES)]
    files = [find_model(name) for name in names if str(name) not in stores]
    if not names:
        files = list(shipped_models().values())
    library: dict[str, TextureModel] = {}
    for path in files:
        if path.stem in library:
            raise InputError(f"library: two models are called {path.stem}; rename one")
        library[path.stem] = TextureModel.load(path)
    for url in stores:
        library = _of_store(url, rate_hz) | library
    return library


def _of_store(url: str, rate_hz: float) -> dict[str, TextureModel]:
    """Return the newest model of each name in a store."""
    from mmt.sharing.store_client import RemoteStore  # most scenes name no store

    remote = RemoteStore.from_environment(url)
    folder = platformdirs.user_cache_path("mmt-haptics", appauthor=False) / "models"
    return {
        entry.name: TextureModel.load(path)
        for entry, path in remote.newest(folder)
        if entry.rate_hz == rate_hz
    }


class WarmingPart(Part):
    """Look at frames, and make a first model of the surface.

    Parameters
    ----------
    library
        Models by name.
    settings
        Settings of the local model. Where it tells surfaces apart, the newest frames are kept:
        a change of surface is found late, and the frames since then are evaluated again.

    Raises
    ------
    InputError
        The library cannot be used; see `WarmStart`.
    """

    def __init__(self, library: Mapping[str, TextureModel], settings: ModellingSettings) -> None:
        space = InputSpace(settings.inputs)
        self._library = {name: into_space(model, space) for name, model in library.items()}
        self._settings = settings
        self.on_model: Callable[[TextureModel, Choice], None] = lambda _model, _choice: None
        """Called on the event loop with each new model and what it was made from."""
        self._due = asyncio.Event()
        self._warm = WarmStart(self._library, settings)
        self._frames: list[RecordArray] = []
        self._waiting = 0
        self._recent: deque[RecordArray] | None = None if settings.surfaces is None else deque()
        self.finished = False

    @classmethod
    def build(cls, session: Session) -> "WarmingPart | None":
        """Return the scene's warm start.

        Raises
        ------
        InputError
            The library cannot be used.
        MmtError
            A store of the library does not answer.
        """
        scene = session.scene
        if scene.rendering is None or scene.texture is None or scene.actuator is None:
            return None
        settings = scene.texture.settings(session.rate_hz)
        return cls(load_library(scene.rendering.library, settings.rate_hz), settings)

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the task that looks."""
        return {"warming": self.run()}

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Queue frames; never blocks."""
        _ = arrival_ns
        if self._recent is not None:
            self._recent.append(frames)
            newest = int(frames["sequence"][-1])
            while int(self._recent[0]["sequence"][-1]) <= newest - _KEPT_FRAMES:
                self._recent.popleft()
        if self.finished or self._waiting >= _MOST_FRAMES:
            return
        self._frames.append(frames)
        self._waiting += len(frames)
        if self._waiting >= LOOK_FRAMES:
            self._due.set()

    def hand_over(self) -> None:
        """Do no more: the local model has taken over."""
        self.finished = True
        self._frames.clear()

    def reset(self, from_sample: int | None = None) -> None:
        """Look anew, as on another surface; what is under way is thrown away.

        Parameters
        ----------
        from_sample
            The first sequence number on this surface, where it has been touched already.
        """
        self._warm = WarmStart(self._library, self._settings)
        self._frames, self._waiting = [], 0
        self.finished = False
        if from_sample is not None and self._recent:
            recent = np.concatenate(self._recent)
            since = recent[recent["sequence"] >= from_sample]
            self._frames, self._waiting = [since], len(since)
            self._due.set()

    async def run(self) -> None:
        """Look until cancelled."""
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="warm start") as worker:
            loop = asyncio.get_running_loop()
            while True:
                await self._due.wait()
                self._due.clear()
                warm, frames = self._warm, self._frames
                self._frames, self._waiting = [], 0
                made = await loop.run_in_executor(worker, _work, warm, frames)
                if made is not None and warm is self._warm and not self.finished:
                    self.on_model(*made)


def _work(warm: WarmStart, frames: Sequence[RecordArray]) -> tuple[TextureModel, Choice] | None:
    """Return a new model and the choice that it is made by, where frames lead to one."""
    chosen = warm.process(np.concatenate(frames)) if frames else None
    return None if chosen is None or warm.model is None else (warm.model, chosen)
