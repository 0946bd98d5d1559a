"""Scenes: settings of one run, read from TOML and validated.

`Scene` is imported on first access: its class has the tables of added parts, and the modules of
those parts import the base classes of tables from this package.
"""

from typing import TYPE_CHECKING, Any

from mmt.scene.device_tables import (
    LARGEST_SPEED,
    Actuator,
    Course,
    Devices,
    Driver,
    Hand,
    Handle,
    MotionLimits,
    Replay,
    Simulated,
)
from mmt.scene.leader_tables import (
    ForceFeedback,
    Metrics,
    Monitor,
    Playout,
    Recording,
    Rendering,
    Texture,
)
from mmt.scene.link_tables import PROFILES, Link, Network
from mmt.scene.table import OptionalTable, PartTable, Service, Table

if TYPE_CHECKING:
    from mmt.scene.scene import PART_TABLES, Scene, SessionTable

__all__ = [
    "LARGEST_SPEED", "PART_TABLES", "PROFILES", "Actuator", "Course", "Devices", "Driver",
    "ForceFeedback", "Hand", "Handle", "Link", "Metrics", "Monitor", "MotionLimits", "Network",
    "OptionalTable", "PartTable", "Playout", "Recording", "Rendering", "Replay", "Scene", "Service",
    "SessionTable", "Simulated", "Table", "Texture",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in {"PART_TABLES", "Scene", "SessionTable"}:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)
    from mmt.scene import scene

    globals()[name] = value = getattr(scene, name)
    return value
