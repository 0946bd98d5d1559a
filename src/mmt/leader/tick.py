"""What the leader does every millisecond."""

import time
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.protocols import InterfaceState
from mmt.leader.feedback import Feedback
from mmt.leader.journal import Journal
from mmt.leader.parts import LeaderParts
from mmt.leader.remote import RemoteFollower
from mmt.leader.summary import RunLog

_FADE: Final = 0.1
"""Of the vibration, in a tick: 10 ms out when the handle is lost, and in when it is back."""


class LeaderTick:
    """Read the hand and command the follower, display force, render vibration.

    Parameters
    ----------
    parts
        The leader's parts.
    log
        Where switches and late ticks are noted.
    journal
        Takes what happened.
    remote
        The follower, None where the scene has no link.
    period_ns
        Time from tick to tick.
    """

    def __init__(
        self,
        parts: LeaderParts,
        log: RunLog,
        journal: Journal,
        remote: RemoteFollower | None,
        period_ns: int,
    ) -> None:
        self._parts = parts
        self._log = log
        self._journal = journal
        self._remote = remote
        self._period_ns = period_ns
        self._last_ns = 0
        self._loudness = 1.0
        self.ticks = 0
        """Ticks so far, missed ones counted."""
        self.mode = parts.switch.mode if parts.switch is not None else "silent"
        """Which vibration is heard, as of the last tick."""

    def step(self, elapsed: int) -> None:
        """Do the work of so many ticks, all but the last of which were missed."""
        now_ns = time.monotonic_ns()
        parts, remote = self._parts, self._remote
        self.ticks += elapsed
        self._note_lateness(now_ns)
        streaming = remote is None or remote.connected
        state = self._read_hand(elapsed, now_ns) if streaming else None
        if parts.tap is not None:
            parts.tap.hold(state)
        if streaming and remote is not None:
            remote.backfill.tick(elapsed)
        if parts.feedback is not None:
            self._display(parts.feedback, elapsed, state)
        if remote is None or remote.has_begun:
            self._render(elapsed, now_ns, state)

    def _note_lateness(self, now_ns: int) -> None:
        modelling = self._parts.modelling
        if modelling is not None and modelling.working and self._last_ns:
            late_ns = now_ns - self._last_ns - self._period_ns
            self._log.late_while_modelling.add(max(0, late_ns))
        self._last_ns = now_ns

    def _read_hand(self, elapsed: int, now_ns: int) -> InterfaceState | None:
        if self._parts.hand is None:
            return None
        handle = self._parts.handle
        state = self._parts.hand.read(elapsed)
        if handle is not None:
            position = handle.command_mm
        else:
            position = state.position_mm if state is not None else None
        if self._remote is not None and position is not None:
            self._remote.command(now_ns, position)
        return state

    def _display(self, feedback: Feedback, elapsed: int, state: InterfaceState | None) -> None:
        """Show the hand its force: none where the handle is lost; it fades without a stream."""
        if self._handle_is_lost:
            feedback.rest(elapsed)
            return
        news = feedback.tick(elapsed, state)
        if news is not None and self._remote is not None:
            self._remote.send_extra(news)

    def _render(self, elapsed: int, now_ns: int, state: InterfaceState | None) -> None:
        """Let the actuator play the elapsed ticks."""
        parts = self._parts
        if parts.switch is None or parts.actuator is None:
            return
        inputs = self._inputs(*self._drive(state, elapsed))
        vibration = parts.switch.render(now_ns, *(np.full(elapsed, value) for value in inputs))
        self._rest_without_handle(vibration)
        parts.actuator.write(vibration)
        if parts.tap is not None:
            parts.tap.play(vibration)
        mode = parts.switch.mode
        if parts.recorder is not None:
            first_ns = now_ns - (elapsed - 1) * self._period_ns
            parts.recorder.record_output(first_ns, mode, vibration)
        if mode != self.mode:
            self.mode = mode
            self._log.switches.append({"time_s": self._journal.time_s, "mode": mode})
            self._journal.event(f"vibration {mode}", mode=mode)

    @property
    def _handle_is_lost(self) -> bool:
        handle = self._parts.handle
        return handle is not None and handle.lost

    def _rest_without_handle(self, vibration: FloatArray) -> None:
        """Fade the vibration (n,) in place: out while the handle is lost, and in again."""
        goal = 0.0 if self._handle_is_lost else 1.0
        if self._loudness == goal == 1.0:
            return
        for index in range(len(vibration)):
            self._loudness += min(max(goal - self._loudness, -_FADE), _FADE)
            vibration[index] *= self._loudness

    def _drive(self, state: InterfaceState | None, elapsed: int) -> tuple[float, float, float]:
        """Return the velocity over the surface and the force: the hand's where there is one."""
        if state is not None:
            first, second = self._parts.tangential
            velocity = state.velocity_mm_s
            return velocity[first], velocity[second], state.force_n if state.contact else 0.0
        motion = self._parts.streamed_motion
        return motion.step(elapsed) if motion is not None else (0.0, 0.0, 0.0)

    def _inputs(self, x_mm_s: float, y_mm_s: float, force_n: float) -> tuple[float, ...]:
        """Return what the present model is a function of."""
        synthesizer = self._parts.synthesizer
        if synthesizer is not None and synthesizer.directed:
            return x_mm_s, y_mm_s, force_n
        return (x_mm_s * x_mm_s + y_mm_s * y_mm_s) ** 0.5, force_n
