"""Checks that must hold after a soak, a row each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.evaluation.reports.document import ReportTable
from mmt.session.mcap.reader import scanned_frames, utc_offset_ns
from mmt.session.mcap.scan import scan_mcap
from mmt.session.mcap.writer import FRAMES_TOPIC
from mmt_lab.soak.drift import Drift, by_window, drift, outside
from mmt_lab.soak.faults import RESTART, SoakFault


@dataclass(frozen=True)
class Gap:
    """Number of missing frames, and the times of the frames before and after them."""

    frames: int
    start_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class Readback:
    """Contents of a recording. Times are seconds of the machine's monotonic clock.

    ``arrival_s`` and ``latency_ms`` (k,) are those of one frame in every block of 20;
    ``disordered`` counts frames whose number is not above the one before.
    """

    whole: bool
    frames: int
    disordered: int
    gaps: tuple[Gap, ...]
    arrival_s: FloatArray
    latency_ms: FloatArray

    @property
    def missing(self) -> int:
        """How many frames are missing."""
        return sum(gap.frames for gap in self.gaps)


def read_back(path: Path) -> Readback:
    """Read a recording of services that ran on this machine."""
    scan = scan_mcap(path)
    blocks = scan.on_topic(FRAMES_TOPIC)
    offset_ns = utc_offset_ns(scan) or 0
    arrival_ns = np.array([block.log_time - offset_ns for block in blocks], dtype=np.int64)
    time_ns = np.array([block.publish_time for block in blocks], dtype=np.int64)
    frames = scanned_frames(scan)
    gaps, disordered = find_gaps(frames)
    return Readback(
        whole=scan.whole,
        frames=len(frames),
        disordered=disordered,
        gaps=gaps,
        arrival_s=arrival_ns / 1e9,
        latency_ms=(arrival_ns - time_ns) / 1e6,
    )


def find_gaps(frames: RecordArray) -> tuple[tuple[Gap, ...], int]:
    """Return the gaps between frames (n,), and how many frames do not ascend."""
    sequence, time_ns = frames["sequence"].astype(np.int64), frames["time_ns"].astype(np.int64)
    steps = np.diff(sequence)
    gaps = tuple(
        Gap(int(steps[i]) - 1, float(time_ns[i]) / 1e9, float(time_ns[i + 1]) / 1e9)
        for i in np.flatnonzero(steps > 1)
    )
    return gaps, int(np.count_nonzero(steps <= 0))


RECOVERY_S: Final = 3.0
"""Time after a fault that is left out when drift is tested."""

PATIENCE_S: Final = 30.0
"""How long the services wait for each other and keep frames that did not arrive. Frames come again
after this time at the latest, even if a follower is started anew on a busy machine."""

_BEFORE_S: Final = 1.0
"""Time before a fault that is left out too, since a sample covers some of that time."""

_TELLING_S: Final = 600.0
"""From this length on, a run must have enough quiet windows to test every figure for growth."""

_WARM_UP_S: Final = 60.0
_WARM_UP_SHARE: Final = 0.25
_WINDOWS: Final = 100
_LONGEST_WINDOW_S: Final = 60.0
_SHORTEST_WINDOW_S: Final = 1.0


@dataclass(frozen=True)
class AppliedFault:
    """A fault as it was done, in seconds of the machine's monotonic clock."""

    fault: SoakFault
    start_s: float
    end_s: float


@dataclass(frozen=True)
class ServiceSample:
    """Memory and ticks of the services at a moment of the monotonic clock.

    ``modelling_mb`` is the memory of the processes that the leader has started; ``ticks`` and
    ``late_ticks`` are the leader's counts since its start.
    """

    time_s: float
    leader_mb: float | None
    modelling_mb: float | None
    follower_mb: float | None
    ticks: int
    late_ticks: int


@dataclass
class SoakLog:
    """Log of a soak, kept while it runs. Times are seconds of the machine's monotonic clock.

    ``lives_s`` are the times at which followers were started; ``leader`` is the leader's summary,
    empty until it has ended.
    """

    start_s: float = 0.0
    end_s: float = 0.0
    faults: list[AppliedFault] = field(default_factory=list)
    lives_s: list[float] = field(default_factory=list)
    samples: list[ServiceSample] = field(default_factory=list)
    leader: dict[str, Any] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Check:
    """One row: the requirement, the figure found, the bound allowed, and whether it held."""

    what: str
    found: str
    allowed: str
    held: bool
    figures: Mapping[str, Any] = field(default_factory=dict)


def judge(observed: SoakLog, readback: Readback, recovery_s: float = RECOVERY_S) -> list[Check]:
    """Return the checks of a soak and its recording."""
    return [
        Check("services", "; ".join(observed.errors) or "ran to the end", "", not observed.errors),
        *_recording(observed, readback, recovery_s),
        *_drifts(observed, readback, recovery_s),
    ]


def table(checks: Sequence[Check]) -> ReportTable:
    """Return the checks as a table."""
    rows = [(c.what, c.found, c.allowed, "yes" if c.held else "no") for c in checks]
    return ReportTable(("what", "found", "allowed", "held"), rows)


