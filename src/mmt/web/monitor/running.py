"""The monitor's task, which publishes changes periodically, and its page."""

import asyncio
import logging
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from aiohttp import WSMsgType, web

from mmt.link.access import Access
from mmt.scene import Monitor
from mmt.web.binary_messages import pack
from mmt.web.monitor import states
from mmt.web.monitor.controls import Controls
from mmt.web.monitor.live import LiveMessages, MonitorTap
from mmt.web.monitor.view import LeaderView
from mmt.web.monitor.viewers import Viewer, Viewers
from mmt.web.page_server import (
    GOING_AWAY,
    add_page,
    monitor_files,
    open_socket,
)

if TYPE_CHECKING:
    from mmt.link.http import Page
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.updates import ModelUpdate

LOG: Final = logging.getLogger("mmt.web.monitor")

_EVENTS: Final = 50
_HISTORY: Final = 4000
"""Most updates of the model that are kept: over an hour."""
_SHOWN: Final = 1000
"""Approximate number of points of that history in a message."""


class LeaderMonitor:
    """Shows a running leader on a page.

    Parameters
    ----------
    leader
        The leader, which is read without blocking.
    settings
        The scene's table ``[monitor]``.
    """

    def __init__(self, leader: LeaderView, settings: Monitor) -> None:
        self.tap = MonitorTap()
        self.viewers = Viewers()
        self._leader = leader
        self._period_s = 1.0 / settings.updates_hz
        self._slow = max(2, round(settings.updates_hz))  # calls of `publish_changes` per second
        self._live = LiveMessages(leader.scene, self.tap)
        self._update: ModelUpdate | None = None
        self._model: TextureModel | None = None
        self._history: deque[tuple[float, float]] = deque(maxlen=_HISTORY)
        self._events: deque[tuple[float, str]] = deque(maxlen=_EVENTS)
        self._looks = 0
        self._shown: dict[str, dict[str, Any]] = {}
        self._controls = Controls(leader)
        self._controls_state: dict[str, Any] = {}
        self.viewers.publish(
            "hello", pack("hello", states.hello_header(leader.scene, leader.session_id), {})
        )
        self._publish_model()
        self._publish_completion()
        self._publish_events()

    @property
    def page(self) -> "Page":
        """The page, to be served at the leader's port."""
        return _monitor_page(self.viewers, self._controls)

    async def run(self) -> None:
        """Call `publish_changes` until cancelled. An error ends the monitor, not the session."""
        while True:
            await asyncio.sleep(self._period_s)
            try:
                self.publish_changes()
            except Exception:
                LOG.exception("the monitor has failed, the session goes on without it")
                self.end("the monitor has failed")
                return

    def publish_changes(self) -> None:
        """Publish changes since the last call."""
        self._follow_model()
        if not self.viewers:
            self.tap.watched = False
            return
        if not self.tap.watched:
            self._live.restart()
            self.tap.watched = True
            self._looks = 0
        state = self._controls.state()
        if state != self._controls_state:
            self._controls_state = state
            self.viewers.publish("controls", pack("controls", state, {}))
        for kind, header in self._leader.shown.items():
            if self._shown.get(kind) != header:
                self._shown[kind] = header
                self.viewers.publish(kind, pack(kind, header, {}))
        self.viewers.publish("live", self._live_message(), retain=False)
        # at most one of the two slow messages per call, so that no call takes long
        turn = self._looks % self._slow
        self._looks += 1
        if turn == 0:
            self._publish_ticks()
        elif turn == self._slow // 2 or self._looks == 2:
            self._publish_link()

    def end(self, outcome: str | None = None) -> None:
        """Send the viewers the last state and the outcome of the session, and stop."""
        if not self.viewers.ended:
            if self.viewers and outcome is None:
                self.publish_changes()
                self._publish_ticks()
                self._publish_link()
            verdict = self._leader.verdict.as_dict()
            shown = self._leader.outcome if outcome is None else outcome
            self.viewers.publish("end", pack("end", {"outcome": shown, "verdict": verdict}, {}))
        self.tap.watched = False
        self.viewers.close()

    def _publish_ticks(self) -> None:
        self.viewers.publish("ticks", states.ticks_message(self._leader))

    def _publish_link(self) -> None:
        link = states.link_message(self._leader)
        if link is not None:
            self.viewers.publish("link", link)

    def _live_message(self) -> bytes:
        leader = self._leader
        return self._live.make(
            {
                "time_s": round(leader.time_s, 3),
                "mode": leader.mode or "silent",
                "verdict": leader.verdict.as_dict(),
                "viewers": len(self.viewers),
                **states.surfaces(leader),
            }
        )

    def _follow_model(self) -> None:
        """Publish a new model and its completion."""
        update = self._leader.update
        if update is self._update:
            return
        self._update = update
        if update is not None:
            self._history.append((update.time_s, update.progress.value))
        self._publish_completion()
        self._publish_model()

    def _publish_completion(self) -> None:
        points = states.thinned(list(self._history), _SHOWN)
        update = self._update
        shown = (None, "") if update is None else (update.progress, update.faults.sentence())
        header = states.completion_header(shown[0], *self._leader.criteria_s, shown[1])
        arrays = {"time_s": [t for t, _ in points], "value": [v for _, v in points]}
        self.viewers.publish("completion", pack("completion", header, arrays))

    def _publish_model(self) -> None:
        model = self._leader.model
        if model is not None and model is self._model:
            return
        self._model = model
        self.viewers.publish("model", states.model_message(model))

    def note(self, time_s: float, sentence: str) -> None:
        """Show an event with its session time."""
        self._events.append((time_s, sentence))
        self._publish_events()

    def _publish_events(self) -> None:
        events = [[round(time_s, 2), sentence] for time_s, sentence in self._events]
        self.viewers.publish("events", pack("events", {"events": events}, {}))


def _monitor_page(viewers: Viewers, controls: Controls) -> "Page":
    """Return the page ``/monitor/`` with its WebSocket ``/monitor/socket``."""
    files = monitor_files()

    def add(application: web.Application, access: Access) -> None:
        async def look_on(request: web.Request) -> web.StreamResponse:
            if viewers.full:
                raise web.HTTPServiceUnavailable(text="too many viewers\n")
            return await _serve(request, access, viewers, controls)

        application.router.add_get("/monitor/socket", look_on)
        add_page(application, "/monitor", files)

    return add


async def _serve(
    request: web.Request, access: Access, viewers: Viewers, controls: Controls
) -> web.WebSocketResponse:
    """Serve one browser until it disconnects or the session ends."""
    socket, admitted = await open_socket(request, access)
    if not admitted:
        return socket
    if viewers.full:
        await socket.close(code=GOING_AWAY, message=b"too many viewers")
        return socket
    viewer = viewers.add()
    sending = asyncio.create_task(_send(socket, viewer))
    try:
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                break
            viewer.offer(*await controls.answer(message.data))
    finally:
        viewers.remove(viewer)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
    return socket


async def _send(socket: web.WebSocketResponse, viewer: Viewer) -> None:
    with suppress(ConnectionError):
        await viewer.send(socket)
        await socket.close(code=GOING_AWAY, message=b"the session has ended")
