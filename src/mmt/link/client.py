"""The follower's side of the link: it connects, streams, and reconnects after a break."""

import logging
import struct
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import COMMAND_DTYPE, FeedbackSide
from mmt.core.running.ticking import TimeHistogram
from mmt.link.access import Access
from mmt.link.clock_exchange import ClockRequester
from mmt.link.connection import LeaderConnection
from mmt.link.endpoint import Endpoint, FollowerEvents
from mmt.link.frame_sender import BackfillSender, FrameSender
from mmt.link.incoming import BlockReader
from mmt.link.protocol import (
    CLOCK,
    COMMANDS,
    END,
    EVENT,
    MISSING,
    NETWORK,
    SETTLE,
    SETTLE_S,
    STOP,
    WELCOME,
    FollowerHello,
    LinkStatistics,
    argument_of,
    encode_event,
    peer_text,
    reason_of,
)
from mmt.link.socket_client import ACKNOWLEDGE_S, CLOSE_TIMEOUT_S
from mmt.link.websocket import Send

if TYPE_CHECKING:
    from mmt.link.emulated.network import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")

_MESSAGES_WAITING: Final = 1000
"""Queue length if no frames are buffered: frames dropped from the queue are lost."""
_LIVE_MESSAGES_WAITING: Final = 50
"""Queue length if frames are buffered: older ones would only delay live frames."""
_ECHO: Final = struct.Struct("<qq")
"""A command's ``echo_time_ns`` and ``echo_age_ns``; NumPy takes ten times as long to read them."""
_ECHO_FROM_END: Final = -28  # 40 bytes a command, of which the 12 before are number and time
_SETTLED_S: Final = 1.0
"""How long the leader may take to name the missing frames at the end."""


