"""The options of the robot and of the teleoperator on LeRobot's command line."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("mmt")
@dataclass(kw_only=True)
class MmtRobotConfig(RobotConfig):
    """``--robot.type=mmt``; see `mmt_bridges.lerobot.settings.Settings`, and LeRobot's cameras."""

    scene: str = "demo"
    follower: bool = True
    moved_by: str = "hand"
    wait_s: float = 60.0
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass("mmt")
@dataclass(kw_only=True)
class MmtTeleoperatorConfig(TeleoperatorConfig):
    """``--teleop.type=mmt``; `scene` is that of the robot."""

    scene: str = "demo"
