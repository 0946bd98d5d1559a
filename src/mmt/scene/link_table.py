"""The scene's table ``[link]``: address and security of the link, and time-outs."""

from typing import ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.secured_table import ServedTable
from mmt.scene.table import Service

_LONGEST_SILENCE_MS: Final = 250.0


class Link(ServedTable):
    """``[link]``: the leader listens, the follower connects."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    port: int = Field(8765, ge=0, le=65_535)
    frames_per_message: int = Field(1, ge=1, le=100)
    patience_s: float = Field(10.0, ge=0.5, le=3600)
    clock_hz: float = Field(20.0, ge=0, le=100)
    keep_s: float = Field(10.0, ge=0, le=60)
    silence_ms: float = Field(100.0, ge=10, le=10_000)
    longest_silence_ms: float | None = Field(None, ge=10, le=10_000)
    on_silence: Literal["hold", "retract"] = "hold"
    retract_mm: float = Field(10.0, gt=0, le=100)
    stale_ms: float = Field(500.0, ge=10, le=10_000)
    recovery_mm_s: float = Field(50.0, ge=1, le=1000)
    limit_mm_s: float = Field(1000.0, ge=10, le=10_000)

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        if self.longest_wait_ms < self.silence_ms:
            raise ValueError(
                f"longest_silence_ms is {self.longest_wait_ms:g}, less than silence_ms, "
                f"{self.silence_ms:g}: give as much or more"
            )
        return self

    @property
    def longest_wait_ms(self) -> float:
        """``longest_silence_ms`` if given, else ``silence_ms`` if given, else 250."""
        if self.longest_silence_ms is not None:
            return self.longest_silence_ms
        return self.silence_ms if "silence_ms" in self.model_fields_set else _LONGEST_SILENCE_MS
