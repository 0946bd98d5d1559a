"""The monitor's part: it publishes changes of the run periodically, and serves the page."""

import asyncio
import logging
from collections import deque
from collections.abc import Coroutine
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from aiohttp import WSCloseCode, WSMsgType, web

from mmt.core.arrays import FloatArray, RecordArray
from mmt.leader.monitoring.controls import Controls
from mmt.leader.part import Part, Session, Tick
from mmt.link.access import Access
from mmt.scene import Monitor
from mmt.web.monitor import states
from mmt.web.monitor.live import MOST_VIEWERS, LiveMessages, Viewer, Viewers
from mmt.web.page_server import add_page, monitor_files, open_socket, pack

if TYPE_CHECKING:
    from mmt.leader.output.stream import StreamedVibration
    from mmt.leader.output.vibration import VibrationPart
    from mmt.link.serving.http import Page
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.updates import ModelUpdate

LOG: Final = logging.getLogger("mmt.leader")

_EVENTS: Final = 50
_HISTORY: Final = 4000
"""Most updates of the model that are kept: over an hour."""
_SHOWN: Final = 1000
"""Approximate number of points of that history in a message."""


class MonitorPart(Part):
    """Shows the running leader on a page, reading its state without blocking.

    Parameters
    ----------
    session
        Session of the run.
    table
        The scene's ``[monitor]``.
    controls
        Carries out the page's orders.
    playout, vibration
        Parts that the page shows; None if left out.
    """

    def __init__(
        self,
        session: Session,
        table: Monitor,
        controls: Controls,
        *,
        playout: "StreamedVibration | None",
        vibration: "VibrationPart | None",
    ) -> None:
        self.live = LiveMessages(session.scene)
        self.viewers = Viewers()
        self._session, self._controls = session, controls
        self._playout, self._vibration = playout, vibration
        self._period_s = 1.0 / table.updates_hz
        self._slow = max(2, round(table.updates_hz))  # calls of `publish_changes` per second
        self._update: ModelUpdate | None = None
        self._model: TextureModel | None = None
        self._history: deque[tuple[float, float]] = deque(maxlen=_HISTORY)
        self._events: deque[tuple[float, str]] = deque(maxlen=_EVENTS)
        self._looks = 0
        self._shown: dict[str, dict[str, Any]] = {}
        self._controls_state: dict[str, Any] = {}
        hello = states.hello_header(session.scene, session.log.session_id)
        self.viewers.publish("hello", pack("hello", hello, {}))
        self._publish_model()
        self._publish_completion()
        self._publish_events()

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the task that reads the session's state and publishes it."""
        return {"monitor": self._run()} if self._session.remote is not None else {}

    async def stop(self) -> None:
        """Give the viewers the last state and the session's outcome."""
        self._end()

    def pages(self) -> "list[Page]":
        """Return the page ``/monitor/`` with its WebSocket ``/monitor/socket``."""
        files = monitor_files()

        def add(application: web.Application, access: Access) -> None:
            look_on = partial(self._serve, access)
            application.router.add_get("/monitor/socket", look_on)
            add_page(application, "/monitor", files)

        return [add]

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Keep frames (n,) for the page."""
        self.live.add_frames(frames)

    def on_output(self, _first_ns: int, _mode: str, vibration_m_s2: FloatArray) -> None:
        """Keep the played vibration (n,) for the page."""
        self.live.add_output(vibration_m_s2)

    def tick(self, tick: Tick) -> None:
        """Keep the state of the hand that moves the robot for the page."""
        self.live.state = tick.moving

    def status(self) -> dict[str, Any]:
        """Return the number of viewers."""
        return {"viewers": len(self.viewers)}

    def on_event(self, event: dict[str, Any], sentence: str | None) -> None:
        """Show the sentence of an event of which the user is told."""
        if sentence is not None:
            self._events.append((event["time_s"], sentence))
            self._publish_events()

    async def _run(self) -> None:
        """Call `publish_changes` until cancelled. An error ends the monitor, not the session."""
        while True:
            await asyncio.sleep(self._period_s)
            try:
                self.publish_changes()
            except Exception:
                LOG.exception("the monitor has failed, the session goes on without it")
                self._end("the monitor has failed")
                return

    def publish_changes(self) -> None:
        """Publish changes since the last call."""
        self._follow_model()
        if not self.viewers:
            self.live.watched = False
            return
        if not self.live.watched:
            self.live.restart()
            self._looks = 0
        state = self._controls.state()
        if state != self._controls_state:
            self._controls_state = state
            self.viewers.publish("controls", pack("controls", state, {}))
        for shown in self._session.parts.verbs("shown"):
            for kind, header in shown().items():
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

    def _end(self, problem: str | None = None) -> None:
        """Send the viewers the last state and the outcome of the session, and stop."""
        if not self.viewers.ended:
            if self.viewers and problem is None:
                self.publish_changes()
                self._publish_ticks()
                self._publish_link()
            verdict = self._session.verdict().as_dict()
            shown = self._session.ending.outcome if problem is None else problem
            self.viewers.publish("end", pack("end", {"outcome": shown, "verdict": verdict}, {}))
        self.live.watched = False
        self.viewers.close()

    def _publish_ticks(self) -> None:
        playout = self._playout
        delay_ms = None if playout is None else playout.buffer.statistics().delay_ms
        self.viewers.publish("ticks", states.ticks_message(self._session.ticker, delay_ms))

    def _publish_link(self) -> None:
        remote = self._session.remote
        if remote is not None:
            self.viewers.publish("link", states.link_message(remote.server))

    def _live_message(self) -> bytes:
        session, vibration = self._session, self._vibration
        return self.live.make(
            {
                "time_s": round(session.time_s(), 3),
                "mode": "silent" if vibration is None else vibration.switch.mode,
                "verdict": session.verdict().as_dict(),
                "viewers": len(self.viewers),
                **states.surfaces(self._controls.surfaces),
            }
        )

    def _follow_model(self) -> None:
        """Publish a new model and its completion."""
        update = self._session.log.update
        if update is self._update:
            return
        self._update = update
        if update is not None:
            self._history.append((update.time_s, update.progress.value))
        self._publish_completion()
        self._publish_model()

    def _publish_completion(self) -> None:
        points = states.thinned(list(self._history), _SHOWN)
        update, log = self._update, self._session.log
        progress, faults = None, ""
        if update is not None:
            progress, faults = update.progress, update.faults.sentence()
        header = states.completion_header(progress, log.start_s, log.stop_s, faults)
        arrays = {"time_s": [t for t, _ in points], "value": [v for _, v in points]}
        self.viewers.publish("completion", pack("completion", header, arrays))

    def _publish_model(self) -> None:
        model = self._controls.model
        if model is not None and model is self._model:
            return
        self._model = model
        self.viewers.publish("model", states.model_message(model))

    def _publish_events(self) -> None:
        events = [[round(time_s, 2), sentence] for time_s, sentence in self._events]
        self.viewers.publish("events", pack("events", {"events": events}, {}))

    async def _serve(self, access: Access, request: web.Request) -> web.WebSocketResponse:
        """Serve one browser until it disconnects or the session ends."""
        viewers = self.viewers
        socket, admitted = await open_socket(request, access)
        if not admitted:
            return socket
        if viewers.ended:
            await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the session has ended")
            return socket
        if len(viewers) >= MOST_VIEWERS:
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too many viewers")
            return socket
        viewer = viewers.add()
        sending = asyncio.create_task(_send(socket, viewer))
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                viewer.offer(*await self._controls.answer(message.data))
        finally:
            viewers.remove(viewer)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
        return socket


async def _send(socket: web.WebSocketResponse, viewer: Viewer) -> None:
    with suppress(ConnectionError):
        await viewer.send(socket)
        await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the session has ended")
