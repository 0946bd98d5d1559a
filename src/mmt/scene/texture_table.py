"""The scene's table ``[texture]``: settings of the numerics, and the model's update period.

Its keys are the fields of the dataclass `mmt.texture.settings.TextureSettings`; pydantic
validates them by their annotations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Final

from annotated_types import Ge, Le
from pydantic import ConfigDict, TypeAdapter, model_validator

from mmt.scene.table import OptionalTable
from mmt.texture.settings import THRESHOLDS, Method, ModellingSettings, TextureSettings

_PARTS: Final = ("interpolate", "interpolator", "level", "shape", "criterion")
"""Keys with which scenes of earlier versions composed a method."""

_OF_FIELD: Final = {
    "level": "gaussian_process",
    "shape": "smoothed",
    "criterion": "uncertainty",
    "interpolate": "power",
}


@dataclass(frozen=True)
class Texture(TextureSettings, OptionalTable):
    """``[texture]``: segment the stream, fit filters and build the model."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)

    update_period_s: Annotated[float, Ge(0.1), Le(10)] = 1.0
    """Time between two updates of the model."""

    @model_validator(mode="before")
    @classmethod
    def _without_parts(cls, table: Any) -> Any:
        if isinstance(table, Mapping) and "selection" in table:
            raise ValueError(
                "selection: no longer a table, since a model in which it kept outliers out was "
                "not better; leave it out (`mmt model select` selects from whole trials)"
            )
        former = _former(table) if isinstance(table, Mapping) else []
        if former:
            raise ValueError(
                f"{' and '.join(former)}: no longer a choice; write method = "
                f'"{_nearest(table)}", which comes nearest (the methods are "field", the default, '
                'and "published")'
            )
        return table

    def settings(self, samples_per_frame: int = 1) -> ModellingSettings:
        """Return the settings of the numerics for a stream of so many samples per frame."""
        keys = {field.name: getattr(self, field.name) for field in fields(TextureSettings)}
        return ModellingSettings(**keys, samples_per_frame=samples_per_frame)


TEXTURE_TABLE: Final = TypeAdapter(Texture)
"""Validates and serializes the table by itself."""


def by_method(table: Mapping[str, Any]) -> Mapping[str, Any]:
    """Convert a table of an earlier version, which may compose its method from parts.

    The result names the nearest method and keeps its thresholds; ``selection`` is dropped.
    """
    table = {k: v for k, v in table.items() if k != "selection" and (k, v) != ("order", "auto")}
    if not _former(table):
        return table
    method = _nearest(table)
    others = {key for name, keys in THRESHOLDS.items() if name != method for key in keys}
    kept = {key: value for key, value in table.items() if key not in {*_PARTS, *others}}
    return {**kept, "method": method}


def _former(table: Mapping[str, Any]) -> list[str]:
    """Return the settings that only earlier versions had, as text for a message."""
    former = [f'{key} = "{table[key]}"' for key in _PARTS if key in table]
    return [*former, *(['method = "custom"'] if table.get("method") == "custom" else [])]


def _nearest(table: Mapping[str, Any]) -> Method:
    """Return the method nearest to a table of parts; the first of `_OF_FIELD`'s keys decides."""
    if table.get("method") == "published":
        return "published"
    for key, value in _OF_FIELD.items():
        if key in table:
            return "field" if table[key] == value else "published"
    return "published" if table.get("interpolator") == "network" else "field"
