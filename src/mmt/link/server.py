"""The leader's side of the link: it listens and serves one follower at a time."""

import logging
import math
import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.core.frames import COMMAND_DTYPE, Channel, FeedbackSide
from mmt.core.sequence_numbers import Range, shortest_period_ns
from mmt.link.access import Access
from mmt.link.backfill import BackfillReceiver
from mmt.link.clock_exchange import ClockResponder
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.handshake import FollowerSlot
from mmt.link.incoming import BlockReader
from mmt.link.protocol import (
    CLOCK,
    COMMANDS,
    END,
    EVENT,
    FRAMES,
    SETTLE_S,
    STOP,
    FollowerHello,
    LinkStatistics,
    argument_of,
    encode_rejection,
    peer_text,
    reason_of,
)
from mmt.link.serving.http import CLOSE_TIMEOUT_S, LinkServer, Page
from mmt.scene import Link

if TYPE_CHECKING:
    from mmt.link.emulated.network import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")

_COMMANDS_WAIT_S: Final = 0.05
"""How long commands may be queued for a stalled link: older ones are useless."""


class LeaderServer:
    """Serve the link over Socket.IO (WebSocket only, msgpack) to one follower at a time.

    Parameters
    ----------
    settings
        Where to listen; port 0 takes any free one.
    channels
        Channels that the leader's scene needs in each frame.
    events
        Callbacks of the service.
    rate_hz, samples_per_frame
        Frames a second, and samples of acceleration in each, that the scene expects.
    fastest
        How many times faster than real time a follower may stream, as a replay can; sequence
        numbers beyond that are rejected as implausible.
    network
        Network emulated on the way to the follower; its settings can be changed over HTTP.
    session_id
        Identifier of the session in the logs of both sides.
    extra
        Side of force feedback with the scene's further event, or None.

    Raises
    ------
    InputError
        There are no channels, or unknown ones, or the token cannot be read.
    """

    def __init__(
        self,
        settings: Link,
        channels: Iterable[Channel],
        events: LeaderEvents,
        *,
        rate_hz: int = 1000,
        samples_per_frame: int = 1,
        fastest: float = 100.0,
        network: "EmulatedNetwork | None" = None,
        session_id: str = "",
        extra: FeedbackSide | None = None,
    ) -> None:
        self._events = events
        access = Access.from_settings(settings)
        expected = FollowerHello(
            tuple(channels),
            source="",
            rate_hz=rate_hz,
            extra="" if extra is None else extra.event or "",
            samples_per_frame=samples_per_frame,
        )
        dtype = expected.frame_dtype
        self.endpoint = endpoint = Endpoint(
            BlockReader(dtype, "frames", shortest_period_ns(rate_hz, fastest)),
            math.ceil(_COMMANDS_WAIT_S * rate_hz),
            rate_hz,
            events,
            lambda fault: self._slot.cut_off(fault),  # noqa: PLW0108 - made later
            network=network,
            extra=extra,
        )
        """Reader of received messages, and queue of messages to send."""
        size = dtype.itemsize
        endpoint.reader.on_rejected = lambda reason, times: endpoint.outbox.put(
            0, encode_rejection(FRAMES, reason, times, size)
        )
        self.clock = ClockResponder(endpoint.reader, endpoint.outbox, endpoint.notify_jump)
        self._host = LinkServer(settings, access, busy=lambda: self._slot.in_session)
        self._backfill = BackfillReceiver(dtype, endpoint, events)
        self._slot = FollowerSlot(
            self._host,
            endpoint,
            self.clock,
            events,
            access=access,
            expected=expected,
            session_id=session_id,
            network=network,
        )
        frequent = {FRAMES: self._on_frames, CLOCK: self.clock.handle_request}
        if endpoint.extra_event:
            frequent[endpoint.extra_event] = endpoint.handle_extra
        others = {EVENT: self._on_event, END: self._on_end, **self._backfill.handlers}
        self._slot.handle(frequent, others)

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._host.port

    @property
    def connected(self) -> bool:
        """Whether a follower is connected that has not ended the session."""
        return self._slot.in_session

    @property
    def statistics(self) -> LinkStatistics:
        """Counts since the start; takes a few hundred microseconds to compute."""
        endpoint = self.endpoint
        return endpoint.statistics(
            frames=endpoint.reader.records,
            commands=endpoint.outbox.records,
            clock=self.clock.statistics,
        )

    async def start(self, pages: Iterable[Page] = ()) -> None:
        """Start to listen, and serve pages to clients with the token; see `LinkServer.start`."""
        await self._host.start(pages)

    async def request_stop(self, reason: str) -> None:
        """Ask the follower to end, and wait until it has left, at most a second."""
        slot = self._slot
        if slot.sid is None:
            return
        if slot.in_session:
            await self._host.server.emit(STOP, {"reason": reason}, to=slot.sid)
        if await slot.wait_until_free(CLOSE_TIMEOUT_S):
            return
        if self._backfill.settling and await slot.wait_until_free(SETTLE_S):
            return
        LOG.info("the follower did not leave in time")

    async def stop(self) -> None:
        """Drop the follower, if there is one, and stop listening."""
        self._slot.close()
        self.endpoint.outbox.close()
        await self._host.stop()

    def send_commands(self, commands: RecordArray) -> None:
        """Queue motion commands for the follower; never waits.

        Without a follower they are ignored. When the link is stalled, the oldest commands are
        dropped and counted.

        Parameters
        ----------
        commands
            Shape (n,), of `mmt.core.frames.COMMAND_DTYPE`; their ``sequence`` must increase.

        Raises
        ------
        ValueError
            The commands are of another dtype.
        """
        if commands.dtype != COMMAND_DTYPE:
            message = f"commands are of dtype {commands.dtype}: allowed is COMMAND_DTYPE"
            raise ValueError(message)
        if self.can_send:
            self.endpoint.outbox.put_records(COMMANDS, commands.tobytes(), COMMAND_DTYPE.itemsize)

    def request_frames(self, ranges: Iterable[Range]) -> None:
        """Request frames that did not arrive; ignored without a follower."""
        if self.can_send:
            self._backfill.request(ranges)

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the scene's further event for the follower; never waits."""
        if self.can_send:
            self.endpoint.send_extra(records)

    @property
    def can_send(self) -> bool:
        """Whether a follower is connected and its send queue is open."""
        return self._slot.sid is not None and self.endpoint.outbox.is_open

    # --- what the follower sends

    def _on_frames(self, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        block = self.endpoint.reader.read(arguments, arrival_ns)
        if block is not None:
            self.endpoint.notify(self._events.on_frames, block, arrival_ns)

    def _on_event(self, *arguments: object) -> None:
        sentence = argument_of(arguments)
        if isinstance(sentence, str):
            self.endpoint.notify(self._events.on_event, peer_text(sentence))
        else:
            self.endpoint.reader.reject("malformed event")

    def _on_end(self, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        payload = argument_of(arguments)
        reason = reason_of(payload)
        sent = payload.get("frames") if isinstance(payload, Mapping) else None
        if reason is None or not isinstance(sent, int):
            self.endpoint.reader.reject("malformed end")
            return
        self.endpoint.reader.end(sent, arrival_ns)
        self._slot.end()
        self.endpoint.outbox.close()
        self.endpoint.notify(self._events.on_end, reason)
