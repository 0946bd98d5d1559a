"""Tables and parts of the bridges that the leader passes its frames to."""

from typing import Final

from pydantic import Field

from mmt.scene.table import AddedPart, PassingTable


class Lsl(PassingTable):
    """``[lsl]``: the leader passes frames and events on to the Lab Streaming Layer."""

    name: str = Field("mmt", min_length=1, max_length=64, pattern=r"^[\w.-]+$")
    chunk_ms: int = Field(20, ge=1, le=1000)


class Ros(PassingTable):
    """``[ros]``: the leader publishes frames, events and the model on topics of ROS 2."""

    namespace: str = Field("mmt", max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    chunk_ms: int = Field(5, ge=1, le=1000)


LSL: Final = AddedPart("mmt_bridges.lsl.part:LslPart", before="metrics", table=Lsl)
ROS: Final = AddedPart("mmt_bridges.ros.part:RosPart", before="metrics", table=Ros)
