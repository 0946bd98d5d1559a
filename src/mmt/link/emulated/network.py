"""The emulated network: messages are delayed, lost and repeated before they are sent.

Each side emulates the network for its own messages. Messages of python-socketio itself
(connecting, pings, acknowledgements) and events that open or end a session or change the emulation
are not affected, so that an emulated outage is silence on a link that is up. The settings come
from the scene and can be changed over HTTP while the link runs.
"""

import asyncio
import heapq
import itertools
import json
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final, Literal

from aiohttp import web

from mmt.core.errors import InputError
from mmt.core.running.ticking import LoopTimer
from mmt.link.emulated.impairments import MessageImpairments
from mmt.link.queue import SendQueue
from mmt.link.serving.accepting import HANDSHAKE_S
from mmt.scene import Network
from mmt.scene.files import table_from

_MAX_DELAYED: Final = 20_000
"""Most messages that are delayed at once."""


class EmulatedSendQueue(SendQueue):
    """A send queue whose messages first pass an emulated network.

    Parameters
    ----------
    capacity
        Messages that may be queued for the link once their delay is over.
    settings
        The emulated network; can be changed at any time.
    seed
        Seed of the impairments.
    """

    def __init__(self, capacity: int, settings: Network, seed: int) -> None:
        super().__init__(capacity)
        self._impairments = MessageImpairments(settings, seed, time.monotonic_ns())
        self._delayed: list[tuple[int, int, int, bytes]] = []
        self._number = itertools.count()
        self._timer = LoopTimer(lambda _: self._release(), coarse=True)
        self._at_once = max(1, capacity // 2)  # the task that empties the queue runs in between
        self._received = self._lost = self._repeated = 0

    @property
    def emulated(self) -> dict[str, int]:
        """Counts since the start: messages put, lost and repeated."""
        return {"messages": self._received, "lost": self._lost, "repeated": self._repeated}

    def change(self, settings: Network, seed: int) -> None:
        """Apply these settings from now on; delayed messages keep their time."""
        fates = MessageImpairments(settings, seed, time.monotonic_ns())
        fates.continue_from(self._impairments)
        self._impairments = fates

    def put(self, records: int, message: bytes) -> None:
        """Delay, lose or repeat a message that holds this many records; never waits."""
        if not self.is_open:
            super().put(records, message)
            return
        self._received += 1
        now_ns = time.monotonic_ns()
        arrivals = self._impairments.arrivals_ns(now_ns, len(message))
        if not arrivals or len(self._delayed) + len(arrivals) > _MAX_DELAYED:
            self._lost += 1
            return
        self._repeated += len(arrivals) - 1
        for arrival_ns in sorted(arrivals):
            heapq.heappush(self._delayed, (arrival_ns, next(self._number), records, message))
            records = 0  # a repeated message is not counted twice
        self._release()

    async def finish(self, timeout_s: float) -> None:
        """Send all delayed and queued messages, within `timeout_s`; then close."""
        if self._delayed:
            last_ns = max(arrival_ns for arrival_ns, *_ in self._delayed)
            wait_s = min(max(last_ns - time.monotonic_ns(), 0) / 1e9, timeout_s)
            await asyncio.sleep(wait_s)
            timeout_s -= wait_s
            while self._delayed and self._delayed[0][0] <= time.monotonic_ns():
                self._release()
                await asyncio.sleep(0)
        await super().finish(timeout_s)

    @property
    def idle(self) -> bool:
        """Whether a message would pass the emulated network and the link at once."""
        return super().idle and self._impairments.is_free(time.monotonic_ns())

    @property
    def _empty(self) -> bool:
        return self.idle and not self._delayed

    def close(self) -> None:
        """Stop sending at once; delayed messages count as lost on their way."""
        first_copies = sum(records > 0 for _, _, records, _ in self._delayed)
        self._lost += first_copies
        self._repeated -= len(self._delayed) - first_copies
        self._delayed.clear()
        self._timer.stop()
        super().close()

    def _release(self) -> None:
        now_ns = time.monotonic_ns()
        for _ in range(self._at_once):
            if not self._delayed or self._delayed[0][0] > now_ns:
                break
            _, _, records, message = heapq.heappop(self._delayed)
            super().put(records, message)
        if self._delayed:
            self._timer.start()
            self._timer.set(self._delayed[0][0])


PATH: Final = "/network"
_MOST_BYTES: Final = 4096


class EmulatedNetwork:
    """The network that one side emulates for the messages that it sends.

    Parameters
    ----------
    settings
        The scene's table ``[network]``.
    direction
        "up" for the follower, which sends frames; "down" for the leader, which sends commands.
    seed
        Seed of the session, for settings without a seed.
    on_change
        Called with a sentence when the settings have changed.
    """

    def __init__(
        self,
        settings: Network,
        direction: Literal["up", "down"],
        seed: int,
        on_change: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.settings = settings
        self._direction: Literal["up", "down"] = direction
        self._session_seed = seed
        self._on_change = on_change
        self._outboxes: list[EmulatedSendQueue] = []

    def send_queue(self, capacity: int) -> EmulatedSendQueue:
        """Return a send queue of this capacity that follows these settings."""
        outbox = EmulatedSendQueue(capacity, self._own_settings(), self._seed())
        self._outboxes.append(outbox)
        return outbox

    def payload(self) -> dict[str, Any]:
        """Return the settings as sent to the peer and over HTTP."""
        return self.settings.model_dump(mode="json")

    def change(self, payload: object) -> None:
        """Validate received settings and apply them.

        Raises
        ------
        InputError
            The settings are not a valid table ``[network]`` of a scene.
        """
        settings = table_from(Network, "network", payload)
        if settings == self.settings:
            return
        self.settings = settings
        for outbox in self._outboxes:
            outbox.change(self._own_settings(), self._seed())
        self._on_change(f"emulated network: {settings.describe()}")

    def serve(self, application: web.Application, tell: Callable[[], Awaitable[None]]) -> None:
        """Serve the settings over HTTP, to read and replace; `tell` sends them to the peer."""

        async def read(_: web.Request) -> web.Response:
            return web.json_response(self.payload())

        async def replace(request: web.Request) -> web.Response:
            try:
                self.change(await _json_of(request))
            except InputError as error:
                return web.json_response({"error": str(error)}, status=400)
            await tell()
            return web.json_response(self.payload())

        application.router.add_get(PATH, read)
        application.router.add_put(PATH, replace)

    def _own_settings(self) -> Network:
        applies = self.settings.direction in {"both", self._direction}
        return self.settings if applies else Network()

    def _seed(self) -> int:
        own = self.settings.seed
        seed = self._session_seed if own is None else own
        return 2 * seed + (self._direction == "down")


async def _json_of(request: web.Request) -> object:
    """Return the JSON body; a browser's page of another origin cannot send this content type."""
    if request.content_type != "application/json":
        raise InputError("send the settings as JSON, with Content-Type: application/json")
    body = b""
    try:
        async with asyncio.timeout(HANDSHAKE_S):
            async for part in request.content.iter_any():
                body += part
                if len(body) > _MOST_BYTES:
                    raise InputError(f"the settings are longer than {_MOST_BYTES} bytes")
    except TimeoutError as error:
        raise InputError(f"the settings did not arrive within {HANDSHAKE_S:g} s") from error
    try:
        return json.loads(body)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the settings are no JSON: {error}") from error
