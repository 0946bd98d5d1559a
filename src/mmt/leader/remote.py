"""The leader's view of the follower: pass its frames to the parts, and wait if it is lost."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import RecordArray, Vector
from mmt.core.errors import FAILED
from mmt.core.frames import COMMAND_DTYPE, FeedbackSide
from mmt.core.running.ending import Ending
from mmt.core.running.process import ProcessMeter
from mmt.core.sequence_numbers import SEQUENCES
from mmt.leader.backfill import Backfill
from mmt.leader.numbering import FrameRateWatch, SessionNumbering
from mmt.leader.run_log import Journal, RunLog
from mmt.scene import LARGEST_SPEED, Link, Scene

if TYPE_CHECKING:
    from mmt.link.clock_exchange import RemoteClock
    from mmt.link.clock_offset import ClockJump
    from mmt.link.protocol import FollowerHello
    from mmt.link.server import LeaderServer
    from mmt.link.serving.http import Page

_NOTE_PERIOD_NS: Final = 10_000_000_000
_SILENT_NS: Final = 500_000_000
"""Time without a frame that counts as a fault."""
_UNSTAMPED_S: Final = 2.0
"""Longest time without an offset of the follower's clock that is no fault."""


class RemoteFollower:
    """Handle the link's events, and send the follower the command of each tick.

    Parameters
    ----------
    scene, link
        The scene to run, and its link.
    log, journal, ending
        Of the session.
    call
        Calls a verb of every part.
    feedback
        Handles the follower's further event, or None.
    """

    def __init__(
        self,
        scene: Scene,
        link: Link,
        log: RunLog,
        journal: Journal,
        ending: Ending,
        *,
        call: Callable[..., None],
        feedback: FeedbackSide | None,
    ) -> None:
        self._scene, self._link, self._log = scene, link, log
        self._journal, self._ending, self._call = journal, ending, call
        fastest = LARGEST_SPEED if scene.replay is not None else 1.0
        self._numbering = SessionNumbering(round(1e9 / scene.session.rate_hz), fastest)
        self._commands = 0
        self.backfill = Backfill(
            scene.keep_frames(),
            self._numbering,
            call,
            lambda ranges: self.server.request_frames(ranges),  # noqa: PLW0108 - made later
            journal.note,
        )
        self._users: Sequence[Callable[[RecordArray, int], None]] = ()
        self.server = self._make_server(fastest, feedback)
        self.clock_notes = ClockNotes(self.server.clock, journal.record)
        self._rate = FrameRateWatch(scene.session.rate_hz, journal.event)

    def _make_server(self, fastest: float, feedback: FeedbackSide | None) -> "LeaderServer":
        from mmt.link.endpoint import LeaderEvents, emulated_network
        from mmt.link.server import LeaderServer

        return LeaderServer(
            self._link,
            self._scene.channels(),
            LeaderEvents(
                on_follower=self._on_follower,
                on_frames=self._on_frames,
                on_event=lambda sentence: self._journal.record({"event": f"follower: {sentence}"}),
                on_end=self._on_end,
                on_lost=self._on_lost,
                on_jump=self._on_jump,
                on_backfill=self.backfill.receive,
                on_gone=self.backfill.give_up,
                on_settle=self.backfill.missing_ranges,
                on_error=self._ending.fail,
            ),
            samples_per_frame=self._scene.session.samples_per_frame,
            fastest=fastest,
            session_id=self._log.session_id,
            network=emulated_network(self._scene, "down", self._journal.event),
            extra=feedback,
        )

    @property
    def connected(self) -> bool:
        """Whether a follower is connected that has not ended the session."""
        return self.server.connected

    @property
    def clock_offset_ns(self) -> int | None:
        """The follower's clock minus this one (ns), or None while it is not known."""
        return self.server.clock.offset_ns

    @property
    def follower_time_ns(self) -> int:
        """Time of the newest frame by the follower's clock; 0 before the first of a connection."""
        return self._numbering.follower_time_ns

    @property
    def has_begun(self) -> bool:
        """Whether a frame has come."""
        return self._numbering.frames > 0

    @property
    def faults(self) -> list[str]:
        """Faults of the follower and the link, a sentence each."""
        if self._ending.awaits_peer:
            return ["follower lost"]
        if self.connected and self.has_begun:
            silent_ns = time.monotonic_ns() - self._numbering.arrival_ns
            if silent_ns > _SILENT_NS:
                return [f"no frame for {silent_ns / 1e9:.1f} s"]
        found = [] if self._rate.fault is None else [self._rate.fault]
        if self.connected and self.server.clock.unknown_s > _UNSTAMPED_S:
            found.append(
                f"the follower's clock is unknown after {_UNSTAMPED_S:g} s: it exchanges no time "
                "stamps (clock), so frames have no date, and what is passed on by date (LSL, ROS) "
                "gets none"
            )
        return found

    @property
    def awaited(self) -> str:
        """What the session waits for, "" while frames come."""
        if self._ending.awaits_peer:
            return f"follower lost: waiting {self._link.patience_s:g} s for its return"
        if not self.connected:
            return "waiting for the follower"
        return "" if self.has_begun else "waiting for the first frame"

    @property
    def time_s(self) -> float:
        """Session time: that of the newest frame."""
        return self._numbering.frames / self._scene.session.rate_hz

    async def listen(
        self, pages: "Iterable[Page]", users: Sequence[Callable[[RecordArray, int], None]]
    ) -> None:
        """Wait for the follower, and serve these pages.

        `users` are called with the newest frames (n,) and their arrival.

        Raises
        ------
        MmtError
            The port or a certificate cannot be used.
        """
        self._users = users
        await self.server.start(pages)

    async def dismiss(self) -> None:
        """Ask the follower to end, and receive missing frames that it still sends."""
        await self.server.request_stop(self._ending.outcome)
        self.backfill.close()

    async def close(self) -> None:
        """Stop listening, and record the clocks' offset at the end."""
        self._ending.cancel_timeout()
        await self.server.stop()
        self.clock_notes.record_if_due(last=True)

    def command(self, now_ns: int, position_mm: Vector) -> None:
        """Ask the follower to take a position (mm); echo the newest frame's time."""
        echo_time_ns = self._numbering.follower_time_ns
        echo_age_ns = now_ns - self._numbering.arrival_ns if echo_time_ns else 0
        command = np.zeros(1, dtype=COMMAND_DTYPE)
        command[0] = (self._commands, now_ns, echo_time_ns, echo_age_ns, position_mm)
        self._commands = (self._commands + 1) % SEQUENCES
        self.server.send_commands(command)

    # --- what the link reports

    def _on_follower(self, hello: "FollowerHello") -> None:
        self._ending.cancel_timeout()
        self._numbering.reconnect(hello.run_id)
        self._rate.restart()
        self.backfill.connect(hello)
        self._call("on_follower", hello)
        self._journal.event(f"follower connected ({hello.source})")

    def _on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        if not self.has_begun:
            self._log.meter = ProcessMeter()
        if self.backfill.settled:
            self.backfill.receive(frames)
            return
        newest = self._numbering.newest
        frames, left_out = self._numbering.number(frames, arrival_ns)
        if left_out:
            self.backfill.restart(left_out)
            self._journal.event(
                f"the follower started anew, {left_out} frames are missing before it"
            )
        if 0 <= newest != self._numbering.newest - len(frames) - left_out:
            self.backfill.missing.jumped(newest + left_out, frames)
        for use in self._users:
            use(frames, arrival_ns)
        if self._scene.replay is None:  # a replay may be faster or slower than its session
            self._rate.add(self._numbering.newest, int(frames["time_ns"][-1]))
        if self.time_s >= self._scene.session.duration_s:
            self._ending.stop("completed")

    def _on_end(self, reason: str) -> None:
        self._journal.event(f"follower ended: {reason}")
        failed = reason.startswith(FAILED)
        self._ending.stop(f"follower {reason}" if failed else "source ended")

    def _on_lost(self, reason: str) -> None:
        if self._ending.reached:
            return
        patience_s = self._link.patience_s
        self._journal.event(f"follower lost ({reason}), waiting {patience_s:g} s for its return")
        self._call("on_lost")
        self._ending.start_timeout(patience_s, lambda: self._ending.stop("follower lost"))

    def _on_jump(self, jump: "ClockJump") -> None:
        sentence, details = self.clock_notes.jumped(jump)
        self._journal.event(sentence, **details)


