"""The tables of metrics for Prometheus and of the monitor page."""

from typing import ClassVar

from pydantic import Field

from mmt.scene.table import PartTable, Service


class Metrics(PartTable):
    """``[metrics]``: serve metrics for Prometheus at the leader's and the follower's ports."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    follower_port: int | None = Field(None, ge=1, le=65_535)


class Monitor(PartTable):
    """``[monitor]``: the leader serves a live page of the run."""

    updates_hz: float = Field(25.0, ge=1, le=60)
