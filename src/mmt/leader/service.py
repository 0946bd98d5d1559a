"""The leader service: one event loop that ticks, receives, models and records."""

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from mmt.core import logs
from mmt.core.ending import Ending
from mmt.core.errors import MmtError
from mmt.core.process import prefer_even_ticks
from mmt.core.ticking import Ticker
from mmt.leader.completing import ModelOutput
from mmt.leader.journal import LOG, Journal
from mmt.leader.parts import LeaderParts, build_parts
from mmt.leader.remote import RemoteFollower
from mmt.leader.summary import LeaderStatus, LeaderSummary, RunLog, summarise
from mmt.leader.tick import LeaderTick
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.texture.online.work import ModelUpdate
    from mmt.web.monitor.running import LeaderMonitor

_STATUS_PERIOD_S: Final = 0.2
_LAST_UPDATES_S: Final = 1.0


class LeaderService:
    """Run one scene's leader from start to summary.

    Parameters
    ----------
    scene
        What to run.
    on_status
        Called five times a second with the live status.
    on_event
        Called with a sentence whenever something happens that a person wants to know.

    Raises
    ------
    MmtError
        A part cannot be built; the message says which and why.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        on_status: Callable[[LeaderStatus], None] | None = None,
        on_event: Callable[[str], None] | None = None,
    ) -> None:
        self.scene = scene
        self._on_status = on_status or (lambda _: None)
        self.ending = Ending("completed")
        self.parts: LeaderParts = build_parts(scene, self._on_update)
        self.log = RunLog()
        self._journal = Journal(self.parts, on_event or (lambda _: None), lambda: self.time_s)
        self.parts.watch(self._journal.event)
        self.models = ModelOutput(self.parts, self.log, self._journal.event)
        self.remote: RemoteFollower | None = None
        if scene.link is not None:
            self.remote = RemoteFollower(scene, self.parts, self.log, self._journal, self.ending)
        period_ns = round(1e9 / scene.session.rate_hz)
        self._work = LeaderTick(self.parts, self.log, self._journal, self.remote, period_ns)
        self.ticker = Ticker(period_ns, self._tick)
        self.monitor = self._make_monitor()

    @property
    def port(self) -> int | None:
        """The port that is listened on, None without a link."""
        server = self.remote.server if self.remote is not None else None
        return None if server is None else server.port

    @property
    def time_s(self) -> float:
        """Session time: that of the newest frame, or of the ticks where there is no link."""
        if self.remote is not None:
            return self.remote.time_s
        return self._work.ticks / self.scene.session.rate_hz

    async def run(self, on_ready: Callable[[], None] | None = None) -> LeaderSummary:
        """Listen, run until the session ends, and return the summary.

        A fault in its midst, such as a device that fails or a full disk, ends the session;
        the summary says so. Everything that was recorded is kept whatever happens.

        Raises
        ------
        MmtError
            The session cannot begin: a device does not answer, the port or the recording's
            file cannot be had.
        """
        parts = self.parts
        tasks: list[asyncio.Task[None]] = []
        try:
            await self._open()
            tasks.append(asyncio.create_task(self._report_status()))
            if parts.modelling is not None:
                tasks += [
                    asyncio.create_task(coroutine, name=name)
                    for name, coroutine in parts.modelling.tasks().items()
                ]
            if parts.warming is not None:
                tasks.append(asyncio.create_task(parts.warming.run()))
            self.ticker.start()
            tasks.append(asyncio.create_task(self.ticker.wait()))
            if on_ready is not None:
                on_ready()
            await self._until_ended(tasks)
            if parts.modelling is not None and self.ending.fault is None:
                await parts.modelling.finish(_LAST_UPDATES_S)
        finally:
            duration_s = self.time_s
            self.ticker.stop()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._close()
        return self._summary(duration_s)

    def stop(self, outcome: str = "stopped") -> None:
        """End the session; `run` returns with the summary."""
        self.ending.stop(outcome)

    def faults(self) -> list[str]:
        """Return what is not as it should be, a sentence each."""
        recorder = self.parts.recorder
        found = {
            f"the session has ended: {self.ending.outcome}": self.ending.reached,
            "the follower was lost": self.ending.awaits_peer,
            f"recording: {recorder.error if recorder else None}": recorder and recorder.error,
        }
        lost = [device.problem for device in self.parts.may_be_lost if device.problem]
        return [sentence for sentence, holds in found.items() if holds] + lost

    def reset_model(self) -> None:
        """Forget the model and return to streamed vibration, for a new surface."""
        self.models.reset(self.time_s)

    def status(self) -> LeaderStatus:
        """Return the live status."""
        remote, playout, update = self.remote, self.parts.playout, self.log.update
        link = remote.statistics if remote is not None else None
        ticks = self.ticker.statistics
        return LeaderStatus(
            phase="streaming" if remote is None or remote.connected else "waiting",
            mode=self._work.mode,
            time_s=self.time_s,
            frames=link.frames if link is not None else 0,
            frames_lost=link.lost if link is not None else 0,
            samples=update.samples if update is not None else 0,
            distance=update.distance if update is not None else None,
            completion=str(update.progress) if update is not None else None,
            ticks=ticks.ticks,
            late_ticks=round((ticks.late_share_1ms or 0.0) * ticks.ticks),
            tick_p99_ms=ticks.period_p99_ms,
            playout_delay_ms=playout.statistics().delay_ms if playout is not None else None,
        )

    # --- lifetime

    def _make_monitor(self) -> "LeaderMonitor | None":
        if self.scene.monitor is None:
            return None
        from mmt.web.monitor.running import LeaderMonitor

        monitor = LeaderMonitor(self, self._journal, self.scene.monitor)
        self.parts.tap = monitor.tap
        return monitor

    async def _open(self) -> None:
        self.parts.connect()
        if self.remote is not None:
            from mmt.leader.metrics import pages

            await self.remote.listen(pages(self))
            if self.monitor is not None:
                self.monitor.start()
        self.parts.begin_recording(self.log.session_id)
        prefer_even_ticks()

    async def _until_ended(self, tasks: list[asyncio.Task[None]]) -> None:
        """Wait for the end, or for a task that fails."""
        ended = asyncio.create_task(self.ending.wait())
        try:
            await asyncio.wait([ended, *tasks], return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
        for task in tasks:
            error = task.exception() if task.done() and not task.cancelled() else None
            if isinstance(error, Exception):
                self.ending.fail(error)
        if self.remote is not None:
            await self.remote.dismiss()
        self.ending.raise_unexpected()

    async def _close(self) -> None:
        if self.monitor is not None:
            await self.monitor.stop()
        if self.remote is not None:
            await self.remote.close()
        self.models.record_last()
        for problem in [*self.models.save_surfaces(), *self.parts.close()]:
            self._journal.say(problem)

    # --- while it runs

    def _tick(self, elapsed: int) -> None:
        self._work.step(elapsed)
        if self.remote is None and self.time_s >= self.scene.session.duration_s:
            self.ending.stop("completed")

    def _on_update(self, update: "ModelUpdate", seconds: float) -> None:
        self.models.update(update, seconds)

    async def _report_status(self) -> None:
        while True:
            await asyncio.sleep(_STATUS_PERIOD_S)
            status = self.status()
            self._on_status(status)
            if LOG.isEnabledFor(logging.DEBUG):
                LOG.debug("status", extra=logs.details(status=status.as_dict()))
            if self.remote is not None:
                self.remote.look()
            recorder = self.parts.recorder
            if recorder is not None and recorder.error is not None:
                self.ending.fail(MmtError(f"recording {recorder.path}: {recorder.error}"))

    def _summary(self, duration_s: float) -> LeaderSummary:
        remote = self.remote
        return summarise(
            self.log,
            self.parts,
            outcome=self.ending.outcome,
            name=self.scene.session.name,
            duration_s=duration_s,
            link=remote.statistics if remote is not None else None,
            clock_offset_ns=remote.clock_offset_ns if remote is not None else None,
            ticks=self.ticker.statistics,
            backfill=remote.backfill.summary if remote is not None else {},
        )
