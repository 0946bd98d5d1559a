"""The table and the part of ROS 2, as the leader finds them."""

from typing import ClassVar, Final, Literal

from pydantic import Field

from mmt.scene.added import AddedPart, AddedTable


class Ros(AddedTable):
    """``[ros]``: the leader publishes frames, events and the model on topics of ROS 2."""

    needs_follower: ClassVar[bool] = True

    namespace: str = Field("mmt", max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    channels: Literal["all", "needed"] = "all"
    chunk_ms: int = Field(5, ge=1, le=1000)

    @property
    def kept_channels(self) -> Literal["all", "needed"]:
        """The channels that are passed on."""
        return self.channels


PART: Final = AddedPart("mmt_bridges.ros.part:RosPart", before="metrics", table=Ros)
