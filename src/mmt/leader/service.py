"""The leader service: one event loop that ticks, receives, models and records."""

import asyncio
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt import logs
from mmt.arrays import RecordArray
from mmt.devices.protocols import InterfaceState
from mmt.errors import FAILED, MmtError
from mmt.leader.backfill import Backfill
from mmt.leader.clock_notes import ClockNotes
from mmt.leader.commands import MotionCommands
from mmt.leader.models import ModelUse
from mmt.leader.numbering import SessionNumbering
from mmt.leader.parts import LeaderParts, build_parts
from mmt.leader.summary import LeaderStatus, LeaderSummary, RunLog, summarise
from mmt.process import ProcessMeter, prefer_even_ticks
from mmt.scene import LARGEST_SPEED, Scene
from mmt.ticking import Ticker

if TYPE_CHECKING:
    from mmt.link.clock_offset import ClockJump
    from mmt.link.extra import ExtraEvent
    from mmt.link.network import EmulatedNetwork
    from mmt.link.protocol import FollowerHello
    from mmt.link.server import LeaderServer
    from mmt.ranges import Range
    from mmt.texture.modelling import ModelUpdate

LOG: Final = logging.getLogger("mmt.leader")

_STATUS_PERIOD_S: Final = 0.2
_STREAM_REST_TICKS: Final = 100
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
        self._say = on_event or (lambda _: None)
        self._period_ns = round(1e9 / scene.session.rate_hz)
        self.log = RunLog()
        self.parts: LeaderParts = build_parts(scene, self._on_update)
        self._models = ModelUse(self.parts, self.log, self._event)
        self.server: LeaderServer | None = None
        self._clock_notes: ClockNotes | None = None
        self.ticker = Ticker(self._period_ns, self._tick)
        self._ended = asyncio.Event()
        self._fault: Exception | None = None
        self._last_tick_ns = 0
        self._ticks = 0
        self._fastest = LARGEST_SPEED if scene.replay is not None else 1.0
        self._numbering = SessionNumbering(self._period_ns, self._fastest)
        self._commands = MotionCommands(self._numbering)
        self.backfill = Backfill(
            scene.keep_frames(), self._numbering, self.parts, self._request_frames, self._note
        )
        self._mode = self.parts.switch.mode if self.parts.switch is not None else "silent"
        self._meter = ProcessMeter()
        self._lost_deadline: asyncio.TimerHandle | None = None
        self._rest_ticks = 0

    @property
    def port(self) -> int | None:
        """The port that is listened on, None without a link."""
        return None if self.server is None else self.server.port

    @property
    def time_s(self) -> float:
        """Session time: that of the newest frame, or of the ticks where there is no link."""
        periods = self._ticks if self.scene.link is None else self._numbering.frames
        return periods / self.scene.session.rate_hz

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
            parts.connect()
            if self.scene.link is not None:
                await self._listen()
            parts.begin_recording(self.log.session_id)
            prefer_even_ticks()
            tasks.append(asyncio.create_task(self._report_status()))
            if parts.modelling is not None:
                tasks.append(asyncio.create_task(parts.modelling.run()))
            self.ticker.start()
            tasks.append(asyncio.create_task(self.ticker.wait()))
            if on_ready is not None:
                on_ready()
            await self._until_ended(tasks)
            self.backfill.close()
            if parts.modelling is not None and self._fault is None:
                await parts.modelling.finish(_LAST_UPDATES_S)
        finally:
            duration_s = self.time_s
            self.ticker.stop()
            self._expect_return(None)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            if self.server is not None:
                await self.server.stop()
            if self._clock_notes is not None:
                self._clock_notes.look(last=True)
            self._models.record_last()
            for problem in parts.close():
                self._say(problem)
        return self._summary(duration_s)

    def stop(self, outcome: str = "stopped") -> None:
        """End the session; `run` returns with the summary."""
        if not self._ended.is_set():
            self.log.outcome = outcome
            self._ended.set()

    def faults(self) -> list[str]:
        """Return what is not as it should be, a sentence each."""
        recorder = self.parts.recorder
        found = {
            f"the session has ended: {self.log.outcome}": self._ended.is_set(),
            "the follower was lost": self._lost_deadline is not None,
            f"recording: {recorder.error if recorder else None}": recorder and recorder.error,
        }
        return [sentence for sentence, holds in found.items() if holds]

    def reset_model(self) -> None:
        """Forget the model and return to streamed vibration, for a new surface."""
        self._models.reset(self.time_s)

    async def _until_ended(self, tasks: list[asyncio.Task[None]]) -> None:
        """Wait for the end, or for a task that fails."""
        ended = asyncio.create_task(self._ended.wait())
        try:
            await asyncio.wait([ended, *tasks], return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
        for task in tasks:
            error = task.exception() if task.done() and not task.cancelled() else None
            if isinstance(error, Exception):
                self._fail(error)
        if self.server is not None:
            await self.server.request_stop(self.log.outcome)
        if self._fault is not None and not isinstance(self._fault, MmtError):
            raise self._fault  # no fault of devices or files, but a mistake in the program

    def _fail(self, fault: Exception) -> None:
        """End the session because something in it does not work."""
        self._fault = self._fault or fault
        self.stop(f"{FAILED}{fault}")

    async def _listen(self) -> None:
        from mmt.leader.metrics import pages
        from mmt.link.server import LeaderEvents, LeaderServer

        assert self.scene.link is not None  # noqa: S101 - the caller has looked
        self.server = LeaderServer(
            self.scene.link,
            self.scene.channels(),
            LeaderEvents(
                on_follower=self._on_follower,
                on_frames=self._on_frames,
                on_end=self._on_end,
                on_lost=self._on_lost,
                on_jump=self._on_jump,
                on_backfill=self.backfill.take,
                on_gone=self.backfill.gone,
                on_settle=self.backfill.settle,
                on_error=self._fail,
            ),
            fastest=self._fastest,
            session_id=self.log.session_id,
            network=self._emulated_network(),
            pages=pages(self),
            extra=self._extra_event(),
        )
        self._clock_notes = ClockNotes(self.server.clock, self._record_event)
        await self.server.start()

    def _emulated_network(self) -> "EmulatedNetwork | None":
        if self.scene.network is None:
            return None
        from mmt.link.network import EmulatedNetwork

        return EmulatedNetwork(self.scene.network, "down", self.scene.session.seed, self._event)

    def _request_frames(self, ranges: "list[Range]") -> None:
        if self.server is not None:
            self.server.request_frames(ranges)

    def _extra_event(self) -> "ExtraEvent | None":
        feedback = self.parts.feedback
        if feedback is None or feedback.event is None or feedback.dtype is None:
            return None
        from mmt.link.extra import ExtraEvent

        return ExtraEvent(feedback.event, feedback.dtype, feedback.take_records, feedback.restart)

    # --- what the link reports

    def _on_follower(self, hello: "FollowerHello") -> None:
        self._expect_return(None)
        self._numbering.reconnect(hello.run_id)
        self.backfill.connect(hello)
        if self.parts.recorder is not None and hello.annotations:
            self.parts.recorder.attach_annotations(hello.annotations)
        self._event(f"follower connected ({hello.source})")

    def _on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        parts = self.parts
        if not self._numbering.frames:
            self._meter = ProcessMeter()
        if self.backfill.settled:
            self.backfill.take(frames)
            return
        newest = self._numbering.newest
        frames, left_out = self._numbering.take(frames, arrival_ns)
        if left_out:
            self.backfill.started_anew()
            self._event(f"the follower started anew, {left_out} frames are missing before it")
        if 0 <= newest != self._numbering.newest - len(frames) - left_out:
            self.backfill.missing.jumped(newest + left_out, frames)
        self._rest_ticks = 0
        if parts.recorder is not None:
            parts.recorder.record_frames(frames)
        if parts.streamed_vibration is not None:
            parts.streamed_vibration.take(frames, arrival_ns)
        if parts.streamed_motion is not None:
            parts.streamed_motion.take(frames)
        if parts.feedback is not None:
            parts.feedback.take(frames)
        if parts.modelling is not None:
            parts.modelling.take(frames)
        if self.time_s >= self.scene.session.duration_s:
            self.stop("completed")

    def _on_end(self, reason: str) -> None:
        self._event(f"follower ended: {reason}")
        self.stop(f"follower {reason}" if reason.startswith(FAILED) else "source ended")

    def _on_lost(self, reason: str) -> None:
        assert self.scene.link is not None  # noqa: S101 - there is a link to lose
        if self._ended.is_set():
            return
        patience_s = self.scene.link.patience_s
        self._event(f"follower lost ({reason}), waiting {patience_s:g} s for its return")
        if self.parts.streamed_motion is not None:
            self.parts.streamed_motion.rest()
        self._expect_return(patience_s)

    def _on_jump(self, jump: "ClockJump") -> None:
        if self._clock_notes is not None:
            sentence, details = self._clock_notes.jumped(jump)
            self._event(sentence, **details)

    def _expect_return(self, within_s: float | None) -> None:
        """Give up on a follower that is not back in time; None expects nothing."""
        if self._lost_deadline is not None:
            self._lost_deadline.cancel()
            self._lost_deadline = None
        if within_s is not None:
            loop = asyncio.get_running_loop()
            self._lost_deadline = loop.call_later(within_s, self.stop, "follower lost")

    # --- what happens every millisecond

    def _tick(self, elapsed: int) -> None:
        now_ns = time.monotonic_ns()
        parts = self.parts
        self._ticks += elapsed
        if parts.modelling is not None and parts.modelling.working and self._last_tick_ns:
            late_ns = now_ns - self._last_tick_ns - self._period_ns
            self.log.late_while_modelling.add(max(0, late_ns))
        self._last_tick_ns = now_ns
        streaming = self.scene.link is None or self._streaming
        state = self._read_hand(elapsed, now_ns) if streaming else None
        if streaming:
            self.backfill.tick(elapsed)
        if parts.feedback is not None:
            news = parts.feedback.tick(elapsed, state)  # without a stream the force must fade
            if news is not None and self.server is not None:
                self.server.send_extra(news)
        if self.scene.link is not None and not self._numbering.frames:
            return
        if parts.switch is not None and parts.actuator is not None:
            speed_mm_s, force_n = self._drive(state, elapsed)
            vibration = parts.switch.render(
                now_ns, np.full(elapsed, speed_mm_s), np.full(elapsed, force_n)
            )
            parts.actuator.write(vibration)
            if parts.recorder is not None:
                first_ns = now_ns - (elapsed - 1) * self._period_ns
                parts.recorder.record_output(first_ns, parts.switch.mode, vibration)
            if parts.switch.mode != self._mode:
                self._mode = parts.switch.mode
                self.log.switches.append({"time_s": round(self.time_s, 3), "mode": self._mode})
                self._event(f"vibration {self._mode}", mode=self._mode)
        if self.scene.link is None and self.time_s >= self.scene.session.duration_s:
            self.stop("completed")

    @property
    def _streaming(self) -> bool:
        return self.server is not None and self.server.connected

    def _read_hand(self, elapsed: int, now_ns: int) -> InterfaceState | None:
        if self.parts.hand is None:
            return None
        state = self.parts.hand.read(elapsed)
        if self.server is not None:
            self.server.send_commands(self._commands.make(now_ns, state.position_mm))
        return state

    def _drive(self, state: InterfaceState | None, elapsed: int) -> tuple[float, float]:
        """Return the speed and force that drive the model: the hand's own where there is one."""
        if state is not None:
            x, y, _ = state.velocity_mm_s
            return (x * x + y * y) ** 0.5, state.force_n if state.contact else 0.0
        motion = self.parts.streamed_motion
        if motion is None:
            return 0.0, 0.0
        self._rest_ticks += elapsed
        if self._rest_ticks > _STREAM_REST_TICKS:
            motion.rest()
        return motion.speed_mm_s, motion.force_n

    # --- reporting

    def _on_update(self, update: "ModelUpdate", seconds: float) -> None:
        self._models.take(update, seconds)

    def _event(self, sentence: str, **details: object) -> None:
        self._say(sentence)
        LOG.info(sentence, extra=logs.details(time_s=round(self.time_s, 3), **details))
        self._record_event({"event": sentence, **details})

    def _record_event(self, event: dict[str, Any]) -> None:
        if self.parts.recorder is not None:
            self.parts.recorder.record_event({"time_s": round(self.time_s, 3), **event})

    def _note(self, sentence: str, *, announce: bool, **details: object) -> None:
        if announce:
            self._event(sentence, **details)
        else:
            self._record_event({"event": sentence, **details})

    async def _report_status(self) -> None:
        while True:
            await asyncio.sleep(_STATUS_PERIOD_S)
            status = self.status()
            self._on_status(status)
            if LOG.isEnabledFor(logging.DEBUG):
                LOG.debug("status", extra=logs.details(status=status.as_dict()))
            if self._clock_notes is not None:
                self._clock_notes.look()
            recorder = self.parts.recorder
            if recorder is not None and recorder.error is not None:
                self._fail(MmtError(f"recording {recorder.path}: {recorder.error}"))

    def status(self) -> LeaderStatus:
        """Return the live status."""
        server, playout, update = self.server, self.parts.playout, self.log.update
        link = server.statistics if server is not None else None
        ticks = self.ticker.statistics
        return LeaderStatus(
            phase="streaming" if self._streaming or server is None else "waiting",
            mode=self._mode,
            time_s=self.time_s,
            frames=link.frames if link is not None else 0,
            frames_lost=link.lost if link is not None else 0,
            samples=update.samples if update is not None else 0,
            distance=update.distance if update is not None else None,
            ticks=ticks.ticks,
            late_ticks=round((ticks.late_share_1ms or 0.0) * ticks.ticks),
            tick_p99_ms=ticks.period_p99_ms,
            playout_delay_ms=playout.statistics().delay_ms if playout is not None else None,
        )

    def _summary(self, duration_s: float) -> LeaderSummary:
        return summarise(
            self.log,
            self.parts,
            name=self.scene.session.name,
            duration_s=duration_s,
            link=self.server.statistics if self.server is not None else None,
            clock_offset_ns=self.server.clock.offset_ns if self.server is not None else None,
            ticks=self.ticker.statistics,
            cost=self._meter.read(),
            backfill=self.backfill.summary,
        )
