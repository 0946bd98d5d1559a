"""The leader's reports: live status, faults and verdict of a run, and a summary at its end."""

from collections import deque
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

from mmt.core.running.ticking import TickStatistics
from mmt.core.verdict import LATE_SHARE, Facts, Verdict, has_failed, verdict
from mmt.leader.part import Session

if TYPE_CHECKING:
    from mmt.leader.output.model_output import ModelOutput
    from mmt.leader.output.vibration import VibrationPart

_LOOKS: Final = 11
"""Readings of the ticks, five a second, from which their lateness is judged: 2 s."""


@dataclass(frozen=True, kw_only=True)
class LeaderStatus:
    """One line of live progress."""

    phase: str
    mode: str = "silent"
    time_s: float
    frames: int
    frames_lost: int
    samples: int = 0
    distance: float | None = None
    completion: str | None = None
    """State of the criterion in use, in words."""
    ticks: int
    late_ticks: int
    tick_p99_ms: float | None
    playout_delay_ms: float | None = None
    verdict: dict[str, Any] = field(default_factory=dict)
    """See `mmt.core.verdict`."""
    more: dict[str, Any] = field(default_factory=dict)
    """Figures of other parts."""

    def as_dict(self) -> dict[str, Any]:
        """Return the status as a dictionary."""
        figures = asdict(self)
        more: dict[str, Any] = figures.pop("more")
        return figures | more


@dataclass(frozen=True)
class LeaderSummary:
    """The whole run, in tables of plain values; a part that did not run has an empty table.

    ``outcome`` is "completed" (the wanted duration), "source ended", "stopped" (by the user),
    "follower lost", or "follower failed: ..." or "failed: ..." with the fault. Times are seconds
    of the session.
    """

    outcome: str
    session: dict[str, Any]
    link: dict[str, Any]
    texture: dict[str, Any]
    vibration: dict[str, Any]
    ticks: dict[str, Any]
    process: dict[str, Any]
    recording: dict[str, Any]
    backfill: dict[str, Any] = field(default_factory=dict)
    feedback: dict[str, Any] = field(default_factory=dict)
    handle: dict[str, Any] = field(default_factory=dict)
    more: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Tables of other parts, by name."""

    @property
    def problem(self) -> str | None:
        """Why the run or its recording failed, or None if neither did."""
        if has_failed(self.outcome):
            return self.outcome
        error = self.recording.get("error")
        return f"recording {self.recording['file']}: {error}" if error else None

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as a dictionary, without empty tables."""
        tables = asdict(self)
        more: dict[str, Any] = tables.pop("more")
        return {name: table for name, table in (tables | more).items() if table}


def summarise(
    session: Session, ticks: TickStatistics, *, outcome: str, duration_s: float
) -> LeaderSummary:
    """Gather the summary of a run that has ended, from every part."""
    log, remote = session.log, session.remote
    tables: dict[str, dict[str, Any]] = {
        "session": {
            "name": session.scene.session.name,
            "id": log.session_id,
            "duration_s": round(duration_s, 3),
        },
        "ticks": asdict(ticks),
        "process": {"ready_s": log.ready_s, **log.meter.read().as_dict()},
    }
    if remote is not None:
        tables["link"] = asdict(remote.server.statistics)
        tables["backfill"] = remote.backfill.summary
    for part in session.parts:
        for name, table in part.summary(duration_s).items():
            tables[name] = {**tables.get(name, {}), **table}
    known = {item.name for item in fields(LeaderSummary)} - {"outcome", "more"}
    return LeaderSummary(
        outcome=outcome,
        **{name: tables.get(name, {}) for name in known},
        more={name: table for name, table in tables.items() if name not in known},
    )


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
