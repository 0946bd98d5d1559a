"""The follower's frames: batched, sent, and buffered so that they can be sent again."""

import struct
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.core.frames import frame_dtype
from mmt.link.backfill import BackfillSender, FrameBuffer
from mmt.link.endpoint import Endpoint
from mmt.link.protocol import FRAMES, SETTLE_S, FollowerHello

_SEQUENCE: Final = struct.Struct("<I")


class FrameSender:
    """Send frames in messages of the hello's ``frames_per_message``.

    Parameters
    ----------
    hello
        Says what a frame holds, how many go into a message and how many are kept.
    traffic
        Of the follower's side.
    """

    def __init__(self, hello: FollowerHello, traffic: Endpoint) -> None:
        self._traffic = traffic
        self._dtype = frame_dtype(hello.channels)
        self._full_bytes = hello.frames_per_message * self._dtype.itemsize
        self._gathered = bytearray()
        self._last_frame = b""
        keeps = hello.keep_frames
        self._kept = FrameBuffer(self._dtype, keeps) if keeps else None
        self._backfiller: BackfillSender | None = None
        if self._kept is not None:
            self._backfiller = BackfillSender(self._kept, traffic.outbox)

    @property
    def sent(self) -> int:
        """One more than the number of the newest frame that was sent, 0 before the first."""
        return _SEQUENCE.unpack_from(self._last_frame)[0] + 1 if self._last_frame else 0

    @property
    def backfill(self) -> dict[str, int]:
        """Frames that are kept, were asked for, sent again, or not there; empty where none are."""
        if self._backfiller is None or self._kept is None:
            return {}
        asked, sent, gone = self._backfiller.asked, self._backfiller.sent, self._backfiller.gone
        return {"kept": len(self._kept), "asked": asked, "sent": sent, "gone": gone}

    def put(self, frames: RecordArray) -> None:
        """Gather and keep frames (n,), and send them as soon as there are enough.

        Raises
        ------
        ValueError
            They are of another dtype than the hello's channels have.
        """
        if frames.dtype != self._dtype:
            message = f"frames are of dtype {frames.dtype}: the hello's channels have {self._dtype}"
            raise ValueError(message)
        data = frames.tobytes()
        if self._kept is not None:
            self._kept.put(data)
        self._gathered += data
        if len(self._gathered) >= self._full_bytes:
            self.flush()

    def flush(self) -> None:
        """Send what is gathered."""
        gathered, size = bytes(self._gathered), self._dtype.itemsize
        self._gathered.clear()
        if gathered:
            self._traffic.send(FRAMES, gathered, size)
            self._last_frame = gathered[-size:]

    # --- frames that did not arrive

    def open(self) -> None:
        """Answer what the leader asks over a connection that is new."""
        if self._backfiller is not None:
            self._backfiller.open()

    def close(self) -> None:
        """Answer no more, until there is another connection."""
        if self._backfiller is not None:
            self._backfiller.close()

    @property
    def keeps(self) -> bool:
        """Whether frames can be sent again."""
        return self._backfiller is not None

    def want(self, payload: object) -> None:
        """Take a request for frames, as anybody may have sent it."""
        if self._backfiller is not None:
            self._backfiller.want(payload)

    async def settle(self, payload: object) -> None:
        """Send what the leader lacks at the end, at once and in bounded time."""
        if self._backfiller is not None:
            self._backfiller.want(payload)
            await self._backfiller.finish(SETTLE_S)