class ClockNotes:
    """Record the clocks' offset when first known, every ten seconds, after a jump, at the end.

    Parameters
    ----------
    clock
        The follower's clock.
    note
        Records an event.
    """

    def __init__(self, clock: "RemoteClock", note: Callable[[dict[str, Any]], None]) -> None:
        self._clock = clock
        self._note = note
        self._noted_ns: int | None = None

    def record_if_due(self, *, last: bool = False) -> None:
        """Record the offset if it is time; call this several times a second, and at the end."""
        estimate = self._clock.estimate
        if estimate is None:
            return
        since_ns = None if self._noted_ns is None else estimate.time_ns - self._noted_ns
        if since_ns is not None and since_ns < _NOTE_PERIOD_NS and not (last and since_ns > 0):
            return
        self._noted_ns = estimate.time_ns
        self._note(
            {
                "event": "clocks compared",
                "clock_time_ns": estimate.time_ns,
                "clock_offset_ns": 0 if self._clock.is_shared else estimate.offset_ns,
                "clock_drift_ppm": 0.0 if self._clock.is_shared else round(estimate.drift * 1e6, 3),
                "clock_uncertainty_ns": 0 if self._clock.is_shared else estimate.uncertainty_ns,
                "same_clock": self._clock.is_shared,
            }
        )

    def jumped(self, jump: "ClockJump") -> tuple[str, dict[str, Any]]:
        """Return the sentence and the details of a jump; record the offset anew after it."""
        self._noted_ns = None
        details = {"clock_time_ns": jump.time_ns, "clock_step_ns": jump.step_ns}
        return f"clocks: the follower's {jump.describe()}", details
