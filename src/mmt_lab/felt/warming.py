"""A warm start in simulated time: which known texture is rendered from when, and how it moves."""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.leader.warming import LOOK_FRAMES, load_library
from mmt.texture.library.conversion import into_space
from mmt.texture.library.warm_start import WarmStart
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.modeller import ModelUpdate
from mmt.texture.settings import ModellingSettings
from mmt_lab.felt.passing import NEVER_TICK, Passage

LOOK_TICKS: Final = 50
"""So long after its last frame a choice is in use."""


@cache
def shipped_library() -> Mapping[str, TextureModel]:
    """Return the shipped models by the names of their textures."""
    return load_library(())


def library_without(texture: str) -> dict[str, TextureModel]:
    """Return the shipped models but the texture's own."""
    return {name: model for name, model in shipped_library().items() if name != texture}


def warm_models(
    passage: Passage,
    updates: Mapping[int, ModelUpdate],
    library: Mapping[str, TextureModel],
    settings: ModellingSettings,
) -> dict[int, TextureModel]:
    """Return what is rendered before the start criterion, each at the tick from which it is.

    Parameters
    ----------
    passage
        What arrives when.
    updates
        Of the local model, by the tick from which each is in use.
    library
        Known textures by name.
    settings
        Of the local model.
    """
    space = InputSpace(settings.inputs)
    known = {name: into_space(model, space) for name, model in library.items()}
    warm = WarmStart(known, settings)
    news: list[tuple[int, RecordArray | ModelUpdate]] = [*_looks(passage), *updates.items()]
    models: dict[int, TextureModel] = {}
    samples = None
    for tick, new in sorted(news, key=lambda one: one[0]):
        if isinstance(new, ModelUpdate):
            if new.started:
                break
            samples = new.model.samples if new.model is not None else None
        elif warm.take(new) is None:
            continue
        model = warm.model(samples)
        if model is not None:
            models[tick] = model
    return models


def _looks(passage: Passage) -> Iterator[tuple[int, RecordArray]]:
    """Yield frames as they arrive, so many at a time, each with the tick of its use."""
    order = np.argsort(passage.arrival_tick, kind="stable")
    order = order[passage.arrival_tick[order] < NEVER_TICK]
    for first in range(0, len(order) - LOOK_FRAMES + 1, LOOK_FRAMES):
        chosen = order[first : first + LOOK_FRAMES]
        yield int(passage.arrival_tick[chosen[-1]]) + LOOK_TICKS, passage.frames[chosen]
