"""The tables that name recorded sessions: one to replay, one to write."""

from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import Field

from mmt.scene.table import PartTable, Service

LARGEST_SPEED: Final = 100.0
"""Largest speed of a replay, relative to real time."""


class Replay(PartTable):
    """``[replay]``: the follower sends a recorded session with its true timing."""

    runs_in: ClassVar[tuple[Service, ...]] = ("follower",)

    file: Path | None = None
    speed: float = Field(1.0, gt=0, le=LARGEST_SPEED)
    loop: bool = False
    gaps: Literal["keep", "skip"] = "keep"


class Recording(PartTable):
    """``[recording]``: every frame received goes into an MCAP file."""

    file: Path = Path("mmt-demo/session.mcap")
    channels: Literal["all", "needed"] = "all"
    existing: Literal["number", "refuse", "replace"] = "number"
    scalars: bool = False
