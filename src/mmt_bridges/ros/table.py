"""The scene's table and the leader's part for ROS 2."""

from typing import Final

from pydantic import Field

from mmt.scene.added import AddedPart, PassingTable


class Ros(PassingTable):
    """``[ros]``: the leader publishes frames, events and the model on topics of ROS 2."""

    namespace: str = Field("mmt", max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    chunk_ms: int = Field(5, ge=1, le=1000)


PART: Final = AddedPart("mmt_bridges.ros.part:RosPart", before="metrics", table=Ros)
