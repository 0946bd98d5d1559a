"""The tables of vibration rendered from the model and of vibration played from the stream."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from mmt.scene.table import PartTable


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


_FORMER: Final = {
    "library": "known textures served no better than a local model as early: leave it out, and to "
    "render earlier write start_share = 0.5 in [texture]",
    "update_fade_ms": "each state of the model is rendered at once: leave it out",
}
"""Keys of earlier versions, with what to write instead."""


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
