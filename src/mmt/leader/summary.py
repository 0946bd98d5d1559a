"""The leader's reports: a status several times a second, and a summary at the end."""

from dataclasses import asdict, dataclass, field, fields
from typing import Any

from mmt.core.ticking import TickStatistics
from mmt.core.verdict import has_failed
from mmt.leader.part import Session


@dataclass(frozen=True)
class LeaderStatus:
    """One line of live progress."""

    phase: str
    mode: str
    time_s: float
    frames: int
    frames_lost: int
    samples: int
    distance: float | None
    completion: str | None
    """State of the criterion in use, in words."""
    ticks: int
    late_ticks: int
    tick_p99_ms: float | None
    playout_delay_ms: float | None
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
        tables["link"] = asdict(remote.statistics) if remote.statistics is not None else {}
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
