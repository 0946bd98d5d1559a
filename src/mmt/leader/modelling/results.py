"""Results of the updates, as the modelling process returns them and the leader completes them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mmt.texture.online.updates import ModelUpdate, NewSamples, ReadyModel

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel

Models = dict[int | None, "TextureModel | None"]
"""The newest model of each surface by number, or by None if surfaces are not told apart."""


class UnchangedModel(ReadyModel):
    """Placeholder for the model in the last update of the surface; `received` replaces it."""


@dataclass(frozen=True)
class UpdateResult:
    """Result of an update.

    Attributes
    ----------
    update
        The update, or None if it is not announced.
    kept
        Numbers of the surfaces whose models are kept; None if surfaces are not told apart.
    samples
        Observed samples, and segments added and removed; None unless they were asked for.
    """

    update: ModelUpdate | None
    kept: tuple[int, ...] | None
    samples: NewSamples | None


def received(update: ModelUpdate, models: Models) -> ModelUpdate:
    """Return an update with all its models filled in, and store these in `models`."""

    def source(each: ModelUpdate) -> ReadyModel:
        if not isinstance(each.source, UnchangedModel):
            models[each.surface] = each.model
        return ReadyModel(models[each.surface])

    return with_models(update, source)


def with_models(update: ModelUpdate, source: Callable[[ModelUpdate], ReadyModel]) -> ModelUpdate:
    """Return an update with new sources of its models; surfaces that were left come first."""
    left = tuple(with_models(each, source) for each in update.left)
    return replace(update, left=left, source=source(update))
