"""The scene's table ``[texture]``: how the texture is modelled."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable, Table
from mmt.texture.settings import (
    AUTOMATIC,
    START_SHARE,
    STOP_SHARE,
    Criterion,
    Inputs,
    Interpolated,
    Interpolation,
    Level,
    ModellingSettings,
    OnlineSelectionSettings,
    Shape,
    SurfaceSettings,
)

_Distance = Annotated[float, Field(gt=0)] | Literal["auto"]


class Selection(Table):
    """``[texture.selection]``: keep knocks out of the model, and its size below a limit."""

    limit: float = Field(14.5, gt=0, le=1000)
    largest: int = Field(200, ge=10, le=1000)


class Surfaces(Table):
    """``[texture.surfaces]``: a model for each of several surfaces."""

    false_alarms_per_hour: float = Field(1.0, ge=0.001, le=1000)
    most: int = Field(20, ge=2, le=100)


class Texture(PartTable):
    """``[texture]``: segment the stream, fit, and build the model."""

    axis: Literal["x", "y", "z", "dft321"] = "z"
    normal: Literal["x", "y", "z"] = "z"
    order: int | Literal["auto"] = "auto"
    update_period_s: float = Field(1.0, ge=0.1, le=10)
    overlap_samples: int = Field(200, ge=0, le=2000)
    straightness_mm: float = Field(1.0, gt=0, le=50)
    stationarity: float = Field(0.12, gt=0, le=1)
    shortest_samples: int = Field(120, ge=30, le=2000)
    longest_samples: int = Field(1000, ge=100, le=5000)
    least_speed_mm_s: float = Field(10.0, gt=0, le=300)
    least_force_n: float = Field(0.1, gt=0, le=3)
    inputs: Inputs = "isotropic"
    start_distance: _Distance = "auto"
    stop_distance: _Distance = "auto"
    criterion: Criterion = "distance"
    start_share: float = Field(START_SHARE, gt=0, lt=1)
    stop_share: float = Field(STOP_SHARE, gt=0, lt=1)
    interpolate: Interpolated = "power"
    interpolator: Interpolation = "delaunay"
    level: Level = "interpolated"
    shape: Shape = "measured"
    selection: Selection | None = None
    surfaces: Surfaces | None = None

    @model_validator(mode="after")
    def _order(self) -> Self:
        if self.order != "auto" and not 1 <= self.order <= 64:
            raise ValueError(f"order is {self.order}, allowed are 'auto' and 1 to 64")
        settings = self.settings(1000.0)
        if settings.stop_distance > settings.start_distance:
            raise ValueError(
                f"stop_distance is {settings.stop_distance:g} and start_distance "
                f"{settings.start_distance:g}: stop_distance must not exceed start_distance"
            )
        if self.stop_share < self.start_share:
            raise ValueError(
                f"stop_share is {self.stop_share:g} and start_share {self.start_share:g}: "
                "stop_share must not be below start_share"
            )
        if self.criterion == "uncertainty" and self.level != "gaussian_process":
            raise ValueError(
                f'criterion is "uncertainty" and level "{self.level}", whose error is not known: '
                'set level to "gaussian_process", or leave criterion at "distance"'
            )
        if self.level != "interpolated" and self.interpolate != "power":
            raise ValueError(
                f'interpolate is "{self.interpolate}" and level "{self.level}": with this level '
                'nothing is interpolated beside the spectrum\'s shape; leave interpolate at "power"'
            )
        if self.longest_samples < 2 * self.shortest_samples:
            raise ValueError("longest_samples must be at least twice shortest_samples")
        return self

    def settings(self, rate_hz: float) -> ModellingSettings:
        """Return the same values as the numerics take them."""
        values = self.model_dump(exclude={"update_period_s"})
        for name in ("start_distance", "stop_distance"):
            if values[name] == "auto":
                values[name] = AUTOMATIC
        if self.selection is not None:
            values["selection"] = OnlineSelectionSettings(**values["selection"])
        if self.surfaces is not None:
            values["surfaces"] = SurfaceSettings(**values["surfaces"])
        return ModellingSettings(**values, rate_hz=rate_hz)
