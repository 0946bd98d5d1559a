"""The part that passes frames and events on to the Lab Streaming Layer (LSL), by pylsl."""

import asyncio
from typing import Final

from mmt.core.extras import require
from mmt.leader.building import LeaderParts
from mmt.leader.part import Session
from mmt.leader.publishing import PublishingPart
from mmt_bridges.lsl.streams import Streams
from mmt_bridges.tables import Lsl

_LINGER_S: Final = 0.5
"""Time that recipients have to fetch the last samples, which liblsl drops with the outlet."""


class LslPart(PublishingPart[Streams]):
    """Pass frames and events on; stamps are by LSL's clock.

    Parameters
    ----------
    session
        Session of the run.
    table
        The scene's ``[lsl]``.
    """

    table = "lsl"
    compared = ("LSL's clock compared", "lsl_clock_ahead_ns")

    def __init__(self, session: Session, table: Lsl) -> None:
        super().__init__(session, table.chunk_ms)
        self._stream_name = table.name

    @classmethod
    def build(cls, session: Session, parts: LeaderParts) -> "LslPart | None":
        """Return the part, or None if the scene has no ``[lsl]``.

        Raises
        ------
        InputError
            pylsl is not installed.
        """
        _ = parts
        table = session.scene.table(Lsl)
        if table is None:
            return None
        require("pylsl")
        return cls(session, table)

    def connect(self) -> None:
        """Make the outlets.

        Raises
        ------
        InputError
            liblsl is not installed.
        """
        scene = self._session.scene
        self._outlet = Streams(
            self._stream_name,
            scene.channels(),
            self._session.rate_hz,
            self._session.samples_per_frame,
            self._session.log.session_id,
        )

    def clock_s(self) -> float:
        """Return the time by LSL's clock on this machine."""
        assert self._outlet is not None  # noqa: S101 - it was connected
        return self._outlet.clock_s()

    async def stop(self) -> None:
        """Pass on what is queued, and give recipients time to fetch it."""
        await super().stop()
        if self._outlet is not None and self.error is None and self._outlet.has_recipients:
            await asyncio.sleep(_LINGER_S)