def _recording(observed: SoakLog, readback: Readback, recovery_s: float) -> list[Check]:
    counts = observed.leader.get("recording", {})
    dropped, written = counts.get("dropped"), counts.get("frames")
    unexplained = [gap for gap in readback.gaps if not _explained(gap, observed, recovery_s)]
    longest_s = max((h.end_s - h.start_s for h in observed.faults), default=0.0)
    silence_s = float(np.diff(readback.arrival_s).max(initial=0.0))
    return [
        Check("recording can be read to its end", "yes" if readback.whole else "no", "",
              readback.whole),
        Check(
            "frames in the recording",
            f"{readback.frames}, {dropped} dropped",
            f"{written}, as the leader says; 0 dropped",
            readback.frames == written and dropped == 0 and readback.frames > 0,
            {"frames": readback.frames},
        ),
        Check("frames twice or out of order", f"{readback.disordered}", "0",
              readback.disordered == 0),
        Check(
            "frames missing, but where a follower was killed",
            f"{sum(gap.frames for gap in unexplained)} of {readback.missing} missing",
            "0",
            not unexplained,
            {"missing": readback.missing, "gaps": len(readback.gaps)},
        ),
        Check(
            "longest silence of the stream (s)",
            f"{silence_s:.2f}",
            f"{longest_s + PATIENCE_S:.2f}",
            silence_s <= longest_s + PATIENCE_S,
            {"silence_s": silence_s},
        ),
    ]  # fmt: skip


def _explained(gap: Gap, observed: SoakLog, recovery_s: float) -> bool:
    """Return whether a killed follower had these frames; other frames must be sent again."""
    return any(
        happened.start_s <= gap.end_s and gap.start_s <= happened.end_s + recovery_s
        for happened in observed.faults
        if happened.fault.kind == RESTART
    )


def _drifts(observed: SoakLog, readback: Readback, recovery_s: float) -> list[Check]:
    span_s = observed.end_s - observed.start_s
    warm_s = observed.start_s + min(_WARM_UP_S, _WARM_UP_SHARE * span_s)
    disturbed = [(-np.inf, warm_s), (observed.end_s - 0.5, np.inf)]
    disturbed += [(h.start_s - _BEFORE_S, h.end_s + recovery_s) for h in observed.faults]

    leader = _series([(s.time_s, s.leader_mb) for s in observed.samples])
    modelling = _series([(s.time_s, s.modelling_mb) for s in observed.samples])
    follower, late = _longest_life(observed), _late(observed)
    hours = max(1.0, span_s / 3600.0)  # a recording's index grows with time
    latency = np.stack([readback.arrival_s, readback.latency_ms])
    p99 = partial(np.quantile, q=0.99)
    rows: tuple[tuple[str, FloatArray, Callable[[FloatArray], Any], float, float, float], ...] = (
        ("leader's memory (MB)", leader, np.median, 5.0, 0.05, hours),
        ("modelling's memory (MB)", modelling, np.median, 5.0, 0.05, hours),
        ("follower's memory (MB)", follower, np.median, 5.0, 0.05, hours),
        ("frames, one way, p50 (ms)", latency, np.median, 0.2, 0.5, 1.0),
        ("frames, one way, p99 (ms)", latency, p99, 2.0, 1.0, 1.0),
        ("leader's ticks over 1 ms late (%)", late, np.mean, 2.0, 1.0, 1.0),
    )
    checks = []
    for what, seen, figure, allowed, share, times in rows:
        times_s, values = seen[:, outside(seen[0], disturbed)]
        found = drift(*by_window(times_s, values, _window_s(times_s), figure))
        checks.append(_flat(what, found, allowed, share, span_s >= _TELLING_S, times))
    return checks


def _window_s(times_s: FloatArray) -> float:
    """Return a window's length: a hundredth of the time that is tested, within bounds."""
    span_s = float(np.ptp(times_s)) if len(times_s) else 0.0
    return min(max(span_s / _WINDOWS, _SHORTEST_WINDOW_S), _LONGEST_WINDOW_S)


def _flat(
    what: str, found: Drift, allowed: float, share: float, must_tell: bool, times: float
) -> Check:
    """Check a figure that may grow by `times` the sum of `allowed` and a share of its median."""
    if found.typical is None or found.growth is None:
        remark = "too few quiet stretches to tell"
        return Check(what, remark, "", held=not must_tell, figures=asdict(found))
    most = times * (allowed + share * abs(found.typical))
    return Check(
        what,
        f"{found.typical:.3g}, grew by {found.growth:+.2g}",
        f"grows by at most {most:.2g}",
        found.within(most),
        {**asdict(found), "allowed": most},
    )


def _longest_life(observed: SoakLog) -> FloatArray:
    """Return times and memory, (2, n), of the follower process that lived longest."""
    births = [*observed.lives_s, observed.end_s]
    spans = [(b - a, a, b) for a, b in pairwise(births)]
    _, start_s, end_s = max(spans, default=(0.0, 0.0, 0.0))
    warm_s = start_s + min(_WARM_UP_S, _WARM_UP_SHARE * (end_s - start_s))
    return _series(
        [(s.time_s, s.follower_mb) for s in observed.samples if warm_s < s.time_s < end_s]
    )


def _series(seen: Sequence[tuple[float, float | None]]) -> FloatArray:
    """Return times and values, (2, n), without values that are None."""
    kept = [pair for pair in seen if pair[1] is not None]
    return np.array(kept, dtype=np.float64).reshape(-1, 2).T


def _late(observed: SoakLog) -> FloatArray:
    """Return times and the percentage of late ticks since the sample before, (2, n)."""
    counts = np.array([(s.time_s, s.ticks, s.late_ticks) for s in observed.samples])
    time_s, ticks, late = counts.reshape(-1, 3).T
    share = 100.0 * np.diff(late) / np.maximum(np.diff(ticks), 1.0)
    return np.stack([time_s[1:], share])
