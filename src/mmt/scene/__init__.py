"""Scenes: what one run needs, read from TOML and checked."""

from mmt.scene.device_tables import Actuator, Devices, Driver, Handle
from mmt.scene.feedback_table import ForceFeedback
from mmt.scene.hand_table import Hand
from mmt.scene.link_table import Link
from mmt.scene.network_table import Network
from mmt.scene.scene import (
    LARGEST_SPEED,
    Course,
    Metrics,
    Monitor,
    Playout,
    Recording,
    Rendering,
    Replay,
    Scene,
    Session,
    Simulated,
)
from mmt.scene.texture_table import Selection, Surfaces, Texture

__all__ = [
    "LARGEST_SPEED",
    "Actuator",
    "Course",
    "Devices",
    "Driver",
    "ForceFeedback",
    "Hand",
    "Handle",
    "Link",
    "Metrics",
    "Monitor",
    "Network",
    "Playout",
    "Recording",
    "Rendering",
    "Replay",
    "Scene",
    "Selection",
    "Session",
    "Simulated",
    "Surfaces",
    "Texture",
]
