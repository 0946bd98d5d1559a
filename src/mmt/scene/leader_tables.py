"""Tables of what the leader does: model, render, play, display force, record, and show the run."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from annotated_types import Ge, Le
from pydantic import ConfigDict, Field, TypeAdapter, model_validator

from mmt.scene.table import OptionalTable, PartTable, Service
from mmt.texture.settings import THRESHOLDS, Method, ModellingSettings, TextureSettings

_PORT: Final = ("reserve_mj", "largest_damping_n_s_m")
_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "streamed": (),
    "passive": (*_PORT, "largest_drift_mm"),
    "model": (*_PORT, "largest_stiffness_n_mm", "contact_n", "forgetting_s"),
}
"""Keys that only some methods have, by method."""

_PARTS: Final = ("interpolate", "interpolator", "level", "shape", "criterion")
"""Keys with which scenes of earlier versions composed a method."""

_OF_FIELD: Final = {
    "level": "gaussian_process",
    "shape": "smoothed",
    "criterion": "uncertainty",
    "interpolate": "power",
}

_FORMER: Final = {
    "library": "known textures served no better than a local model as early: leave it out, and to "
    "render earlier write start_share = 0.5 in [texture]",
    "update_fade_ms": "each state of the model is rendered at once: leave it out",
}
"""Keys of earlier versions, with what to write instead."""


@dataclass(frozen=True)
class Texture(TextureSettings, OptionalTable):
    """``[texture]``: segment the stream, fit filters and build the model.

    Its keys are the fields of `TextureSettings`; pydantic validates them by their annotations.
    """

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


class Rendering(PartTable):
    """``[rendering]``: synthesize vibration from the model."""

    model: Path | None = None
    before: Literal["stream", "silent"] = "stream"
    generator: str | None = Field(None, min_length=1)
    renewal_samples: int = Field(1, ge=1, le=1000)
    crossfade_ms: float = Field(50.0, ge=0, le=1000)

    @model_validator(mode="before")
    @classmethod
    def _without_former(cls, table: Any) -> Any:
        if isinstance(table, Mapping):
            for key in _FORMER.keys() & table.keys():
                raise ValueError(f"{key}: no longer a key; {_FORMER[key]}")
            if table.get("before") == "warm":
                raise ValueError(f'before = "warm": no longer a choice; {_FORMER["library"]}')
        return table


def without_former(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without keys and values that only earlier versions had."""
    kept = {key: value for key, value in table.items() if key not in _FORMER}
    if kept.get("before") == "warm":
        del kept["before"]
    return kept


class Playout(PartTable):
    """``[playout]``: play streamed vibration through a jitter buffer."""

    delay_ms: Annotated[float, Field(ge=0, le=1000)] | Literal["auto"] = "auto"
    longest_delay_ms: float = Field(100.0, gt=0, le=1000)
    conceal: Literal["auto", "model", "repetition", "silence"] = "auto"


class ForceFeedback(PartTable):
    """``[force_feedback]``: the remote force goes to the leader's interface."""

    method: Literal["streamed", "passive", "model"] = "streamed"
    limit_n: float = Field(3.3, gt=0, le=40)
    slew_n_s: Annotated[float, Field(gt=0, le=1e6)] | Literal["off"] = 1000.0
    reserve_mj: float = Field(1.0, ge=0.01, le=100)
    largest_damping_n_s_m: float = Field(10.0, ge=0, le=100)
    largest_drift_mm: float = Field(3.0, ge=0, le=50)
    largest_stiffness_n_mm: float = Field(10.0, ge=0.1, le=100)
    contact_n: float = Field(0.2, ge=0.02, le=5)
    forgetting_s: float = Field(0.5, ge=0.05, le=60)

    @model_validator(mode="after")
    def _keys_of_the_method(self) -> Self:
        allowed = {"method", "limit_n", "slew_n_s", *_KEYS[self.method]}
        for key in sorted(self.model_fields_set - allowed):
            default = type(self).model_fields[key].default
            if getattr(self, key) == default:
                continue  # a resolved scene holds every default
            methods = " or ".join(f'"{name}"' for name, keys in _KEYS.items() if key in keys)
            raise ValueError(
                f'{key} has no meaning with method = "{self.method}": '
                f"remove it, or set method = {methods}"
            )
        return self

    @property
    def services(self) -> tuple[Service, ...]:
        """The leader; with every method but ``streamed`` also the follower."""
        return self.runs_in if self.method == "streamed" else ("leader", "follower")


class Recording(PartTable):
    """``[recording]``: every frame received goes into an MCAP file."""

    file: Path = Path("mmt-demo/session.mcap")
    channels: Literal["all", "needed"] = "all"
    existing: Literal["number", "refuse", "replace"] = "number"
    scalars: bool = False


class Metrics(PartTable):
    """``[metrics]``: serve metrics for Prometheus at the leader's and the follower's ports."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    follower_port: int | None = Field(None, ge=1, le=65_535)


class Monitor(PartTable):
    """``[monitor]``: the leader serves a live page of the run."""

    updates_hz: float = Field(25.0, ge=1, le=60)
