"""Settings of a session under LeRobot, and the scene that is made from them."""

from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, TypeAlias

from annotated_types import Gt, Le

from mmt.core.bounds import check_fields
from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.scene.files import load_scene, scene_from_tables

MovedBy: TypeAlias = Literal["hand", "actions"]

_LONGEST_S: Final = 86_400.0
"""LeRobot ends the session; this is the longest that a scene may last."""
_ACTION_HANDLE: Final = "mmt_bridges.lerobot.observing:ActionHandle"


@dataclass(frozen=True)
class Settings:
    """Settings of a session.

    Attributes
    ----------
    scene
        A TOML file, or an example's name.
    follower
        Whether the follower runs here, too; if not, one is waited for at the scene's port.
    moved_by
        What moves the robot: the scene's hand or handle, or LeRobot's actions in its place.
    wait_s
        Time (s) within which the first frame must come.

    Raises
    ------
    InputError
        `moved_by` is not known, or `wait_s` is out of range.
    """

    scene: str = "demo"
    follower: bool = True
    moved_by: MovedBy = "hand"
    wait_s: Annotated[float, Gt(0), Le(_LONGEST_S)] = 60.0

    def __post_init__(self) -> None:
        check_fields(self)


def session_scene(settings: Settings) -> Scene:
    """Return the scene that the leader runs.

    Raises
    ------
    InputError
        The scene cannot be read, or moves no robot.
    """
    scene = load_scene(settings.scene, {"session.duration_s": _LONGEST_S})
    if scene.link is None or not scene.commands:
        raise InputError(
            f"scene {settings.scene}: LeRobot's actions are the commands to a robot, and this "
            "scene moves none: take one with [link], [simulated] or [devices], and [hand] or "
            "[handle]"
        )
    tables, origin = scene.dump(), f"scene {settings.scene}"
    if settings.follower:
        tables["link"]["port"] = 0
    if settings.moved_by == "hand":
        return scene_from_tables(tables, origin=origin)
    recovery_mm_s = scene.link.recovery_mm_s
    options: dict[str, Any] = {"recovery_mm_s": recovery_mm_s, "normal": scene.normal}
    box_mm = scene.motion_limits.box_mm if scene.motion_limits is not None else None
    if box_mm is not None:
        options["box_mm"] = [list(corner) for corner in box_mm]
    tables.pop("hand", None)
    tables["handle"] = {"driver": _ACTION_HANDLE, "on_lost": "stop", **options}
    return scene_from_tables(tables, origin=origin)
