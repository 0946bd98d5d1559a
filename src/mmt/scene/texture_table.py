"""The scene's table ``[texture]``: settings of the numerics, and how often a model is updated.

Its keys are the fields of `mmt.texture.settings.TextureSettings`, which pydantic validates by
their annotations.
"""

from dataclasses import dataclass, fields
from typing import Annotated, ClassVar, Final

from annotated_types import Ge, Le
from pydantic import ConfigDict, TypeAdapter

from mmt.scene.table import Part
from mmt.texture.settings import ModellingSettings, TextureSettings


@dataclass(frozen=True)
class Texture(TextureSettings, Part):
    """``[texture]``: segment the stream, fit, and build the model."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)

    update_period_s: Annotated[float, Ge(0.1), Le(10)] = 1.0
    """Time between two updates of the model."""

    def settings(self, rate_hz: float) -> ModellingSettings:
        """Return the settings of the numerics for a stream of a sampling rate."""
        keys = {field.name: getattr(self, field.name) for field in fields(TextureSettings)}
        return ModellingSettings(**keys, rate_hz=rate_hz)


TEXTURE_TABLE: Final = TypeAdapter(Texture)
"""Validates and dumps the table by itself."""
