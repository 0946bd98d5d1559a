"""The services and their parts: clocks that step, stopped processes, and endless modelling."""

import asyncio
import gc
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import empty_frames
from mmt.leader.output.stream import PlayoutBuffer
from mmt.scene import Hand, Link
from mmt.session.mcap.reader import scanned_frames
from mmt.session.mcap.scan import scan_mcap
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import ModellingSettings
from mmt_lab.soak.judging import SoakLog
from mmt_lab.soak.services import SoakServices
from mmt_lab.stability.families import CaseResult, Extreme, Family

_STEP_NS: Final = 10_000_000_000
_START_NS: Final = 100_000_000_000
_EVENT_MS: Final = 4000

_BEFORE_S: Final = 1.5
_AFTER_S: Final = 4.0
_SPEED_MS: Final = 50
"""Speeds are means over this: the position sensor's noise is then under 1 mm/s."""

Judging = Callable[[dict[str, Any], RecordArray], CaseResult]

PERIOD_NS: Final = 1_000_000

MOST_BLOCKS: Final = 3000
MOST_MB: Final = 3.0
MOST_SLOWER: Final = 1.5

_SETTLED: Final = 2
"""Number of quarters after which everything has its final size."""
_STROKES: Final = 83
_STROKE_SAMPLES: Final = 240
"""Samples of a stroke that gives one segment."""


def cases(*, modelling_s: int = 600, stopped_s: float = 6.0) -> list[Extreme]:
    """Return the family's cases.

    The endless modelling lasts `modelling_s`, the stop of the leader `stopped_s`.
    """
    return [
        *(
            Extreme(
                f"streamed vibration, the {whose}'s clock steps by {step_ns / 1e9:+g} s",
                "not one sample missing, same delay within 2 ms",
                partial(_stepping_clock, whose == "follower", step_ns),
            )
            for whose in ("follower", "leader")
            for step_ns in (_STEP_NS, -_STEP_NS)
        ),
        *interrupted_cases(stopped_s),
        Extreme(
            f"a model that is never complete, {modelling_s} s of strokes in one corner",
            f"under {MOST_BLOCKS} objects and {MOST_MB:g} MB more, time within {MOST_SLOWER:g} x",
            partial(run_endless_modelling, modelling_s),
        ),
    ]


def play(lateness_ms: FloatArray, clocks: Callable[[int], tuple[int, int]]) -> FloatArray:
    """Play frames through a playout buffer; return the value played in each tick (n,).

    Frame k carries the value k + 1/3, so that a played value identifies its frame.

    Parameters
    ----------
    lateness_ms
        Lateness of each frame's arrival, shape (n,); no frame overtakes an earlier one.
    clocks
        From a tick to the offsets (ns) of the follower's and the leader's clock.
    """
    count = len(lateness_ms)
    arrivals_ms = np.maximum.accumulate(np.arange(count) + lateness_ms)
    buffer, played = PlayoutBuffer(), np.zeros(count)
    frame = 0
    for tick in range(count):
        _, leader_ns = clocks(tick)
        while frame < count and arrivals_ms[frame] <= tick:
            follower_ns, _ = clocks(frame)
            arrival_ns = round(arrivals_ms[frame] * 1e6) + leader_ns
            buffer.push(frame, frame * PERIOD_NS + follower_ns, arrival_ns, (frame + 1.0 / 3.0,))
            frame += 1
        (played[tick],) = buffer.pull(tick * PERIOD_NS + leader_ns)
    return played


def ages_ms(played: FloatArray) -> FloatArray:
    """Return the age of the value played in each tick (n,), NaN for silence and fading."""
    whole = np.abs(played % 1.0 - 1.0 / 3.0) < 1e-6
    return np.where(whole, np.arange(len(played)) - played, np.nan)


