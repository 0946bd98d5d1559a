"""The emulated network: messages are delayed, lost and repeated before they are sent.

Each side emulates what it sends. What python-socketio sends by itself (connecting, pings,
acknowledgements) and the events `welcome`, `stop` and `end` are not affected, so that an emulated
outage is silence on a link that is up. The settings come from the scene and can be changed over
HTTP while the link runs.
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
from mmt.core.timer_file import TimerFile, open_timer
from mmt.link.impairments import MessageFates
from mmt.link.queue import SendQueue
from mmt.scene import Network
from mmt.scene.files import table_from

_MOST_HELD: Final = 20_000
"""Messages that are held back at most."""


class EmulatedSendQueue(SendQueue):
    """An outbox before which messages meet the fates of an emulated network.

    Parameters
    ----------
    capacity
        Messages that may wait for the link once their time has come.
    settings
        What to emulate; it can be changed at any time.
    seed
        Of the fates.
    """

    def __init__(self, capacity: int, settings: Network, seed: int) -> None:
        super().__init__(capacity)
        self._fates = MessageFates(settings, seed, time.monotonic_ns())
        self._held: list[tuple[int, int, int, bytes]] = []
        self._number = itertools.count()
        self._alarm = _Alarm(self._release)
        self._at_once = max(1, capacity // 2)  # the task that empties the queue runs in between
        self._taken = self._lost = self._repeated = 0

    @property
    def emulated(self) -> dict[str, int]:
        """Messages that came here since the start, and what was done to them."""
        return {"messages": self._taken, "lost": self._lost, "repeated": self._repeated}

    def change(self, settings: Network, seed: int) -> None:
        """Treat messages so from now on; those that are held keep their time."""
        fates = MessageFates(settings, seed, time.monotonic_ns())
        fates.follow(self._fates)
        self._fates = fates

    def put(self, records: int, message: bytes) -> None:
        """Take a message that holds so many records; never waits."""
        if not self.is_open:
            super().put(records, message)
            return
        self._taken += 1
        now_ns = time.monotonic_ns()
        arrivals = self._fates.fate(now_ns, len(message))
        if not arrivals or len(self._held) + len(arrivals) > _MOST_HELD:
            self._lost += 1
            return
        self._repeated += len(arrivals) - 1
        for arrival_ns in arrivals:
            heapq.heappush(self._held, (arrival_ns, next(self._number), records, message))
            records = 0  # a repeated one is the same once more
        self._release()

    async def finish(self, timeout_s: float) -> None:
        """Send what is held when its time comes, and what waits, within this long; then close."""
        if self._held:
            last_ns = max(arrival_ns for arrival_ns, *_ in self._held)
            wait_s = min(max(last_ns - time.monotonic_ns(), 0) / 1e9, timeout_s)
            await asyncio.sleep(wait_s)
            timeout_s -= wait_s
            while self._held and self._held[0][0] <= time.monotonic_ns():
                self._release()
                await asyncio.sleep(0)
        await super().finish(timeout_s)

    @property
    def idle(self) -> bool:
        """Whether the emulated network and the link could take a message at once."""
        return super().idle and self._fates.is_free(time.monotonic_ns())

    @property
    def _empty(self) -> bool:
        return self.idle and not self._held

    def close(self) -> None:
        """Stop sending at once; what is held back is lost, as on its way."""
        self._lost += len(self._held)
        self._held.clear()
        self._alarm.close()
        super().close()

    def _release(self) -> None:
        now_ns = time.monotonic_ns()
        for _ in range(self._at_once):
            if not self._held or self._held[0][0] > now_ns:
                break
            _, _, records, message = heapq.heappop(self._held)
            super().put(records, message)
        if self._held:
            self._alarm.set(self._held[0][0])


class _Alarm:
    """Call back once at a monotonic time: by a timerfd, or the loop's timers without one."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._timer: TimerFile | None = None
        self._handle: asyncio.TimerHandle | None = None
        self._open = False
        self._due_ns: int | None = None

    def set(self, due_ns: int) -> None:
        """Call back at this time; one that was set before is forgotten."""
        loop = asyncio.get_running_loop()
        if not self._open:
            self._open = True
            self._timer = open_timer()
            if self._timer is not None:
                loop.add_reader(self._timer.file, self._on_readable, self._timer)
        if self._due_ns == due_ns:
            return
        self._due_ns = due_ns
        if self._timer is not None:
            self._timer.arm(due_ns, 0)
            return
        if self._handle is not None:
            self._handle.cancel()
        wait_s = (due_ns - time.monotonic_ns()) / 1e9
        self._handle = loop.call_at(loop.time() + wait_s, self._fire)

    def close(self) -> None:
        """Call back no more, until it is set again."""
        if self._timer is not None:
            asyncio.get_running_loop().remove_reader(self._timer.file)
            self._timer.close()
            self._timer = None
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        self._open, self._due_ns = False, None

    def _on_readable(self, timer: TimerFile) -> None:
        if timer.expirations():
            self._fire()

    def _fire(self) -> None:
        self._due_ns = None
        self._callback()


PATH: Final = "/network"
_MOST_BYTES: Final = 4096


class EmulatedNetwork:
    """What one side does to the messages that it sends.

    Parameters
    ----------
    settings
        The scene's table ``[network]``.
    direction
        "up" for the follower, which sends frames; "down" for the leader, which sends commands.
    seed
        Of the session, for settings without one of their own.
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

    def outbox(self, capacity: int) -> EmulatedSendQueue:
        """Return an outbox for so many messages that follows these settings."""
        outbox = EmulatedSendQueue(capacity, self._mine(), self._seed())
        self._outboxes.append(outbox)
        return outbox

    def payload(self) -> dict[str, Any]:
        """Return the settings as the other side and programs take them."""
        return self.settings.model_dump(mode="json")

    def change(self, payload: object) -> None:
        """Check settings that came from elsewhere and take them on.

        Raises
        ------
        InputError
            They are not as the scene's table ``[network]``.
        """
        settings = table_from(Network, "network", payload)
        if settings == self.settings:
            return
        self.settings = settings
        for outbox in self._outboxes:
            outbox.change(self._mine(), self._seed())
        self._on_change(f"emulated network: {settings.describe()}")

    def serve(self, application: web.Application, tell: Callable[[], Awaitable[None]]) -> None:
        """Let programs read and replace the settings; `tell` passes them to the other side."""

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

    def _mine(self) -> Network:
        return self.settings if self.settings.concerns(self._direction) else Network()

    def _seed(self) -> int:
        own = self.settings.seed
        seed = self._session_seed if own is None else own
        return 2 * seed + (self._direction == "down")


async def _json_of(request: web.Request) -> object:
    """Return the body; a browser's page of another origin cannot send this content type."""
    if request.content_type != "application/json":
        raise InputError("send the settings as JSON, with Content-Type: application/json")
    body = await request.content.read(_MOST_BYTES + 1)
    if len(body) > _MOST_BYTES:
        raise InputError(f"the settings are longer than {_MOST_BYTES} bytes")
    try:
        return json.loads(body)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the settings are no JSON: {error}") from error
