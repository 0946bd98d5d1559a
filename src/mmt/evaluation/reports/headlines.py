"""The ten figures by which two runs or evaluations are compared first, and which is better."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from mmt.evaluation.reports.document import ReportTable
from mmt.evaluation.run_verdict import final_of, median_of_most, run_verdict
from mmt.evaluation.texts import number, seconds, share

_SESSION: Final = (
    ("from the model since (s)", "start_s", "sooner", seconds),
    ("complete at (s)", "stop_s", "sooner", seconds),
    ("error, strokes made (dB)", "power_error_db", "less", lambda value: number(value, 2)),
    ("within JND, strokes made", "within_jnd", "more", share),
    ("error, whole plane (dB)", "plane_power_error_db", "less", lambda value: number(value, 2)),
    ("within JND, whole plane", "plane_within_jnd", "more", share),
    ("GFC, held-out segments", "gfc", "more", lambda value: number(value, 3)),
    ("spectrum (dB)", "truth_log_spectral_db", "less", lambda value: number(value, 2)),
)
"""Title, key of a session or of its score at the stop criterion, what is better, and format.

If sooner is better, a missing time counts as never.
"""

_RUN: Final = (
    ("latency p99 (ms)", "link", "latency_p99_ms", lambda value: number(value, 1)),
    ("ticks over 1 ms late", "ticks", "late_share_1ms", share),
)
"""Title, table and key in the leader's summary, and format; less is better."""


class Headline(NamedTuple):
    """One figure of two reports, as text, and whether B is better; empty if that is not known."""

    title: str
    left: str
    right: str
    verdict: str


def headlines(left: Mapping[str, Any], right: Mapping[str, Any]) -> list[Headline]:
    """Return the verdicts, then figures that one of two summaries has; medians of sessions."""
    found = []
    for title, key, better, text in _SESSION:
        values = [_of_sessions(data, key) for data in (left, right)]
        found.append((title, values, better, text))
    for title, part, key, text in _RUN:
        leaders = [data.get("run", {}).get("leader", {}) for data in (left, right)]
        found.append((title, [each.get(part, {}).get(key) for each in leaders], "less", text))
    told = [_verdict(data) for data in (left, right)]
    verdicts = [Headline("verdict", told[0], told[1], "")] if all(told) else []
    return verdicts + [
        Headline(title, text(values[0]), text(values[1]), _verdict_on(values, better))
        for title, values, better, text in found
        if any(value is not None for value in values)
    ]


def headline_table(found: Sequence[Headline]) -> ReportTable:
    """Return the figures as a table."""
    return ReportTable(("figure", "A", "B", "B is"), found)


def _verdict(data: Mapping[str, Any]) -> str:
    """Return the verdict on the run or sessions of a report; "" for a report of measurements."""
    run = data.get("run", {})
    services = {name: run[name] for name in ("leader", "follower") if name in run}
    sessions = data.get("sessions")
    found = run_verdict(services, {"sessions": sessions} if sessions else None)
    return found.sentence if sessions or "outcome" in services.get("leader", {}) else ""


def _of_sessions(data: Mapping[str, Any], key: str) -> float | None:
    """Return the median over the sessions that have a figure; None if most have none."""
    return median_of_most(
        session[key] if key in session else final_of(session).get(key)
        for session in data.get("sessions") or []
    )


def _verdict_on(values: Sequence[float | None], better: str) -> str:
    never = math.inf if better == "sooner" else None
    left, right = (never if value is None else value for value in values)
    if left == right:
        return "equal"
    if left is None or right is None:
        return ""
    return "better" if (right < left) == (better != "more") else "worse"
