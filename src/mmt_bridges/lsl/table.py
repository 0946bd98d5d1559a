"""The scene's table and the leader's part for the Lab Streaming Layer."""

from typing import Final

from pydantic import Field

from mmt.scene.added import AddedPart, PassingTable


class Lsl(PassingTable):
    """``[lsl]``: the leader passes frames and events on to the Lab Streaming Layer."""

    name: str = Field("mmt", min_length=1, max_length=64, pattern=r"^[\w.-]+$")
    chunk_ms: int = Field(20, ge=1, le=1000)


PART: Final = AddedPart("mmt_bridges.lsl.part:LslPart", before="metrics", table=Lsl)
