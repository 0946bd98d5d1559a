"""Scenes: what one run needs, read from TOML and checked."""

from mmt.scene.device_tables import Actuator, Devices, Driver, Handle
from mmt.scene.feedback_table import ForceFeedback
from mmt.scene.hand_table import Hand
from mmt.scene.link_table import Link
from mmt.scene.network_table import Network
from mmt.scene.texture_table import Selection, Surfaces, Texture
from mmt.scene.scene import LARGEST_SPEED, Course, Metrics, Monitor, Playout, Recording, Rendering, Replay, Scene, Session, Simulated

__all__ = ['Actuator', 'Course', 'Devices', 'Driver', 'ForceFeedback', 'Hand', 'Handle', 'LARGEST_SPEED', 'Link', 'Metrics', 'Monitor', 'Network', 'Playout', 'Recording', 'Rendering', 'Replay', 'Scene', 'Selection', 'Session', 'Simulated', 'Surfaces', 'Texture']
