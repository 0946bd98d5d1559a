"""The leader: one event loop that ticks, receives, models and records."""

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final

from mmt.core.bounds import check
from mmt.core.errors import MmtError
from mmt.core.output import logs
from mmt.core.running.process import prefer_even_ticks
from mmt.core.running.ticking import Ticker
from mmt.leader.part import Session, Tick
from mmt.leader.parts import build_parts
from mmt.leader.remote import RemoteFollower
from mmt.leader.reports import LeaderStatus, LeaderSummary, RunHealth, summarise
from mmt.leader.run_log import LOG
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.core.frames import FeedbackSide
    from mmt.leader.modelling.process import ModellingProcess

_STATUS_PERIOD_S: Final = 0.2
_STATUS_FIELDS: Final = {item.name for item in fields(LeaderStatus)}


class Leader:
    """Run one scene's leader from start to summary, on the running event loop.

    Its parts (`mmt.leader.parts`) do the work; the leader calls their verbs.

    Parameters
    ----------
    scene
        The scene to run.
    on_status
        Called five times a second with the live status.
    on_event
        Called with a sentence for the user about each event.
    modelling
        The modelling process, if launched before; else it is launched when the parts connect.

    Raises
    ------
    MmtError
        A part cannot be built; the message says which and why.

    Examples
    --------
    >>> async def main() -> None:
    ...     summary = await Leader(Scene()).run()
    """

    def __init__(
        self,
        scene: Scene,
        *,
        on_status: Callable[[LeaderStatus], None] | None = None,
        on_event: Callable[[str], None] | None = None,
        modelling: "ModellingProcess | None" = None,
    ) -> None:
        check("scene", scene, Scene)
        self.scene = scene
        self._on_status = on_status or (lambda _: None)
        self.session = Session(scene, on_event, lambda: self.time_s)
        self.log = self.session.log
        self.ending = self.session.ending
        self.ticks = 0
        """Ticks so far, missed ones included."""
        self.parts = build_parts(self.session, modelling=modelling)
        self.remote: RemoteFollower | None = None
        """The follower, or None if the scene has no link."""
        if scene.link is not None:
            self.session.remote = self.remote = remote = RemoteFollower(
                scene,
                scene.link,
                self.log,
                self.session.journal,
                self.ending,
                call=self.parts.call,
                feedback=self._extra_handler(),
            )
            if self.parts.modelling is not None:
                missing = remote.backfill.missing
                self.parts.modelling.segmenting.first_missing = lambda: missing.first
        self.health = RunHealth(self.session, self.parts.completing, self.parts.vibration)
        self.session.verdict = self.health.verdict
        self.ticker = self.session.ticker = Ticker(self.session.period_ns, self._tick)
        self._now = Tick()
        self._steps: list[Callable[[Tick], None]] = []

    def _extra_handler(self) -> "FeedbackSide | None":
        """Return the handler of the follower's further event: force feedback, hand, or None."""
        displayed, hand = self.parts.force_feedback, self.parts.hand
        if displayed is not None and displayed.feedback.event is not None:
            return displayed.feedback
        return hand.contact if hand is not None and self.scene.reports_contact else None

    @property
    def port(self) -> int | None:
        """The port that is listened on, or None without a link."""
        return None if self.remote is None else self.remote.server.port

    @property
    def time_s(self) -> float:
        """Session time: that of the newest frame, or of the ticks if there is no link."""
        if self.remote is not None:
            return self.remote.time_s
        return self.ticks / self.scene.session.rate_hz

    async def run(self, on_ready: Callable[[], None] | None = None) -> LeaderSummary:
        """Listen, run until the session ends, and return the summary.

        A fault during the session, such as a failed device, ends it; the summary says so. If a
        recording fails, as on a full disk, the session goes on without it. Recorded data are
        kept whatever happens.

        Parameters
        ----------
        on_ready
            Called once a follower may connect.

        Raises
        ------
        MmtError
            The session cannot begin: a device does not answer, or the port or the recording's
            file cannot be used.
        """
        tasks: list[asyncio.Task[None]] = []
        try:
            await self._open()
            if not self.ending.reached:
                self._start_tasks(tasks)
                if on_ready is not None:
                    on_ready()
                await self._until_ended(tasks)
                if self.ending.fault is None:
                    for finish in self.parts.verbs("finish"):
                        await finish()
        finally:
            duration_s = self.time_s
            self.ticker.stop()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._close()
        return summarise(
            self.session,
            self.ticker.statistics,
            outcome=self.ending.outcome,
            duration_s=duration_s,
        )

    def stop(self, outcome: str = "stopped") -> None:
        """End the session; `run` returns with the summary."""
        self.ending.stop(outcome)

    def reset_model(self) -> None:
        """Forget the model and return to streamed vibration, for a new surface."""
        self.parts.completing.reset()

    def status(self) -> LeaderStatus:
        """Return the live status."""
        remote = self.remote
        link = remote.server.statistics if remote is not None else None
        ticks = self.ticker.statistics
        figures: dict[str, Any] = {
            "phase": "streaming" if remote is None or remote.connected else "waiting",
            "time_s": self.time_s,
            "frames": link.frames if link is not None else 0,
            "frames_lost": link.lost if link is not None else 0,
            "ticks": ticks.ticks,
            "late_ticks": round((ticks.late_share_1ms or 0.0) * ticks.ticks),
            "tick_p99_ms": ticks.period_p99_ms,
        }
        for part in self.parts:
            figures |= part.status()
        figures["verdict"] = self.health.verdict().as_dict()
        more = {name: figures.pop(name) for name in figures.keys() - _STATUS_FIELDS}
        return LeaderStatus(**figures, more=more)

    # --- lifetime

    async def _open(self) -> None:
        await self.ending.call_in_thread(self.parts.connect, self.parts.close)
        if self.ending.reached:
            return
        self._steps = self.parts.verbs("tick")
        if self.remote is not None:
            await self.remote.listen(self._pages(), self.parts.verbs("on_frames"))
        self.parts.call("begin")
        prefer_even_ticks()

    def _pages(self) -> list[Any]:
        from mmt.link.serving.http import health_page

        served = [health_page(lambda: self.health.as_dict(self.status()))]
        return served + [page for pages in self.parts.verbs("pages") for page in pages()]

    def _start_tasks(self, tasks: list[asyncio.Task[None]]) -> None:
        tasks.append(asyncio.create_task(self._report_status()))
        for part_tasks in self.parts.verbs("tasks"):
            for name, coroutine in part_tasks().items():
                tasks.append(asyncio.create_task(coroutine, name=name))
        self.ticker.start()
        tasks.append(asyncio.create_task(self.ticker.wait()))

    async def _until_ended(self, tasks: list[asyncio.Task[None]]) -> None:
        """Wait for the end, or for a task that fails."""
        ended = asyncio.create_task(self.ending.wait())
        running, failed = {ended, *tasks}, False
        try:
            while not (ended.done() or failed):
                done, running = await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
                for error in [task.exception() for task in done if not task.cancelled()]:
                    if isinstance(error, Exception):
                        self.ending.fail(error)
                        failed = True
        finally:
            ended.cancel()
        if self.remote is not None:
            await self.remote.dismiss()
        self.ending.raise_unexpected()

    async def _close(self) -> None:
        problems = await self.parts.stop()
        if self.remote is not None:
            await self.remote.close()
        for problem in (*problems, *self.parts.close()):
            self.session.journal.say(problem)

    # --- while it runs

    def _tick(self, elapsed: int) -> None:
        tick, remote = self._now, self.session.remote
        tick.now_ns = time.monotonic_ns()
        tick.elapsed = elapsed
        self.ticks += elapsed
        if remote is None:
            tick.streaming = tick.begun = True
        else:
            tick.streaming, tick.begun = remote.connected, remote.has_begun
        for step in self._steps:
            step(tick)
        if remote is not None:
            if tick.streaming:
                remote.backfill.tick(elapsed)
        elif self.time_s >= self.scene.session.duration_s:
            self.ending.stop("completed")

    async def _report_status(self) -> None:
        polls = self.parts.verbs("poll")
        while True:
            await asyncio.sleep(_STATUS_PERIOD_S)
            self.health.update()
            status = self.status()
            self._on_status(status)
            if LOG.isEnabledFor(logging.DEBUG):
                LOG.debug("status", extra=logs.details(status=status.as_dict()))
            if self.remote is not None:
                self.remote.clock_notes.record_if_due()
            try:
                for look in polls:
                    look()
            except MmtError as error:
                self.ending.fail(error)
