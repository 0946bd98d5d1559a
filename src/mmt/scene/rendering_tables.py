"""The tables of the vibration that is played: from the model, and from the stream."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mmt.scene.table import PartTable


class Rendering(PartTable):
    """``[rendering]``: synthesize vibration from the model."""

    model: Path | None = None
    before: Literal["stream", "warm", "silent"] = "stream"
    library: list[str | Path] = Field(default=[])
    generator: str | None = Field(None, min_length=1)
    renewal_samples: int = Field(1, ge=1, le=1000)
    crossfade_ms: float = Field(50.0, ge=0, le=1000)
    update_fade_ms: float = Field(1000.0, ge=0, le=10_000)


class Playout(PartTable):
    """``[playout]``: streamed vibration through a buffer that bridges jitter."""

    delay_ms: Annotated[float, Field(ge=0, le=1000)] | Literal["auto"] = "auto"
    longest_delay_ms: float = Field(100.0, gt=0, le=1000)
    conceal: Literal["auto", "model", "repetition", "silence"] = "auto"
