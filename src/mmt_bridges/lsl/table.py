"""The table and the part of the Lab Streaming Layer, as the leader finds them."""

from typing import ClassVar, Final, Literal

from pydantic import Field

from mmt.scene.added import AddedPart, AddedTable


class Lsl(AddedTable):
    """``[lsl]``: the leader passes frames and events on to the Lab Streaming Layer."""

    needs_follower: ClassVar[bool] = True

    name: str = Field("mmt", min_length=1, max_length=64, pattern=r"^[\w.-]+$")
    channels: Literal["all", "needed"] = "all"
    chunk_ms: int = Field(20, ge=1, le=1000)

    @property
    def kept_channels(self) -> Literal["all", "needed"]:
        """The channels that are passed on."""
        return self.channels


PART: Final = AddedPart("mmt_bridges.lsl.part:LslPart", before="metrics", table=Lsl)