def _stepping_clock(of_follower: bool, step_ns: int) -> CaseResult:
    def clocks(tick: int) -> tuple[int, int]:
        stepped = step_ns if tick >= _EVENT_MS else 0
        return (stepped, _START_NS) if of_follower else (0, _START_NS + stepped)

    jitter_ms = 3.0 + np.random.default_rng(1).uniform(0.0, 2.0, 2 * _EVENT_MS)
    age_ms = ages_ms(play(jitter_ms, clocks))
    missing = int(np.isnan(age_ms[_EVENT_MS - 1000 :]).sum())
    before, after = (float(np.nanmedian(part)) for part in np.split(age_ms, [_EVENT_MS]))
    return CaseResult(
        f"{missing} missing, delay {before:.0f} ms before and {after:.0f} ms after",
        held=missing == 0 and abs(after - before) <= 2.0,
        figures={"missing": missing, "before_ms": before, "after_ms": after},
    )


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
        log = asyncio.run(_session(file, leader, length_s))
        if not log.leader:
            return CaseResult("; ".join(log.errors), held=False)
        return judge(log.leader, scanned_frames(scan_mcap(file)))


async def _session(file: Path, leader: bool, length_s: float) -> SoakLog:
    async with SoakServices(file, 0, lambda _: None) as services:
        await asyncio.sleep(_BEFORE_S)
        await services.pause(leader, length_s)
        await asyncio.sleep(_AFTER_S)
        await services.finish()
    return services.log


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


def growth(seen: FloatArray) -> tuple[int, float, float]:
    """Return the growth in blocks and MB over the second half of a run, and the slow-down.

    The slow-down is the processor's time for the last quarter over that for the third one. The
    rows of ``seen`` (5, 3) are those of `_seen`, at the start and after each quarter.
    """
    blocks, megabytes, seconds = seen.T
    spans = np.diff(seconds)
    return (
        int(blocks[-1] - blocks[_SETTLED]),
        float(megabytes[-1] - megabytes[_SETTLED]),
        float(spans[-1] / spans[_SETTLED]),
    )


def _seen() -> tuple[int, float, float]:
    """Return the process's interpreter blocks, resident memory in MB and processor time in s."""
    gc.collect()
    spent_s = time.thread_time()
    return sys.getallocatedblocks(), psutil.Process().memory_info().rss / 1e6, spent_s


def corner_strokes() -> RecordArray:
    """Return frames (n,) of strokes to and fro in one corner of the plane."""
    generator = np.random.default_rng(0)
    speed = generator.uniform(20.0, 80.0, _STROKES)
    force = generator.uniform(0.2, 0.8, _STROKES)
    way = np.repeat(speed * (-1.0) ** np.arange(_STROKES), _STROKE_SAMPLES)
    frames = empty_frames(len(way))
    frames["position_mm"][:, 0] = np.cumsum(way) / 1000.0
    frames["force_n"][:, 2] = np.repeat(force, _STROKE_SAMPLES)
    level = np.repeat(speed * force / 300.0, _STROKE_SAMPLES)
    frames["acceleration_m_s2"][:, 2] = 9.81 + level * generator.standard_normal(len(way))
    return frames


def run_endless_modelling(seconds: int) -> CaseResult:
    """Model a hand that stays in one corner, so that the criterion of distances is never met."""
    settings = ModellingSettings(method="published")  # an expected share would be met
    modeller, strokes = OnlineModeller(settings), corner_strokes()
    seen = [_seen()]
    updates_s = []
    for second in range(1, seconds + 1):
        number = np.arange(1000 * (second - 1), 1000 * second)
        frames = strokes[number % len(strokes)]
        frames["sequence"], frames["time_ns"] = number, number * PERIOD_NS
        update = modeller.update(frames)
        updates_s.append(sum(update.durations_s.values()))
        if 4 * second >= seconds * len(seen):
            seen.append(_seen())
    update_ms = 1e3 * float(np.median(updates_s[seconds // 2 :]))
    blocks, megabytes, slower = growth(np.array(seen))
    return CaseResult(
        f"{update.samples} samples, {blocks:+d} objects, {megabytes:+.1f} MB, {slower:.2f} x the "
        f"time, update {update_ms:.0f} ms",
        held=blocks < MOST_BLOCKS
        and megabytes < MOST_MB
        and slower < MOST_SLOWER
        and not update.started,
        figures={
            "samples": update.samples,
            "growth_blocks": blocks,
            "growth_mb": megabytes,
            "slower": slower,
            "update_ms": update_ms,
        },
    )


FAMILY: Final = Family("Clocks, stops and endless modelling", cases)
