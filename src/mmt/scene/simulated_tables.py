"""The tables of a simulated run: the robot and its surface, and the operator's hand."""

from typing import ClassVar, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from mmt.scene.motion_limits import Box, MotionLimits
from mmt.scene.table import PartTable, Service, Table


class Course(Table):
    """``[simulated.course]``: the tool moves over several known surfaces in turn."""

    surfaces: tuple[str, ...] = Field(min_length=1, max_length=5)
    stay_s: float = Field(8.0, ge=0.5, le=3600)
    change: Literal["lifted", "contact", "either"] = "lifted"


class Simulated(MotionLimits):
    """``[simulated]``: simulated robot, surface of known texture and noisy sensors."""

    runs_in: ClassVar[tuple[Service, ...]] = ("follower",)

    surface: str = "plastic"
    robot_bandwidth_hz: float = Field(15.0, ge=1, le=60)
    surface_stiffness_n_mm: float = Field(5.0, ge=0.05, le=50)
    noise: bool = True
    course: Course | None = None
    workspace_mm: Box | Literal["off"] = ((-200.0, -200.0, -200.0), (200.0, 200.0, 200.0))


HAND_KINDS: Final = ("strokes", "quick", "circles", "taps", "scratching", "pauses")
"""Kinds of simulated hands; see `mmt.testing.simulation.motions`."""


class Hand(PartTable):
    """``[hand]``: a simulated hand holds the leader's interface and strokes."""

    kind: str = "strokes"
    slowest_mm_s: float = Field(20.0, ge=5, le=300)
    fastest_mm_s: float = Field(290.0, ge=5, le=500)
    lightest_n: float = Field(0.2, ge=0.05, le=3)
    strongest_n: float = Field(2.9, ge=0.05, le=5)
    rest_share: float = Field(0.04, ge=0, le=0.9)
    headings: Literal["opposite", "all"] = "opposite"

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in HAND_KINDS and not kind.endswith(".npz"):
            raise ValueError(
                f"{kind!r} is not known, allowed are {', '.join(HAND_KINDS)}, and the file of a "
                "recorded stroke (.npz)"
            )
        return kind

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        if self.fastest_mm_s <= self.slowest_mm_s:
            raise ValueError("fastest_mm_s must exceed slowest_mm_s")
        if self.strongest_n <= self.lightest_n:
            raise ValueError("strongest_n must exceed lightest_n")
        return self
