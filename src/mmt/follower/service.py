"""The follower service: one event loop that ticks, measures and streams."""

import asyncio
import logging
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

from mmt.core.bounds import check
from mmt.core.errors import FAILED, MmtError
from mmt.core.extras import require
from mmt.core.output.logs import details_for_log
from mmt.core.running.ending import Ending
from mmt.core.running.process import ProcessCost, ProcessMeter, prefer_even_ticks
from mmt.core.running.ticking import Ticker
from mmt.core.verdict import has_failed
from mmt.follower.guarded_source import GuardedSource
from mmt.follower.sources import build_source
from mmt.link.access import Access
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents, emulated_network
from mmt.link.protocol import FollowerHello
from mmt.scene import Link, Scene

if TYPE_CHECKING:
    from mmt.core.arrays import RecordArray
    from mmt.follower.feedback import FollowerFeedback
    from mmt.link.serving.http import Listener

LOG: Final = logging.getLogger("mmt.follower")


@dataclass(frozen=True)
class FollowerSummary:
    """Summary of the follower's session.

    ``outcome`` is "source ended", "leader stopped (...)", "stopped" (by the user),
    "leader lost", or "leader failed: ..." or "failed: ..." with the fault.
    """

    outcome: str
    session: dict[str, Any]
    link: dict[str, Any]
    ticks: dict[str, Any]
    process: dict[str, Any]
    commands: dict[str, Any] = field(default_factory=dict)
    backfill: dict[str, Any] = field(default_factory=dict)
    devices: dict[str, Any] = field(default_factory=dict)
    feedback: dict[str, Any] = field(default_factory=dict)

    @property
    def problem(self) -> str | None:
        """Why the run failed, or None if it did not."""
        return self.outcome if has_failed(self.outcome) else None

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as a dictionary."""
        return asdict(self)


class Follower:
    """Streams one scene's source to the leader, on the running event loop.

    ``await Follower(scene).run()`` is a whole session; `stop` ends it from elsewhere.

    Parameters
    ----------
    scene
        The scene to run; it must have a source.
    url
        Address of the leader, ``http://host:port``; None takes the scene's ``[link]``.
    on_event
        Called with a sentence for the user about each event.
    on_session
        Called with the leader's name of the session, as soon as it is known.
    """

    def __init__(
        self,
        scene: Scene,
        url: str | None = None,
        *,
        on_event: Callable[[str], None] | None = None,
        on_session: Callable[[str], None] | None = None,
    ) -> None:
        check("scene", scene, Scene)
        self.scene = scene
        self._link = scene.link or Link()
        self.url = url or self._link.url()
        self._tell = on_event or (lambda _: None)
        self._on_session = on_session or (lambda _: None)
        self.session_id: str | None = None
        self._access = Access.from_settings(self._link)
        self.source = build_source(scene)
        feedback = _build_feedback(scene)
        self._guarded = GuardedSource(scene, self.source, feedback, self._report, self._send)
        self.ending = Ending("source ended")
        self.client = self._make_client(feedback)
        self.ticker = Ticker(round(1e9 / scene.session.rate_hz), self._tick)

    async def run(self, on_ready: Callable[[], None] | None = None) -> FollowerSummary:
        """Connect, stream until the source or the leader ends, and return the summary.

        A fault during the session, such as a failed device, ends it; the leader is told, and the
        summary says so.

        Raises
        ------
        MmtError
            The session cannot begin: the leader does not answer, or refuses.
        """
        prefer_even_ticks()
        if on_ready is not None:
            on_ready()
        meter = ProcessMeter()
        listener: Listener | None = None
        try:
            listener = await self._serve_metrics()
            await self._connect()
            if not self.ending.reached:
                meter = ProcessMeter()
                await self._stream()
        finally:
            self.ticker.stop()
            self.ending.cancel_timeout()
            await self.client.end(self.ending.outcome)
            await self.client.disconnect()
            if listener is not None:
                await listener.stop()
            self._close_source()
        return self._summary(meter.read())

    @property
    def commands(self) -> dict[str, Any]:
        """Counts of the command guard, empty if a recording is replayed."""
        guard = self._guarded.guard
        return guard.summary if guard is not None else {}

    def stop(self, outcome: str = "stopped") -> None:
        """End the session; `run` returns with the summary."""
        self.ending.stop(outcome)

    def _make_client(self, feedback: "FollowerFeedback | None") -> FollowerClient:
        scene = self.scene
        return FollowerClient(
            self.url,
            FollowerHello(
                channels=scene.channels(),
                source=scene.source or "",
                rate_hz=scene.session.rate_hz,
                frames_per_message=self._link.frames_per_message,
                annotations=self.source.annotations,
                keep_frames=scene.keep_frames(),
                run_id=uuid.uuid4().hex,
                extra="" if feedback is None else feedback.event or "",
                samples_per_frame=scene.session.samples_per_frame,
            ),
            FollowerEvents(
                on_commands=self._guarded.receive,
                on_open=self._guarded.connect,
                on_session=self._take_session,
                on_stop=self._on_stop,
                on_lost=self._on_lost,
                on_jump=lambda jump: self._say(f"clocks: the leader's {jump.describe()}"),
                on_error=self.ending.fail,
            ),
            network=emulated_network(scene, "up", self._say),
            access=self._access,
            clock_hz=self._link.clock_hz,
            extra=feedback,
        )

    def _say(self, sentence: str) -> None:
        self._tell(sentence)
        LOG.info(sentence, extra=details_for_log())

    def _report(self, sentence: str) -> None:
        """Report what the robot does to the user and to the leader, which records it."""
        self._say(sentence)
        self.client.send_event(sentence)

    def _take_session(self, session_id: str) -> None:
        if session_id != self.session_id:
            self.session_id = session_id
            self._on_session(session_id)
            LOG.info("connected to the leader", extra=details_for_log())

    async def _serve_metrics(self) -> "Listener | None":
        metrics = self.scene.metrics
        if metrics is None or metrics.follower_port is None:
            return None
        require("prometheus_client")
        from mmt.follower.metrics import serve_metrics

        return await serve_metrics(
            self.client,
            self.ticker,
            lambda: (self.session_id, self.commands),
            metrics.follower_port,
            self._access,
        )

    async def _connect(self) -> None:
        """Connect, unless the user stops the session first."""
        patience_s = self._link.patience_s
        self._tell(f"looking for the leader at {self.url}, for {patience_s:g} s at most")
        connecting = asyncio.create_task(self.client.connect(patience_s))
        if await self.ending.wait_or_cancel(connecting):
            self._tell("connected to the leader")

    async def _stream(self) -> None:
        """Stream until the end, or until the source fails."""
        ended = asyncio.create_task(self.ending.wait())
        try:
            await self._open_devices()
            if not self.ending.reached:
                self.source.start(time.monotonic_ns())
                self.ticker.start()
                ticking = asyncio.create_task(self.ticker.wait())
                await asyncio.wait([ended, ticking], return_when=asyncio.FIRST_COMPLETED)
                self.ticker.stop()
                await ticking
        except Exception as error:  # noqa: BLE001 - raised below, unless it is an MmtError
            self.ending.fail(error)
        finally:
            ended.cancel()
        self.ending.raise_unexpected()

    async def _open_devices(self) -> None:
        """Connect devices in a thread: some take seconds, and the link must be served meanwhile."""
        if (devices := self._guarded.of_devices) is not None:
            await self.ending.call_in_thread(devices.open, devices.close)

    def _close_source(self) -> None:
        """Close the source; an error in closing a device must not hide an earlier error."""
        try:
            self.source.close()
        except MmtError as error:
            self._say(str(error))

    def _tick(self, elapsed: int) -> None:
        self._send(*self._guarded.step(elapsed))
        if self.source.finished:
            self.ending.stop("source ended")

    def _send(self, frames: "RecordArray", news: "RecordArray | None") -> None:
        if news is not None:
            self.client.send_extra(news)
        if len(frames):
            self.client.send_frames(frames)

    def _on_stop(self, reason: str) -> None:
        self._say(f"the leader ended the session: {reason}")
        self.stop(f"leader {reason}" if reason.startswith(FAILED) else f"leader stopped ({reason})")

    def _on_lost(self, reason: str) -> None:
        patience_s = self._link.patience_s
        self._say(f"leader lost ({reason}), trying again for {patience_s:g} s")
        self.ending.start_timeout(patience_s, self._give_up)

    def _give_up(self) -> None:
        if not self.client.connected:
            self.ending.stop("leader lost")

    def _summary(self, cost: ProcessCost) -> FollowerSummary:
        return FollowerSummary(
            outcome=self.ending.outcome,
            session={"id": self.session_id},
            link=asdict(self.client.statistics),
            ticks=asdict(self.ticker.statistics),
            process=cost.as_dict(),
            backfill=self.client.frames.backfill,
            **self._guarded.summary,
        )


def _build_feedback(scene: Scene) -> "FollowerFeedback | None":
    feedback = scene.force_feedback
    if not scene.reports_contact and (feedback is None or feedback.method == "streamed"):
        return None
    from mmt.follower.feedback import build_feedback

    return build_feedback(scene)
