"""The scene of a recorded session, including sessions recorded by earlier versions."""

from collections.abc import Mapping
from typing import Any

from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.scene.leader_tables import without_former
from mmt.scene.texture_table import by_method


def scene_of_recording(tables: Mapping[str, Any], origin: str) -> Scene:
    """Return the scene that a session was recorded with.

    Raises
    ------
    InputError
        The recorded scene is not valid; `origin` names it in the message.
    """
    if isinstance(tables.get("texture"), Mapping):
        tables = {**tables, "texture": by_method(tables["texture"])}
    if isinstance(tables.get("rendering"), Mapping):
        tables = {**tables, "rendering": without_former(tables["rendering"])}
    return scene_from_tables(tables, origin=origin)
