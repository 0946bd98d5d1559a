"""The follower's frames: batched, sent, and buffered so that they can be sent again."""

import struct
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.link.backfill import BackfillSender, FrameBuffer
from mmt.link.protocol import FRAMES, FollowerHello
from mmt.link.queue import SendQueue

_SEQUENCE: Final = struct.Struct("<I")


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
