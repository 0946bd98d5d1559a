"""The leader's one place for a follower, and who has it."""

import asyncio
from contextlib import suppress

from mmt.core.errors import MmtError
from mmt.link.log import LOG
from mmt.link.protocol import FollowerHello


class FollowerPlace:
    """Who is served, and whether the session with them goes on."""

    def __init__(self) -> None:
        self.sid: str | None = None
        """Of the Socket.IO connection of the follower, None where nobody is served."""
        self.hello: FollowerHello | None = None
        """What the follower says of itself."""
        self.fault = ""
        """Why the follower is being cut off, empty where it is not."""
        self._ended = False
        self._free = asyncio.Event()

    @property
    def in_session(self) -> bool:
        """Whether a follower is there that has not ended the session."""
        return self.sid is not None and not self._ended

    def expects(self, sid: str) -> bool:
        """Whether this is the follower, and still in its session."""
        return self.sid == sid and not self._ended

    def take(self, sid: str, hello: FollowerHello) -> None:
        """Give the place to a follower."""
        self.sid, self.hello = sid, hello
        self.fault = ""
        self._ended = False
        self._free.clear()

    def end(self) -> None:
        """Take note that the follower has ended the session; its place is not free yet."""
        self._ended = True

    def cut_off(self, fault: MmtError) -> None:
        """Take note that the follower's connection is closed since it sends too much."""
        self.fault = str(fault)
        LOG.warning("the follower is cut off: %s", fault)

    def leave(self) -> None:
        """Free the place."""
        self.sid = self.hello = None
        self._free.set()

    async def until_free(self, timeout_s: float) -> bool:
        """Wait until the place is free, for at most this long; return whether it is."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._free.wait(), timeout_s)
        return self._free.is_set()
