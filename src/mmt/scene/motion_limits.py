"""Workspace and acceleration limit of the follower's robot."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from mmt.scene.table import PartTable

Corner: TypeAlias = tuple[float, float, float]
"""x, y, z (mm)."""

Box: TypeAlias = tuple[Corner, Corner]
"""The lowest and the highest corner."""


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
