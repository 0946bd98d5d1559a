"""Back-fill: frames that did not arrive are requested by the leader; the follower sends them again.

`mmt.link.frame_sender` is the follower's side.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from mmt.core.frames import FIELD_OF_CHANNEL, LARGEST_QUANTITY, channels_of
from mmt.core.sequence_numbers import SEQUENCES, Range, ranges_of
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.incoming import LATEST_NS
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


class BackfillReceiver:
    """Request frames, validate those that come, and hand them on.

    Parameters
    ----------
    dtype
        Dtype of the frames.
    endpoint
        Has the send queue, and the reader of the live frames, which knows which sequence numbers
        are plausible and counts rejected messages.
    events
        Callbacks of the service.
    """

    def __init__(self, dtype: np.dtype[np.void], endpoint: Endpoint, events: LeaderEvents) -> None:
        self._dtype = dtype
        self._endpoint = endpoint
        self._events = events
        self._reject = endpoint.reader.reject
        self.settling = False
        """Whether a follower that is ending was sent a list of missing frames."""
        self.handlers: Final[dict[str, Callable[..., Any]]] = {
            BACKFILL: self._on_backfill,
            GONE: self._on_gone,
            SETTLE: self._on_settle,
        }
        """Handlers of the follower's events."""

    def request(self, ranges: Iterable[Range]) -> None:
        """Request frames from the follower; ranges that exceed one message are left out."""
        self._endpoint.outbox.put(0, encode_event(MISSING, list(ranges)[:MAX_RANGES]))

    def _on_backfill(self, *arguments: object) -> None:
        data, size = argument_of(arguments), self._dtype.itemsize
        longest = MAX_RECORDS_PER_MESSAGE * size
        if not isinstance(data, bytes) or len(data) % size or not 0 < len(data) <= longest:
            self._reject("malformed back-fill")
            return
        frames = np.frombuffer(data, dtype=self._dtype)
        good = (frames["time_ns"] >= 0) & (frames["time_ns"] < LATEST_NS)
        for channel in channels_of(self._dtype):
            values = frames[FIELD_OF_CHANNEL[channel]].reshape(len(frames), -1)
            good &= (np.abs(values) <= LARGEST_QUANTITY).all(axis=1)  # false if not finite
        if not good.all():
            self._reject("unusable back-fill")
            bad = np.unique(frames["sequence"][~good]).astype(np.int64)
            self._endpoint.notify(self._events.on_gone, ranges_of(bad))
        if good.any():
            self._endpoint.notify(self._events.on_backfill, frames[good])

    def _on_gone(self, *arguments: object) -> None:
        ranges = ranges_of_payload(argument_of(arguments))
        if ranges is None:
            self._reject("malformed gone")
            return
        self._endpoint.notify(self._events.on_gone, ranges)

    def _on_settle(self, *arguments: object) -> dict[str, Any]:
        payload = argument_of(arguments)
        sent = payload.get("frames") if isinstance(payload, Mapping) else None
        missing: list[Range] = []
        if not isinstance(sent, int) or not 0 <= sent <= SEQUENCES:
            self._reject("malformed settle")
            return {"missing": missing}
        if not self._endpoint.reader.is_plausible(sent, time.monotonic_ns()):
            return {"missing": missing}  # the end event, with the same count, is rejected
        try:
            missing = self._events.on_settle(sent)[:MAX_RANGES]
        except Exception as error:  # noqa: BLE001 - handed to the service
            self._events.on_error(error)
        self.settling |= bool(missing)
        return {"missing": missing}