class FollowerClient:
    """Connect to a leader, stream frames to it and receive its commands.

    Parameters
    ----------
    url
        URL of the leader: ``http://host:port``, or ``https``.
    hello
        Description of the follower; sent again with every connection.
    events
        Callbacks of the service.
    network
        Network emulated between this side and the leader, or None.
    access
        The token and the certificates of this side.
    clock_hz
        Rate of the exchange of time stamps with the leader; 0 for none.
    extra
        Side of force feedback with the scene's further event, or None.

    Raises
    ------
    InputError
        `url` is not valid, or lacks TLS although there are certificates, or one of these cannot
        be used.
    """

    def __init__(
        self,
        url: str,
        hello: FollowerHello,
        events: FollowerEvents,
        *,
        network: "EmulatedNetwork | None" = None,
        access: Access | None = None,
        clock_hz: float = 0.0,
        extra: FeedbackSide | None = None,
    ) -> None:
        self._events = events
        self._network = network
        self.endpoint = endpoint = Endpoint(
            BlockReader(COMMAND_DTYPE, "commands"),
            _LIVE_MESSAGES_WAITING if hello.keep_frames else _MESSAGES_WAITING,
            hello.rate_hz,
            events,
            self._on_rate_exceeded,
            network=network,
            extra=extra,
        )
        """Reader of received messages, and queue of messages to send."""
        self.frames = FrameSender(hello, endpoint.outbox)
        """Has the counts of back-filled frames."""
        self._backfiller = self.frames.backfiller
        self._clock_hz = clock_hz
        self.clock = ClockRequester(endpoint.reader, endpoint.outbox, endpoint.notify_jump)
        """Estimate of the leader's clock."""
        self.round_trip = TimeHistogram()
        """Times from a frame to the command that echoes it."""
        self._connection = LeaderConnection(
            url,
            hello.to_auth(),
            access or Access(),
            endpoint.rate_limit,
            on_open=self._on_open,
            on_broken=self._on_broken,
        )
        self._ended = False
        self._stop_requested = False

    @property
    def connected(self) -> bool:
        """Whether the link is up."""
        return self._connection.connected

    @property
    def statistics(self) -> LinkStatistics:
        """Counts since the start; takes a few hundred microseconds to compute."""
        endpoint = self.endpoint
        return endpoint.statistics(
            frames=endpoint.outbox.records,
            commands=endpoint.reader.records,
            clock=self.clock.statistics,
            round_trip=self.round_trip,
        )

    async def connect(self, timeout_s: float) -> None:
        """Connect, waiting up to `timeout_s` for the leader to appear.

        Once connected, a link that breaks is restored until `disconnect` is called.

        Raises
        ------
        MmtError
            No leader answered in time, or it refused; the message says why.
        """
        handlers = {
            WELCOME: self._on_welcome,
            STOP: self._on_stop,
            NETWORK: self._on_network,
            MISSING: self._on_missing,
        }
        frequent = {COMMANDS: self._on_commands, CLOCK: self.clock.handle_response}
        if self.endpoint.extra_event:
            frequent[self.endpoint.extra_event] = self.endpoint.handle_extra
        await self._connection.open(handlers, frequent, timeout_s)

    def send_frames(self, frames: RecordArray) -> None:
        """Queue frames for the leader; never waits.

        A message is sent as soon as the hello's ``frames_per_message`` are complete. When the
        link is down or stalled, the oldest messages are dropped and their frames counted.

        Parameters
        ----------
        frames
            Shape (n,), of the hello's dtype; their ``sequence`` must increase.

        Raises
        ------
        ValueError
            The frames are of another dtype.
        """
        self.frames.put(frames)

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the scene's further event for the leader; never waits."""
        self.endpoint.send_extra(records)

    def send_event(self, sentence: str) -> None:
        """Send the leader a sentence for the recording; never waits, ignored without a link."""
        self.endpoint.outbox.put(0, encode_event(EVENT, sentence))

    async def end(self, reason: str) -> None:
        """Send all queued messages, announce the session's end, wait for the acknowledgement.

        Do nothing if the link is down, or if the session has ended before.
        """
        if self._ended or not self._connection.connected:
            return
        self._ended = True
        self.clock.stop()
        self.frames.flush()
        if self._backfiller is not None:
            await self._settle(self._backfiller)
        await self.endpoint.outbox.finish(CLOSE_TIMEOUT_S)
        if not self.connected:
            return
        payload = {"reason": reason, "frames": self.frames.sent}
        try:
            await self._connection.request(END, payload, ACKNOWLEDGE_S)
        except ConnectionError:
            LOG.warning("the leader did not acknowledge the end of the session")

    async def disconnect(self) -> None:
        """Close the link for good; without one, do nothing."""
        self._ended = True
        self._stop_sending()
        await self._connection.close()

    # --- the connection

    def _on_open(self, send: Send) -> None:
        self.endpoint.restart()
        self.endpoint.notify(self._events.on_open)
        self.endpoint.outbox.open(send)
        if self._backfiller is not None:
            self._backfiller.open()

    def _on_broken(self, reason: str) -> None:
        self._stop_sending()
        if not self._ended and not self._stop_requested:
            self.endpoint.notify(self._events.on_lost, reason)

    def _on_rate_exceeded(self, fault: MmtError) -> None:
        self._ended = True  # do not reconnect to a peer that floods
        self._events.on_error(MmtError(f"the leader was cut off: {fault}"))

    def _stop_sending(self) -> None:
        self.clock.stop()
        self.endpoint.outbox.close()
        if self._backfiller is not None:
            self._backfiller.close()

    async def _settle(self, backfiller: BackfillSender) -> None:
        """Send the frames that the leader lacks so far, again if they get lost as well."""
        deadline_s = time.monotonic() + SETTLE_S
        while time.monotonic() < deadline_s:
            await self.endpoint.outbox.flush(CLOSE_TIMEOUT_S)
            try:
                answer = await self._connection.request(
                    SETTLE, {"frames": self.frames.sent}, _SETTLED_S
                )
            except ConnectionError:
                return  # the leader hangs, or has no such event
            if not isinstance(answer, Mapping) or not answer.get("missing"):
                return
            backfiller.request(answer["missing"])
            await backfiller.finish(SETTLE_S)

    # --- what the leader sends

    def _on_welcome(self, *arguments: object) -> None:
        payload = argument_of(arguments)
        if not isinstance(payload, Mapping):
            return
        self.clock.start_connection(payload.get("clock_id"))
        self.clock.start(self._clock_hz)
        session_id = payload.get("session_id")
        if isinstance(session_id, str) and session_id:
            self.endpoint.notify(self._events.on_session, peer_text(session_id))

    def _on_commands(self, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        block = self.endpoint.reader.read(arguments, arrival_ns)
        if block is None:
            return
        data = block.tobytes()  # the buffer protocol of an array takes forty times as long
        echo_time_ns, echo_age_ns = _ECHO.unpack_from(data, len(data) + _ECHO_FROM_END)
        if echo_time_ns:
            self.round_trip.add(arrival_ns - echo_time_ns - echo_age_ns)
        self.endpoint.notify(self._events.on_commands, block, arrival_ns)

    def _on_stop(self, *arguments: object) -> None:
        self._stop_requested = True
        reason = reason_of(argument_of(arguments))
        self.endpoint.notify(self._events.on_stop, reason or "no reason given")

    def _on_missing(self, *arguments: object) -> None:
        if self._backfiller is not None:
            self._backfiller.request(argument_of(arguments))

    def _on_network(self, *arguments: object) -> None:
        if self._network is not None:
            try:
                self._network.change(argument_of(arguments))
            except InputError:
                self.endpoint.reader.reject("malformed network")
