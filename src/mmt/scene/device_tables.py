"""Tables of the robot, the hand and the actuator: real, simulated or replayed."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self, TypeAlias

from pydantic import ConfigDict, Field, field_validator, model_validator

from mmt.scene.table import PartTable, Service, Table

DRIVER_PATTERN: Final = r"^([\w-]+|[\w.]+:\w+)$"
"""A driver's name, as in ``ati-net-ft``, or ``package.module:factory``."""

HAND_KINDS: Final = ("strokes", "quick", "circles", "taps", "scratching", "pauses")
"""Kinds of simulated hands; see `mmt.testing.simulation.motions`."""

LARGEST_SPEED: Final = 100.0
"""Largest speed of a replay, relative to real time."""

Corner: TypeAlias = tuple[float, float, float]
"""x, y, z (mm)."""

Box: TypeAlias = tuple[Corner, Corner]
"""The lowest and the highest corner."""


class Driver(Table):
    """A driver and its options, which the driver validates; a string is short for the driver."""

    model_config = ConfigDict(extra="allow")

    driver: str = Field(pattern=DRIVER_PATTERN)

    @model_validator(mode="before")
    @classmethod
    def _short(cls, given: Any) -> Any:
        return {"driver": given} if isinstance(given, str) else given

    @property
    def options(self) -> dict[str, Any]:
        """The keys other than ``driver``, unvalidated."""
        return dict(self.model_extra or {})


class Handle(Driver, PartTable):
    """``[handle]``: the operator holds a real handle."""

    model_config = ConfigDict(extra="allow")

    on_lost: Literal["hold", "stop"] = "hold"
    hand_force: Literal["contact", "measured"] = "contact"
    surface_stiffness_n_mm: float = Field(0.5, gt=0, le=50)


class Actuator(PartTable):
    """``[actuator]``: the device that plays the vibration; without a driver a simulated one."""

    model_config = ConfigDict(extra="allow")

    driver: str | None = Field(None, pattern=DRIVER_PATTERN)
    limit_m_s2: float = Field(60.0, gt=0, le=1000)
    slew_m_s3: Annotated[float, Field(gt=0, le=1e8)] | Literal["off"] = 60_000.0

    @property
    def options(self) -> dict[str, Any]:
        """Keys that the driver defines."""
        return dict(self.model_extra or {})

    @model_validator(mode="after")
    def _of_the_driver(self) -> Self:
        if self.driver is None and self.model_extra:
            raise ValueError(
                f"{', '.join(self.model_extra)} is not a key without a driver, which may take it; "
                f"allowed are {', '.join(type(self).model_fields)}"
            )
        return self


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


class MotionLimits(PartTable):
    """Base class for the tables of sources that move a robot: workspace and acceleration limit.

    The workspace is a box, given by its lowest and its highest corner.
    """

    workspace_mm: Box | Literal["off"] = ((-1000.0, -1000.0, -1000.0), (1000.0, 1000.0, 1000.0))
    acceleration_limit_mm_s2: Annotated[float, Field(ge=100, le=1e7)] | Literal["off"] = 300_000.0

    @property
    def box_mm(self) -> Box | None:
        """Corners of the workspace, or None if it is unlimited."""
        return None if self.workspace_mm == "off" else self.workspace_mm

    @model_validator(mode="after")
    def _corners(self) -> Self:
        for axis, low, high in zip("xyz", *(self.box_mm or ((), ())), strict=False):
            if not low < high:
                raise ValueError(
                    f"workspace_mm reaches from {low:g} to {high:g} mm along {axis}: give the "
                    "lowest corner first, then the highest"
                )
        return self

    def describe(self) -> tuple[str, str]:
        """Return workspace and acceleration limit in words."""
        most = self.acceleration_limit_mm_s2
        where = "any position"
        if self.box_mm is not None:
            ranges = zip("xyz", *self.box_mm, strict=True)
            where = ", ".join(f"{axis} {low:g} to {high:g}" for axis, low, high in ranges) + " mm"
        return where, "any acceleration" if most == "off" else f"{most:g} mm/s² along each axis"


class Devices(MotionLimits):
    """``[devices]``: the follower reads real devices, each by its driver."""

    runs_in: ClassVar[tuple[Service, ...]] = ("follower",)

    robot: Driver
    force_sensor: Driver | None = None
    accelerometer: Driver | None = None
    tool: str | None = Field(None, min_length=1)
    tool_axes: tuple[Literal["force", "acceleration"], ...] | None = None
    on_lost: Literal["stop", "hold", "retract"] = "stop"

    @model_validator(mode="after")
    def _tool_is_measured(self) -> Self:
        if self.tool is not None and (self.force_sensor is None or self.accelerometer is None):
            raise ValueError("tool: its load needs a force_sensor and an accelerometer on the tool")
        if self.tool is not None and len(set(self.tool_axes or ())) == 1:
            raise ValueError(
                "tool: its load turns with both sensors: name both in tool_axes, or neither"
            )
        return self


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


class Replay(PartTable):
    """``[replay]``: the follower sends a recorded session with its true timing."""

    runs_in: ClassVar[tuple[Service, ...]] = ("follower",)

    file: Path | None = None
    speed: float = Field(1.0, gt=0, le=LARGEST_SPEED)
    loop: bool = False
    gaps: Literal["keep", "skip"] = "keep"
