"""The tables of what is shown while a run lasts: for Prometheus, on a page, by LSL, by ROS 2."""

from typing import ClassVar, Literal

from pydantic import Field

from mmt.scene.table import PartTable, Service


class Metrics(PartTable):
    """``[metrics]``: figures for Prometheus, at the leader's port and one of the follower's."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    follower_port: int | None = Field(None, ge=1, le=65_535)


class Monitor(PartTable):
    """``[monitor]``: the leader serves a page that shows the run while it lasts."""

    updates_hz: float = Field(25.0, ge=1, le=60)


class Lsl(PartTable):
    """``[lsl]``: the leader passes frames and events on to the Lab Streaming Layer."""

    name: str = Field("mmt", min_length=1, max_length=64, pattern=r"^[\w.-]+$")
    channels: Literal["all", "needed"] = "all"
    chunk_ms: int = Field(20, ge=1, le=1000)


class Ros(PartTable):
    """``[ros]``: the leader publishes frames, events and the model on topics of ROS 2."""

    namespace: str = Field("mmt", max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    channels: Literal["all", "needed"] = "all"
    chunk_ms: int = Field(5, ge=1, le=1000)
