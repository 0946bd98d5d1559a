"""The scene's table ``[hand]``: how a simulated operator explores the surface."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Hand(BaseModel):
    """``[hand]``: a simulated hand holds the leader's interface and strokes."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    slowest_mm_s: float = Field(20.0, ge=5, le=300)
    fastest_mm_s: float = Field(290.0, ge=5, le=500)
    lightest_n: float = Field(0.2, ge=0.05, le=3)
    strongest_n: float = Field(2.9, ge=0.05, le=5)
    rest_share: float = Field(0.04, ge=0, le=0.9)
    headings: Literal["opposite", "all"] = "opposite"

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        if self.fastest_mm_s <= self.slowest_mm_s:
            raise ValueError("fastest_mm_s must exceed slowest_mm_s")
        if self.strongest_n <= self.lightest_n:
            raise ValueError("strongest_n must exceed lightest_n")
        return self
