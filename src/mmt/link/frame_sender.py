"""The follower's frames: batched, sent, and buffered so that they can be sent again."""

import asyncio
import struct
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.sequence_numbers import Range, RangeSet, ranges_of
from mmt.link.protocol import (
    BACKFILL,
    FRAMES,
    GONE,
    MAX_RANGES,
    FollowerHello,
    encode_event,
    ranges_of_payload,
)
from mmt.link.queue import SendQueue

_SEQUENCE: Final = struct.Struct("<I")


class FrameBuffer:
    """A ring buffer of the newest frames as bytes; about 0.3 us a frame.

    Parameters
    ----------
    dtype
        Dtype of the frames; their numbers ascend, and may wrap.
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

        Takes some microseconds a range, and the time of the copy.
        """
        asked = [(first, stop - 1) for first, stop in RangeSet(ranges)]
        firsts, lasts = np.array(asked, dtype=np.uint32).reshape(-1, 2).T
        place = self._next // self._size
        runs = [*_ascending(self._frames[place : len(self)]), *_ascending(self._frames[:place])]
        chosen = bytearray()
        for run in sorted(runs, key=lambda run: int(run["sequence"][0])):
            begins = run["sequence"].searchsorted(firsts)
            stops = run["sequence"].searchsorted(lasts, side="right")
            for begin, stop in zip(begins, stops, strict=True):
                chosen += run[begin:stop].tobytes()
        return np.frombuffer(chosen, dtype=self._frames.dtype)


def _ascending(frames: RecordArray) -> list[RecordArray]:
    """Return consecutive frames (n,) as one run of ascending numbers, or two if they wrap."""
    numbers = frames["sequence"]
    wrap = bisect_left(numbers, True, key=lambda number: bool(number < numbers[0]))
    return [run for run in (frames[:wrap], frames[wrap:]) if len(run)]


PERIOD_S: Final = 0.005
"""Least time between two messages: with `FRAMES_PER_MESSAGE`, 4000 frames a second at most."""

FRAMES_PER_MESSAGE: Final = 20
"""Frames in a message of 1 to 3 KB; a live frame may have to wait until the message is sent."""

_FINISH_PERIOD_S: Final = 0.001
"""The same at the end of a session, when no live frame can be delayed."""


class BackfillSender:
    """Answer requests for missing frames from the buffer.

    Requested frames are copied at once, so that they are not overwritten while they wait; no more
    than are buffered. They are sent a few at a time, and only when no live frame is queued.

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
                    frames = self._take()
                    self._outbox.put(0, encode_event(BACKFILL, frames.tobytes()))
                    self.sent += len(frames)
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
        while self._scheduled.count > len(self.buffer):
            for first, stop in ranges_of(self._take()["sequence"]):
                self._asked.add(first, stop)
        self.gone += self._asked.count
        gone = list(self._asked)
        for start in range(0, len(gone), MAX_RANGES):
            self._outbox.put(0, encode_event(GONE, gone[start : start + MAX_RANGES]))
        self._asked.clear()

    def _take(self) -> RecordArray:
        frames = self._waiting.popleft()
        for first, stop in ranges_of(frames["sequence"]):
            self._scheduled.remove(first, stop)
        return frames


class FrameSender:
    """Send frames in messages of the hello's ``frames_per_message``.

    Parameters
    ----------
    hello
        Gives the frames' dtype, ``frames_per_message`` and ``keep_frames``.
    outbox
        The follower's queue of messages.
    """

    def __init__(self, hello: FollowerHello, outbox: SendQueue) -> None:
        self._outbox = outbox
        self._dtype = hello.frame_dtype
        self._full_bytes = hello.frames_per_message * self._dtype.itemsize
        self._batch = bytearray()
        self._last_frame = b""
        self.backfiller: BackfillSender | None = None
        """Buffers frames and sends them again; None if the hello keeps none."""
        if hello.keep_frames:
            buffer = FrameBuffer(self._dtype, hello.keep_frames)
            self.backfiller = BackfillSender(buffer, outbox)

    @property
    def sent(self) -> int:
        """Sequence number after that of the newest frame sent, 0 before the first."""
        return _SEQUENCE.unpack_from(self._last_frame)[0] + 1 if self._last_frame else 0

    @property
    def backfill(self) -> dict[str, int]:
        """Counts of buffered, requested, resent and missing frames; empty without a buffer."""
        kept = self.backfiller
        if kept is None:
            return {}
        return {"kept": len(kept.buffer), "asked": kept.asked, "sent": kept.sent, "gone": kept.gone}

    def put(self, frames: RecordArray) -> None:
        """Batch and buffer frames (n,), and send a message as soon as it is full.

        Raises
        ------
        ValueError
            The frames are of another dtype than the hello's.
        """
        if frames.dtype != self._dtype:
            message = f"frames are of dtype {frames.dtype}: the hello's are of {self._dtype}"
            raise ValueError(message)
        data = frames.tobytes()
        if self.backfiller is not None:
            self.backfiller.buffer.put(data)
        self._batch += data
        if len(self._batch) >= self._full_bytes:
            self.flush()

    def flush(self) -> None:
        """Send the batch as it is."""
        gathered, size = bytes(self._batch), self._dtype.itemsize
        self._batch.clear()
        if gathered:
            self._outbox.put_records(FRAMES, gathered, size)
            self._last_frame = gathered[-size:]
