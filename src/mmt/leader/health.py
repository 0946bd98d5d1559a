"""The state of a run: its faults, and the verdict on it."""

from collections import deque
from typing import TYPE_CHECKING, Any, Final

from mmt.core.verdict import LATE_SHARE, Facts, Verdict, verdict
from mmt.leader.part import Session

if TYPE_CHECKING:
    from mmt.leader.output.model_output import ModelOutput
    from mmt.leader.output.vibration import VibrationPart

_LOOKS: Final = 11
"""Readings of the ticks, five a second, from which their lateness is judged: 2 s."""


class RunHealth:
    """Judges a run while it goes on.

    Parameters
    ----------
    session
        Session of the run.
    completing
        Knows which vibration a person has fixed.
    vibration
        Knows which vibration is played; None without an actuator.
    """

    def __init__(
        self, session: Session, completing: "ModelOutput", vibration: "VibrationPart | None"
    ) -> None:
        self._session = session
        self._completing, self._vibration = completing, vibration
        self._ticks: deque[tuple[int, int]] = deque(maxlen=_LOOKS)

    def update(self) -> None:
        """Note how many ticks were late, from the first frame on; call it five times a second."""
        remote = self._session.remote
        if remote is not None and not remote.has_begun:
            return
        if self._session.ticker is not None:
            self._ticks.append(self._session.ticker.lateness)

    @property
    def _late_share(self) -> float:
        """Share of the last seconds' ticks that were over 1 ms late."""
        if len(self._ticks) < 2:
            return 0.0
        (first, late_before), (last, late) = self._ticks[0], self._ticks[-1]
        return (late - late_before) / max(1, last - first)

    def faults(self) -> list[str]:
        """Return the faults other than late ticks, a sentence each."""
        session = self._session
        found = [] if session.remote is None else session.remote.faults
        return found + [fault for faults in session.parts.verbs("faults") for fault in faults()]

    def verdict(self) -> Verdict:
        """Return the verdict on the run as it is now."""
        session, log, completing = self._session, self._session.log, self._completing
        progress = None if log.update is None else log.update.progress
        rises = progress is not None and progress.scale.rises
        ended = session.ending.reached
        faults = [] if ended else self.faults()
        late_share = self._late_share
        if late_share > LATE_SHARE and not ended:
            faults = [*faults, f"{100.0 * late_share:.0f} % of the ticks late"]
        return verdict(
            Facts(
                time_s=session.time_s(),
                mode=None if self._vibration is None else self._vibration.switch.mode,
                forced=completing.forced is not None,
                start_s=log.start_s,
                stop_s=log.stop_s,
                waits="" if session.remote is None else session.remote.awaited,
                outcome=session.ending.outcome if ended else None,
                models=session.scene.texture is not None,
                readiness=progress.value if progress is not None and rises else None,
                takes_over_at=progress.scale.start if progress and completing.renders else None,
                played_share=completing.played_share,
                fell=completing.fell,
                completion="" if progress is None or rises else str(progress),
                faults=faults,
            )
        )

    def as_dict(self, status: Any) -> dict[str, Any]:
        """Return phase, session and faults for ``/health``, from the leader's status."""
        session = self._session
        ending = session.ending
        ended = [f"the session has ended: {ending.outcome}"] if ending.reached else []
        return {
            "phase": status.phase,
            "connected": session.remote is not None and session.remote.connected,
            "session": session.log.session_id,
            "time_s": round(status.time_s, 3),
            "mode": status.mode,
            "faults": ended + self.faults(),
        }
