"""The tables of ``mmt hub``, read from its file, the environment and the command line."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from mmt.scene.files import Overrides, read_tables, resolve_input_files, validated
from mmt.scene.table import Table
from mmt_share.tables import Listening, Sharing


class HubTable(Table):
    """``[hub]``: hubs that share one leader's model find each other at a Redis server."""

    redis: str = Field(
        "redis://127.0.0.1:6379", pattern=r"^(rediss?|unix)://", max_length=1024, repr=False
    )
    group: str | None = Field(None, min_length=1, max_length=256)
    address: str | None = Field(None, pattern=r"^https?://", max_length=256)
    states_hz: float = Field(20.0, gt=0, le=20)


class HubScene(Table):
    """The tables of ``mmt hub``: its Redis server, its listeners, and the leader."""

    hub: HubTable = HubTable()
    sharing: Sharing = Sharing()
    listening: Listening = Listening()


def load_hub_scene(
    path: Path | None, overrides: Mapping[str, Any], options: Mapping[str, str] | None = None
) -> HubScene:
    """Read and validate the tables of a hub; the environment overrides the file, `overrides` both.

    Parameters
    ----------
    path
        A TOML file, or None for the defaults.
    overrides, options
        See `mmt.scene.files.load_scene`.

    Raises
    ------
    InputError
        The file is missing or not TOML, or a key or a value is not allowed.
    """
    tables: dict[str, Any] = {}
    if path is not None:
        tables = read_tables(path)
        resolve_input_files(path, tables)
    given = Overrides.collect(overrides, options, lambda table: table in HubScene.model_fields)
    return validated(HubScene, str(path or "mmt hub"), tables, given)
