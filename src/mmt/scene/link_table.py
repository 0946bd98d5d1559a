"""The scene's table ``[link]``: who listens, who may connect, and what silence means."""

from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable, Service


class Link(PartTable):
    """``[link]``: the leader listens, the follower connects."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    host: str = "127.0.0.1"
    port: int = Field(8765, ge=0, le=65_535)
    frames_per_message: int = Field(1, ge=1, le=100)
    patience_s: float = Field(10.0, ge=0.5, le=3600)
    clock_hz: float = Field(20.0, ge=0, le=100)
    token_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    authority: Path | None = None
    open: bool = False
    keep_s: float = Field(10.0, ge=0, le=60)
    silence_ms: float = Field(100.0, ge=10, le=10_000)
    on_silence: Literal["hold", "retract"] = "hold"
    retract_mm: float = Field(10.0, gt=0, le=100)
    stale_ms: float = Field(500.0, ge=10, le=10_000)
    recovery_mm_s: float = Field(50.0, ge=1, le=1000)
    limit_mm_s: float = Field(1000.0, ge=10, le=10_000)

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both or neither")
        return self

    def url(self, port: int | None = None) -> str:
        """Return the leader's URL; `port` where it is not the scene's own."""
        secure = self.certificate is not None or self.authority is not None
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if secure else 'http'}://{host}:{self.port if port is None else port}"
