"""The tables of a model that is shared: of its leader, of listeners, and of the hubs between."""

from pathlib import Path

from pydantic import Field

from mmt.scene.secured_table import SecuredTable, ServedTable
from mmt.scene.table import PartTable, Table


class Sharing(ServedTable):
    """``[sharing]``: the leader lets others feel the model that it builds."""

    port: int = Field(8766, ge=0, le=65_535)
    most: int = Field(200, ge=1, le=10_000)
    store: Path | None = None
    accept: bool = False


class Control(PartTable):
    """``[control]``: a listener that shows a token may be given control of the robot."""

    token_file: Path | None = None
    silence_ms: float = Field(200.0, ge=50, le=5000)


class Operating(PartTable):
    """``[operating]``: this listener asks for control of the leader's robot."""

    token_file: Path | None = None


class Listening(SecuredTable):
    """``[listening]``: render the model that another machine's leader shares."""

    url: str = "http://127.0.0.1:8766"
    name: str | None = Field(None, max_length=64)
    patience_s: float = Field(10.0, ge=0.5, le=3600)


class Hub(Table):
    """``[hub]``: hubs that share one leader's model find each other at a Redis server."""

    redis: str = Field(
        "redis://127.0.0.1:6379", pattern=r"^(rediss?|unix)://", max_length=1024, repr=False
    )
    group: str | None = Field(None, min_length=1, max_length=256)
    address: str | None = Field(None, pattern=r"^https?://", max_length=256)
    states_hz: float = Field(20.0, gt=0, le=20)


class HubScene(Table):
    """The tables of ``mmt hub``: its Redis server, its listeners, and the leader."""

    hub: Hub = Hub()
    sharing: Sharing = Sharing()
    listening: Listening = Listening()
