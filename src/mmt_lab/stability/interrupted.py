"""Services that are stopped in a session: processes of the demo's scene, joined as in a soak."""

import asyncio
import signal
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.scene import Hand, Link
from mmt.session.mcap_reader import scanned_frames
from mmt.session.mcap_scan import scan_mcap
from mmt_lab.soak.services import SoakServices
from mmt_lab.stability.cases import CaseResult, Extreme

_BEFORE_S: Final = 1.5
_AFTER_S: Final = 4.0
_SPEED_MS: Final = 50
"""Speeds are means over this: the position sensor's noise is then under 1 mm/s."""

Judging = Callable[[dict[str, Any], RecordArray], CaseResult]


def interrupted_cases(stopped_s: float) -> list[Extreme]:
    """Return the cases, or none if the system cannot stop a process.

    `stopped_s` is how long the leader is stopped.
    """
    fastest_mm_s = Hand().fastest_mm_s + Link().recovery_mm_s
    stopping = Extreme(
        f"the leader stopped for {stopped_s:g} s in a session",
        "it goes on, and every frame of that time is filled in",
        partial(_with_a_stop, judge_stop, leader=True, length_s=stopped_s),
    )
    stalling = Extreme(
        "the follower stopped for 1 s while the hand strokes",
        f"the robot catches up at {fastest_mm_s:g} mm/s at most",
        partial(_with_a_stop, partial(judge_speed, fastest_mm_s), leader=False, length_s=1.0),
    )
    return [stopping, stalling] if hasattr(signal, "SIGSTOP") else []


def _with_a_stop(judge: Judging, *, leader: bool, length_s: float) -> CaseResult:
    """Run the demo's services, stop one, and judge the leader's summary and recording."""
    with tempfile.TemporaryDirectory(prefix="mmt-stability-") as directory:
        file = Path(directory) / "session.mcap"
        services = asyncio.run(_session(file, leader, length_s))
        if not services.summary:
            return CaseResult("; ".join(services.errors), held=False)
        return judge(services.summary, scanned_frames(scan_mcap(file)))


async def _session(file: Path, leader: bool, length_s: float) -> SoakServices:
    async with SoakServices(file, 0, lambda _: None) as services:
        await asyncio.sleep(_BEFORE_S)
        await services.pause(leader, length_s)
        await asyncio.sleep(_AFTER_S)
        await services.finish()
    return services


def judge_stop(summary: dict[str, Any], frames: RecordArray) -> CaseResult:
    """Judge a session in which the leader was stopped, by its summary and its frames (n,)."""
    gaps = summary.get("backfill", {"filled": 0, "lost": 0})  # absent if nothing was missing
    steps = np.diff(frames["sequence"].astype(np.int64))
    absent = int((steps - 1).sum())
    return CaseResult(
        f"{summary['outcome']}; {gaps['filled']} frames filled in, {absent} not in the recording",
        held=summary["outcome"] == "stopped" and gaps["lost"] == absent == 0,
        figures={"filled": gaps["filled"], "lost": gaps["lost"], "absent": absent},
    )


def judge_speed(fastest_mm_s: float, summary: dict[str, Any], frames: RecordArray) -> CaseResult:
    """Judge the robot's largest speed, over stretches without a missing frame."""
    place, number = frames["position_mm"].astype(np.float64), frames["sequence"].astype(np.int64)
    whole = number[_SPEED_MS:] - number[:-_SPEED_MS] == _SPEED_MS
    way_mm = np.linalg.norm(place[_SPEED_MS:] - place[:-_SPEED_MS], axis=1)[whole]
    speed_mm_s = float(1000.0 * way_mm.max() / _SPEED_MS)
    return CaseResult(
        f"{summary['outcome']}; {speed_mm_s:.0f} mm/s",
        held=summary["outcome"] == "stopped" and speed_mm_s <= 1.05 * fastest_mm_s,
        figures={"mm_s": speed_mm_s},
    )
