"""The running hub: serves listeners, talks to the other hubs and, if it feeds, to the leader."""

import asyncio
import logging
import time
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.core.running.ending import cancel_until_ended, start_task
from mmt_share.client import ListenerClient
from mmt_share.hub.channel import HubChannel
from mmt_share.hub.copy import HubCopy
from mmt_share.hub.peers import BEAT_S, Heartbeat, Peers
from mmt_share.hub.scene import HubScene
from mmt_share.messages import AGAIN, MODEL, WELCOME
from mmt_share.relay import Relay
from mmt_share.server import SharingServer

LOG: Final = logging.getLogger("mmt_share")

_BEAT: Final = "beat"
_LOOK_S: Final = 0.25
"""Period at which a hub checks whether it should feed."""
_MOST_WAITING: Final = 100
"""Most messages queued for Redis. Beyond, the oldest are lost and hubs request the whole model."""
_WELCOME: Final = {"session_id": "", "name": "", "rate_hz": 1000, "hubs": []}
"""Welcome of a hub that knows no session yet."""


class Hub:
    """Serve a leader's shared model, together with other hubs.

    Parameters
    ----------
    scene
        Tables of the hub; the leader's address is ``url`` of ``[listening]``.
    own_address
        Returns the address for listeners at a port; used if ``[hub]`` has no address.
    on_event
        Called with a sentence whenever something happens that a person wants to know.

    Raises
    ------
    InputError
        A URL is not valid, or a token or a certificate cannot be read.
    """

    def __init__(
        self,
        scene: HubScene,
        own_address: Callable[[int], str],
        on_event: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._scene, self._own_address, self._on_event = scene, own_address, on_event
        self.id = f"{time.time_ns():020d}-{uuid.uuid4().hex[:8]}"
        self.address = ""
        """Address for listeners, empty before `start`."""
        self.listeners = self.most_listeners = 0
        self.relay = Relay()
        self.copy = HubCopy(self.relay, scene.hub.states_hz)
        self._peers = Peers(self.id, time.monotonic())
        group = scene.hub.group or scene.listening.url.partition("://")[2].rstrip("/")
        self._channel = HubChannel(scene.hub.redis, group, self._deliver)
        self.server = SharingServer(scene.sharing, self.relay, _WELCOME, self._on_listeners)
        self._feed: ListenerClient | None = self._new_feed()  # raises now if not valid
        self._connecting: asyncio.Task[None] | None = None
        self._leaders_welcome: dict[str, Any] = {}
        self._outbox: deque[tuple[str, Any]] = deque(maxlen=_MOST_WAITING)
        self._posted = asyncio.Event()
        self._asked = False
        self._behind = 0
        self._told_hubs: list[str] = []
        self._told_session = ""
        self._told: dict[str, str | None] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def feeding(self) -> bool:
        """Whether this hub is connected to the leader."""
        return self._feed is not None and self._feed.connected

    async def start(self) -> None:
        """Check that Redis answers, and listen.

        Raises
        ------
        InputError
            Anyone could listen although the scene does not allow it, or a certificate is unusable.
        MmtError
            No Redis server answers, or the host or the port cannot be used.
        """
        await self._channel.require()
        await self.server.start()
        self.address = self._scene.hub.address or self._own_address(self.server.port)
        self._channel.start()

    async def run(self, ended: asyncio.Event) -> None:
        """Serve until `ended` is set.

        Raises
        ------
        MmtError
            The leader did not answer in time or refused this hub, and no hub has reached it yet.
        """
        over = asyncio.create_task(ended.wait())
        for part in (self._beat(), self._poll(), self._post()):
            start_task(part, self._tasks)
        try:
            done, _ = await asyncio.wait([over, *self._tasks], return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            over.cancel()

    async def stop(self) -> None:
        """Leave the other hubs and disconnect the listeners; harmless without `start`."""
        await cancel_until_ended(self._tasks)
        if self.address:
            await self._channel.publish(_BEAT, self._own_beat(leaving=True))
        await self._stop_feeding()
        await self.server.stop()
        await self._channel.close()

    # --- events received from all hubs, this one included

    def _deliver(self, event: str, message: Any) -> None:
        if event == _BEAT:
            self._on_heartbeat(message)
        elif event == AGAIN:
            self._asked = True
        else:
            self.copy.receive(event, message)
            if event == WELCOME and self.copy.session_id != self._told_session:
                self._told_session = self.copy.session_id
                start_task(self.server.welcome(**self.copy.welcome), self._tasks)

    def _on_heartbeat(self, message: Any) -> None:
        try:
            beat = Heartbeat.from_message(message)
        except InputError as error:
            LOG.info("%s", error)
            return
        self._peers.record_heartbeat(beat, time.monotonic())
        if not beat.feeding or beat.id == self.id:
            return
        mine = (self.copy.session_id, self.copy.number)
        ahead = beat.session_id != mine[0] or beat.number > mine[1]
        self._behind = self._behind + 1 if ahead else 0
        if self._behind > 1:  # the missing message is not on its way, but lost
            self.copy.lacking = True

    # --- events sent to all hubs

    def _own_beat(self, *, leaving: bool = False) -> dict[str, Any]:
        copy = self.copy
        feeding = self.feeding and not leaving
        beat = Heartbeat(
            self.id, self.address, self.listeners, feeding, copy.session_id, copy.number, leaving
        )
        return vars(beat)

    async def _beat(self) -> None:
        """Check Redis, send a beat and request what this hub lacks, once a second."""
        while True:
            problem = await self._channel.check()
            told = self._report_problem(
                "redis",
                problem and f"Redis is lost ({problem}): this hub goes on alone",
                "Redis is back",
            )
            if told and problem is None:
                self.copy.lacking = True
            if problem is None:
                await self._channel.publish(_BEAT, self._own_beat())
            if self.copy.lacking:
                await self._ask()
            await asyncio.sleep(BEAT_S)

    async def _ask(self) -> None:
        """Request what is missing, from the leader if connected to it, else from the other hubs."""
        if self._feed is not None and self._feed.connected:
            self._forward(WELCOME, self._leaders_welcome)
            self._feed.request_model()
        else:
            await self._channel.publish(AGAIN, self.id)

    async def _poll(self) -> None:
        """Feed if it is this hub's turn, keep the list of hubs, and answer hubs that lack state."""
        while True:
            now_s = time.monotonic()
            if self._peers.should_feed(now_s, feeding=self.feeding):
                if self._connecting is None:
                    self._connecting = asyncio.create_task(self._connect())
            elif self._connecting is not None:
                await self._stop_feeding()
            if self._connecting is not None and self._connecting.done():
                self._connecting.result()
            addresses = [beat.address for beat in self._peers.alive(now_s)]
            if addresses != self._told_hubs:
                self._told_hubs = addresses
                self._on_event(f"other hubs: {', '.join(addresses) or 'none'}")
                await self.server.send_hubs(addresses)
            if self._asked and self._answers(now_s):
                self._forward_model()
            self._asked = False
            await asyncio.sleep(_LOOK_S)

    # --- the leader

    def _new_feed(self) -> ListenerClient:
        return ListenerClient(
            self._scene.listening,
            on_event=self._on_event,
            on_message=self._forward,
            states_hz=None,
        )

    async def _connect(self) -> None:
        """Connect to the leader; if a session is known already, retry until it answers.

        Raises
        ------
        MmtError
            The leader did not answer or refused, and no session is known yet.
        """
        while not self.feeding:
            self._feed = self._feed or self._new_feed()
            try:
                await self._feed.connect()
            except MmtError as error:
                await self._feed.close()
                self._feed = None
                if not self.copy.session_id:
                    raise
                self._report_problem("leader", str(error), "")
                await asyncio.sleep(BEAT_S)
            else:
                self._report_problem("leader", None, "")
                self._on_event("this hub takes the model from the leader")

    async def _stop_feeding(self) -> None:
        connecting, self._connecting = self._connecting, None
        if connecting is not None:
            await cancel_until_ended([connecting])
        feed, self._feed = self._feed, None
        if feed is not None:
            await feed.close()

    def _forward(self, event: str, message: Any) -> None:
        if event == WELCOME:
            self._leaders_welcome = message
        self._outbox.append((event, message))
        self._posted.set()

    def _forward_model(self) -> None:
        """Send every hub the session and the whole model."""
        self._forward(WELCOME, self.copy.welcome)
        if self.copy.number:
            self._forward(MODEL, self.copy.replica.message())

    def _answers(self, now_s: float) -> bool:
        """Whether this hub is the one to answer a hub that lacks something.

        The feeder answers; while there is none, the oldest hub that has a session.
        """
        if self.copy.lacking or not self.copy.session_id:
            return False
        others = self._peers.alive(now_s)
        if self.feeding or any(beat.feeding for beat in others):
            return self.feeding
        return not any(beat.session_id and beat.id < self.id for beat in others)

    async def _post(self) -> None:
        """Send the queued messages to all hubs, in order."""
        while True:
            await self._posted.wait()
            self._posted.clear()
            while self._outbox:
                await self._channel.publish(*self._outbox.popleft())

    # --- reports

    def _report_problem(self, subject: str, problem: str | None, cured: str) -> bool:
        """Report a problem once, and its end once; return whether there was such a change."""
        before = self._told.get(subject)
        if (before is None) == (problem is None):
            return False
        self._told[subject] = problem
        sentence = problem or cured
        if sentence:
            self._on_event(sentence)
        return True

    def _on_listeners(self, _: str, details: dict[str, Any]) -> None:
        self.listeners = details["listeners"]
        self.most_listeners = max(self.listeners, self.most_listeners)
