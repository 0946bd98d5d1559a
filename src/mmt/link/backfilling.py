"""The follower sends again what did not arrive, when nothing else wants to be sent."""

import asyncio
from collections import deque
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.core.ranges import RangeSet, ranges_of
from mmt.link.keeping import KeptFrames
from mmt.link.outbox import Outbox
from mmt.link.protocol import BACKFILL, GONE, MAX_RANGES, encode_event, ranges_of_payload

PERIOD_S: Final = 0.005
"""Least time between two messages: with `FRAMES_PER_MESSAGE`, 4000 frames a second at most."""

FRAMES_PER_MESSAGE: Final = 20
"""A message of 1 KB, which a live frame may have to wait for."""


_HURRIED_S: Final = 0.001
"""At the end of a session no live frame can be delayed."""


class Backfiller:
    """Answer the leader's requests for missing frames from those that are kept.

    What is asked for is copied at once, so that it is not overwritten while it waits. It goes
    out a few frames at a time, and only when no live frame waits.

    Parameters
    ----------
    kept
        The frames that there are.
    outbox
        Of the live frames.
    """

    def __init__(self, kept: KeptFrames, outbox: Outbox) -> None:
        self._kept = kept
        self._outbox = outbox
        self._asked = RangeSet()
        self._promised = RangeSet()
        self._waiting: deque[RecordArray] = deque()
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._hurry = False
        self.asked = self.sent = self.gone = self.rejected = 0

    def open(self) -> None:
        """Begin to answer over a connection that is new."""
        self.close()
        self._task = asyncio.get_running_loop().create_task(self._run())

    def close(self) -> None:
        """Answer no more; the leader asks again over its next connection."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._asked.clear()
        self._promised.clear()
        self._waiting.clear()

    def want(self, payload: object) -> None:
        """Take a request, as anybody may have sent it."""
        ranges = ranges_of_payload(payload)
        if ranges is None or len(self._asked) > MAX_RANGES:
            self.rejected += 1
            return
        for first, stop in ranges:
            self.asked += self._asked.add(first, stop)
        self._wake.set()

    async def finish(self, timeout_s: float) -> None:
        """Send what was asked for without a pause between messages, for at most this long."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        self._hurry = True
        while (self._asked or self._waiting) and loop.time() < deadline_s:
            if self._task is None or self._task.done():
                return
            await asyncio.sleep(0.001)

    async def _run(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._asked or self._waiting:
                if self._asked:
                    self._look_up()
                if self._waiting and self._outbox.idle:
                    self._send_some(self._waiting)
                await asyncio.sleep(_HURRIED_S if self._hurry else PERIOD_S)

    def _look_up(self) -> None:
        """Copy what is asked for and kept, and say what is not."""
        for first, stop in self._promised:
            self._asked.remove(first, stop)
        found = self._kept.select(self._asked)
        for first, stop in ranges_of(found["sequence"]):
            self._asked.remove(first, stop)
            self._promised.add(first, stop)
        self._waiting.extend(
            found[start : start + FRAMES_PER_MESSAGE]
            for start in range(0, len(found), FRAMES_PER_MESSAGE)
        )
        self.gone += self._asked.count
        gone = list(self._asked)
        for start in range(0, len(gone), MAX_RANGES):
            self._outbox.put(0, encode_event(GONE, gone[start : start + MAX_RANGES]))
        self._asked.clear()

    def _send_some(self, waiting: deque[RecordArray]) -> None:
        frames = waiting.popleft()
        self._promised.remove(int(frames["sequence"][0]), int(frames["sequence"][-1]) + 1)
        self._outbox.put(0, encode_event(BACKFILL, frames.tobytes()))
        self.sent += len(frames)
