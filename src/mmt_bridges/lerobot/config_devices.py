"""The options of the robot and of the teleoperator on LeRobot's command line."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("mmt")
@dataclass(kw_only=True)
class MmtRobotConfig(RobotConfig):
    """``--robot.type=mmt``; see `mmt_bridges.lerobot.settings.Settings`."""

    scene: str = "demo"
    follower: bool = True
    moved_by: str = "hand"
    wait_s: float = 60.0


@TeleoperatorConfig.register_subclass("mmt")
@dataclass(kw_only=True)
class MmtTeleoperatorConfig(TeleoperatorConfig):
    """``--teleop.type=mmt``; `scene` is that of the robot."""

    scene: str = "demo"
