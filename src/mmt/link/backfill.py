"""Back-fill: frames that did not arrive are requested by the leader and sent again.

`FrameBuffer` and `BackfillSender` are the follower's side, `BackfillReceiver` is the leader's.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np
import socketio

from mmt.core.arrays import RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, SEQUENCES, channels_of
from mmt.core.sequence_numbers import Range, RangeSet, ranges_of
from mmt.link.endpoint import LeaderEvents, call
from mmt.link.protocol import (
    BACKFILL,
    GONE,
    MAX_RANGES,
    MAX_RECORDS_PER_MESSAGE,
    MISSING,
    SETTLE,
    argument_of,
    encode_event,
    ranges_of_payload,
)
from mmt.link.queue import SendQueue
from mmt.link.reader import LARGEST_QUANTITY, LATEST_NS, BlockReader


class FrameBuffer:
    """A ring buffer of the newest frames as bytes; about 0.3 us a frame.

    Parameters
    ----------
    dtype
        Dtype of the frames.
    capacity
        Frames in the buffer, at least 1; older ones are overwritten.
    """

    def __init__(self, dtype: np.dtype[np.void], capacity: int) -> None:
        self._size = dtype.itemsize
        self._bytes = bytearray(capacity * self._size)
        self._frames: RecordArray = np.frombuffer(self._bytes, dtype=dtype)
        self._next = 0
        self._full = False

    def __len__(self) -> int:
        """Return the number of frames in the buffer."""
        return len(self._frames) if self._full else self._next // self._size

    def put(self, data: bytes) -> None:
        """Store whole frames, newest last, in place of the oldest."""
        data = data[-len(self._bytes) :]
        stop = self._next + len(data)
        over = stop - len(self._bytes)
        if over < 0:
            self._bytes[self._next : stop] = data
            self._next = stop
            return
        self._bytes[self._next :] = data[: len(data) - over]
        self._bytes[:over] = data[len(data) - over :]
        self._next = over
        self._full = True

    def select(self, ranges: Iterable[Range]) -> RecordArray:
        """Return a copy of the frames (n,) whose numbers lie in the ranges, ascending, each once.

        Takes a fraction of a millisecond for 10,000 frames.
        """
        kept = self._frames[: len(self)]
        numbers = kept["sequence"].astype(np.int64)
        order = np.argsort(numbers, kind="stable")
        numbers = numbers[order]
        chosen = [
            order[numbers.searchsorted(first) : numbers.searchsorted(stop)]
            for first, stop in ranges
        ]
        if not chosen:
            return kept[:0].copy()
        frames = kept[np.concatenate(chosen)]
        _, firsts = np.unique(frames["sequence"], return_index=True)
        return frames[firsts]


PERIOD_S: Final = 0.005
"""Least time between two messages: with `FRAMES_PER_MESSAGE`, 4000 frames a second at most."""

FRAMES_PER_MESSAGE: Final = 20
"""Frames in a message of 1 to 3 KB; a live frame may have to wait until the message is sent."""

_FINISH_PERIOD_S: Final = 0.001
"""The same at the end of a session, when no live frame can be delayed."""


class BackfillSender:
    """The follower's side: answer requests for missing frames from the buffer.

    Requested frames are copied at once, so that they are not overwritten while they wait. They are
    sent a few at a time, and only when no live frame is queued.

    Parameters
    ----------
    kept
        Buffer of the newest frames.
    outbox
        Send queue of the live frames.
    """

    def __init__(self, kept: FrameBuffer, outbox: SendQueue) -> None:
        self.buffer = kept
        self._outbox = outbox
        self._asked = RangeSet()
        self._scheduled = RangeSet()
        self._waiting: deque[RecordArray] = deque()
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._finishing_fast = False
        self.asked = self.sent = self.gone = self.rejected = 0

    def open(self) -> None:
        """Start to answer on a new connection."""
        self.close()
        self._task = asyncio.get_running_loop().create_task(self._run())

    def close(self) -> None:
        """Stop answering; the leader requests again on its next connection."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._asked.clear()
        self._scheduled.clear()
        self._waiting.clear()

    def request(self, payload: object) -> None:
        """Handle a request; its payload is not trusted."""
        ranges = ranges_of_payload(payload)
        if ranges is None or len(self._asked) > MAX_RANGES:
            self.rejected += 1
            return
        for first, stop in ranges:
            self.asked += self._asked.add(first, stop)
        self._wake.set()

    async def finish(self, timeout_s: float) -> None:
        """Send all requested frames with hardly a pause between messages, within `timeout_s`."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        self._finishing_fast = True
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
                    self._collect()
                if self._waiting and self._outbox.idle:
                    self._send_some(self._waiting)
                await asyncio.sleep(_FINISH_PERIOD_S if self._finishing_fast else PERIOD_S)

    def _collect(self) -> None:
        """Copy the requested frames that are buffered; report the others as gone."""
        for first, stop in self._scheduled:
            self._asked.remove(first, stop)
        found = self.buffer.select(self._asked)
        for first, stop in ranges_of(found["sequence"]):
            self._asked.remove(first, stop)
            self._scheduled.add(first, stop)
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
        self._scheduled.remove(int(frames["sequence"][0]), int(frames["sequence"][-1]) + 1)
        self._outbox.put(0, encode_event(BACKFILL, frames.tobytes()))
        self.sent += len(frames)


class BackfillReceiver:
    """The leader's side: request frames, validate those that come, and hand them on.

    Parameters
    ----------
    server
        Socket.IO server at which the events are registered.
    dtype
        Dtype of the frames.
    events
        Callbacks of the service.
    expects
        Returns whether events of this Socket.IO session are accepted.
    reader
        Reader of the live frames: it knows which sequence numbers are plausible, and counts
        rejected messages.
    """

    def __init__(
        self,
        server: socketio.AsyncServer,
        dtype: np.dtype[np.void],
        events: LeaderEvents,
        expects: Callable[[str], bool],
        reader: BlockReader,
    ) -> None:
        self._dtype = dtype
        self._events = events
        self._expects = expects
        self._reader = reader
        self._reject = reader.reject
        self.settling = False
        """Whether a follower that is ending was sent a list of missing frames."""
        server.on(BACKFILL, self._on_backfill)
        server.on(GONE, self._on_gone)
        server.on(SETTLE, self._on_settle)

    def request(self, outbox: SendQueue, ranges: Iterable[Range]) -> None:
        """Request frames from the follower; ranges that exceed one message are left out."""
        outbox.put(0, encode_event(MISSING, list(ranges)[:MAX_RANGES]))

    def _on_backfill(self, sid: str, *arguments: object) -> None:
        if not self._expects(sid):
            return
        data = argument_of(arguments)
        if not isinstance(data, bytes):
            self._reject("malformed back-fill")
            return
        count, rest = divmod(len(data), self._dtype.itemsize)
        if rest or not 0 < count <= MAX_RECORDS_PER_MESSAGE:
            self._reject("malformed back-fill")
            return
        frames = np.frombuffer(data, dtype=self._dtype)
        good = (frames["time_ns"] >= 0) & (frames["time_ns"] < LATEST_NS)
        for channel in channels_of(self._dtype):
            values = frames[FIELD_OF_CHANNEL[channel]].reshape(count, -1)
            good &= (np.abs(values) <= LARGEST_QUANTITY).all(axis=1)  # false if not finite
        if not good.all():
            self._reject("unusable back-fill")
            bad = np.unique(frames["sequence"][~good]).astype(np.int64)
            call(self._events.on_gone, ranges_of(bad), on_error=self._events.on_error)
        if good.any():
            call(self._events.on_backfill, frames[good], on_error=self._events.on_error)

    def _on_gone(self, sid: str, *arguments: object) -> None:
        if not self._expects(sid):
            return
        ranges = ranges_of_payload(argument_of(arguments))
        if ranges is None:
            self._reject("malformed gone")
            return
        call(self._events.on_gone, ranges, on_error=self._events.on_error)

    def _on_settle(self, sid: str, *arguments: object) -> dict[str, Any]:
        payload = argument_of(arguments)
        sent = payload.get("frames") if isinstance(payload, Mapping) else None
        missing: list[Range] = []
        if not self._expects(sid):
            return {"missing": missing}
        if not isinstance(sent, int) or not 0 <= sent <= SEQUENCES:
            self._reject("malformed settle")
            return {"missing": missing}
        if not self._reader.is_plausible(sent, time.monotonic_ns()):
            return {"missing": missing}  # the end event, with the same count, is rejected
        try:
            missing = self._events.on_settle(sent)[:MAX_RANGES]
        except Exception as error:  # noqa: BLE001 - handed to the service
            self._events.on_error(error)
        self.settling |= bool(missing)
        return {"missing": missing}
