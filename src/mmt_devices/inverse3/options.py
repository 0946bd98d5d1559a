"""The options of the drivers, as a scene gives them."""

from typing import Literal

from pydantic import Field

from mmt.devices.axes import AxesOptions, Millimetres


class InverseOptions(AxesOptions):
    """Options that robot and handle share.

    The service measures in metres, in a scene's axes: +x to the right, +y forward (away from the
    user), and +z up. Its origin is the base of the device. By default the scene's zero is about
    the middle of an Inverse3's workspace.
    """

    address: str = Field("ws://localhost:10001", pattern=r"^wss?://[^\s/]+\S*$")
    device: str | None = Field(None, min_length=1, max_length=63)
    commands: Literal["auto", "3.1", "3.5"] = "auto"
    origin_mm: tuple[Millimetres, Millimetres, Millimetres] = (0.0, -150.0, 150.0)
    stale_ms: float = Field(50.0, ge=5, le=1000)
    timeout_ms: float = Field(100.0, ge=10, le=2000)
    calibration_s: float = Field(5.0, ge=0, le=120)


class Inverse3RobotOptions(InverseOptions):
    """Options of the robot: limits of the point at which the service holds the tip."""

    speed_limit_mm_s: float = Field(500.0, gt=0, le=2000)
    lead_limit_mm: float = Field(10.0, ge=1, le=100)


class HandleOptions(InverseOptions):
    """Options of the handle: the force that it displays."""

    force_limit_n: float = Field(3.0, gt=0, le=10)
    ramp_ms: float = Field(100.0, ge=5, le=2000)
