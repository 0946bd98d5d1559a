"""What the leader says of itself: a status several times a second, a summary at the end."""

import statistics
import uuid
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

from mmt.core.errors import FAILED
from mmt.core.process import ProcessMeter
from mmt.core.ticking import TickStatistics, TimeHistogram
from mmt.leader.parts import LeaderParts

if TYPE_CHECKING:
    from mmt.leader.surface_log import SurfaceLog
    from mmt.link.protocol import LinkStatistics
    from mmt.texture.library.identification import Choice
    from mmt.texture.online.work import ModelUpdate

_UNWANTED: Final = (FAILED, f"follower {FAILED}", "follower lost")


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
    """What the criterion in use says, in words."""
    ticks: int
    late_ticks: int
    tick_p99_ms: float | None
    playout_delay_ms: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the status for a program."""
        return asdict(self)


@dataclass
class RunLog:
    """What the service notes while it runs."""

    session_id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    meter: ProcessMeter = field(default_factory=ProcessMeter)
    update: "ModelUpdate | None" = None
    update_seconds: list[float] = field(default_factory=list)
    switches: list[dict[str, Any]] = field(default_factory=list)
    late_while_modelling: TimeHistogram = field(default_factory=TimeHistogram)
    start_s: float | None = None
    stop_s: float | None = None
    warm: "Choice | None" = None
    """The known texture that was rendered before the local model."""
    ready_s: float | None = None
    surfaces: "SurfaceLog | None" = None
    """Which surface the tool was on, where surfaces are told apart."""


@dataclass(frozen=True)
class LeaderSummary:
    """The whole run, in tables of plain values; a part that did not run has an empty table.

    ``outcome`` is "completed" (the wanted duration), "source ended", "stopped" (by the
    person), "follower lost", "follower failed: ..." or "failed: ...", each with what failed.
    Times are seconds of the session.
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

    @property
    def problem(self) -> str | None:
        """What made the run end in a way that nobody wanted, None where nothing did."""
        if self.outcome.startswith(_UNWANTED):
            return self.outcome
        error = self.recording.get("error")
        return f"recording {self.recording['file']}: {error}" if error else None

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for a program, empty tables left out."""
        return {name: table for name, table in asdict(self).items() if table}


def summarise(
    log: RunLog,
    parts: LeaderParts,
    *,
    outcome: str,
    name: str,
    duration_s: float,
    link: "LinkStatistics | None",
    clock_offset_ns: int | None,
    ticks: TickStatistics,
    backfill: dict[str, Any],
) -> LeaderSummary:
    """Gather the summary of a run that has ended."""
    cost = log.meter.read()
    return LeaderSummary(
        outcome=outcome,
        session={"name": name, "id": log.session_id, "duration_s": round(duration_s, 3)},
        link=asdict(link) if link is not None else {},
        texture=_texture(log, parts, duration_s),
        vibration=_vibration(log, parts, clock_offset_ns),
        ticks={
            **asdict(ticks),
            "late_while_modelling_p99_ms": log.late_while_modelling.quantile_ms(0.99),
        },
        process={
            "ready_s": log.ready_s,
            "core_share": round(cost.core_share, 3),
            "memory_mb": round(cost.memory_mb, 1),
        },
        recording=_recording(parts),
        backfill=backfill,
        feedback=dict(parts.feedback.summary) if parts.feedback is not None else {},
        handle=_handle(parts),
    )


def _texture(log: RunLog, parts: LeaderParts, duration_s: float) -> dict[str, Any]:
    if parts.modelling is None:
        return {}
    update, seconds = log.update, log.update_seconds
    return {
        "samples": update.samples if update else 0,
        "outliers": update.outliers if update else 0,
        "redundant": update.redundant if update else 0,
        "order": update.order if update else None,
        "distance": round(update.distance, 3) if update else None,
        "completion": update.progress.as_dict() if update else None,
        "start_s": log.start_s,
        "stop_s": log.stop_s,
        **({"warm": log.warm.as_dict()} if log.warm is not None else {}),
        **({"surfaces": log.surfaces.as_dict(duration_s)} if log.surfaces is not None else {}),
        "updates": len(seconds),
        "update_median_ms": round(1e3 * statistics.median(seconds), 2) if seconds else None,
        "update_longest_ms": round(1e3 * max(seconds), 2) if seconds else None,
        "dropped_frames": parts.modelling.dropped_frames,
        "late_frames": parts.modelling.late_frames,
        "tasks": {name: task.as_dict() for name, task in parts.modelling.figures.items()},
    }


def _vibration(log: RunLog, parts: LeaderParts, clock_offset_ns: int | None) -> dict[str, Any]:
    if parts.switch is None or parts.actuator is None:
        return {}
    table: dict[str, Any] = {"mode": parts.switch.mode, "switches": log.switches}
    table["actuator"] = asdict(parts.actuator.statistics)
    if parts.mended is not None:
        table["actuator"] |= parts.mended.losses_summary
    if parts.playout is not None:
        age_ms = parts.playout.age_ms(clock_offset_ns)
        table["playout"] = {**asdict(parts.playout.statistics()), "age_ms": age_ms}
    return table


def _handle(parts: LeaderParts) -> dict[str, Any]:
    handle = parts.handle
    return {"device": handle.name, **handle.losses_summary} if handle is not None else {}


def _recording(parts: LeaderParts) -> dict[str, Any]:
    recorder = parts.recorder or parts.ended_recorder
    if recorder is None:
        return {}
    return {
        "file": str(recorder.path),
        "frames": recorder.frames,
        "dropped": recorder.dropped,
        "error": str(recorder.error) if recorder.error is not None else None,
    }
