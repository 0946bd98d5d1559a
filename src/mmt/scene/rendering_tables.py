"""The tables of the vibration that is played: from the model, and from the stream."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mmt.scene.table import PartTable


class Rendering(PartTable):
    """``[rendering]``: synthesize vibration from the model."""

    model: Path | None = None
    before: Literal["stream", "silent"] = "stream"
    generator: str | None = Field(None, min_length=1)
    renewal_samples: int = Field(1, ge=1, le=1000)
    crossfade_ms: float = Field(50.0, ge=0, le=1000)
    update_fade_ms: float = Field(1000.0, ge=0, le=10_000)

    @model_validator(mode="before")
    @classmethod
    def _without_library(cls, table: Any) -> Any:
        if isinstance(table, Mapping) and without_library(table) != table:
            raise ValueError(
                'before = "warm" and library: no longer a choice, since known textures served no '
                "better than a local model as early; leave them out, and to render earlier write "
                "start_share = 0.5 in [texture]"
            )
        return table


def without_library(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table without the keys by which earlier versions took known textures."""
    kept = {key: value for key, value in table.items() if key != "library"}
    if kept.get("before") == "warm":
        del kept["before"]
    return kept


class Playout(PartTable):
    """``[playout]``: streamed vibration through a buffer that bridges jitter."""

    delay_ms: Annotated[float, Field(ge=0, le=1000)] | Literal["auto"] = "auto"
    longest_delay_ms: float = Field(100.0, gt=0, le=1000)
    conceal: Literal["auto", "model", "repetition", "silence"] = "auto"
