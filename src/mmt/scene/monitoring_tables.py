"""The tables of what is shown while a run lasts: for Prometheus, and on a page."""

from typing import ClassVar

from pydantic import Field

from mmt.scene.table import PartTable, Service


class Metrics(PartTable):
    """``[metrics]``: figures for Prometheus, at the leader's port and one of the follower's."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    follower_port: int | None = Field(None, ge=1, le=65_535)


class Monitor(PartTable):
    """``[monitor]``: the leader serves a page that shows the run while it lasts."""

    updates_hz: float = Field(25.0, ge=1, le=60)
