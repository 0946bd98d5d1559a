"""The services and their parts over faults, clocks that step, late frames, an hour of uptime."""

import time
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.leader.modelling.frame_queue import FrameQueue
from mmt.leader.output.stream import StreamedMotion
from mmt.texture.signals.filtering import StreamFilter
from mmt_lab.stability import uptime
from mmt_lab.stability.cases import CaseResult, Extreme, Family
from mmt_lab.stability.clocks import clock_cases
from mmt_lab.stability.interrupted import interrupted_cases
from mmt_lab.stability.stalls import stall_cases
from mmt_lab.stability.uptime import PERIOD_NS, stroke_pattern

_FLAT: Final = 1.5


def cases(
    *,
    hour_samples: int = 3_600_000,
    modelling_s: int = 600,
    real_s: float = 1.5,
    stopped_s: float = 6.0,
) -> list[Extreme]:
    """Return the family's cases.

    Parameters
    ----------
    hour_samples
        Ticks of the simulated uptime.
    modelling_s
        Seconds of the stream that never completes a model.
    real_s
        Seconds on the system's own clock.
    stopped_s
        Seconds for which a service is stopped.
    """
    return [
        *clock_cases(real_s),
        *stall_cases(),
        *interrupted_cases(stopped_s),
        Extreme(
            "filters, the same frames evenly and in bursts of 2 s",
            "the same to the bit",
            _filters_in_bursts,
        ),
        Extreme(
            "filters at rest for a minute after a stroke",
            f"time a frame within {_FLAT:g} x of the stroke's",
            _filters_at_rest,
        ),
        Extreme(
            "frames for the model, bursts of 2 s and of 20 s",
            "none of 2 s dropped, of 20 s the oldest and counted",
            _queue_in_bursts,
        ),
        Extreme(
            f"the leader's parts for {hour_samples} ticks, waking 12 ms late on average",
            f"no drift, under {uptime.MOST_BLOCKS} objects and {uptime.MOST_MB:g} MB more, "
            f"time within {uptime.MOST_SLOWER:g} x",
            partial(uptime.run_hour, hour_samples),
        ),
        Extreme(
            f"a model that is never complete, {modelling_s} s of strokes in one corner",
            f"under {uptime.MOST_BLOCKS} objects and {uptime.MOST_MB:g} MB more, "
            f"time within {uptime.MOST_SLOWER:g} x",
            partial(uptime.run_endless_modelling, modelling_s),
        ),
    ]


def _filters_in_bursts() -> CaseResult:
    frames = numbered(stroke_pattern(20_000, whole_plane=True))
    outputs = []
    for block in (7, 2000):
        stream = StreamFilter()
        blocks = [
            stream.process(frames[start : start + block]) for start in range(0, len(frames), block)
        ]
        outputs.append(
            [
                np.concatenate([getattr(part, name) for part in blocks])
                for name in ("index", "position_mm", "speed_mm_s", "vibration_m_s2")
            ]
        )
    same = all(np.array_equal(even, burst) for even, burst in zip(*outputs, strict=True))
    return CaseResult(f"{len(outputs[0][0])} frames {'the same' if same else 'differ'}", held=same)


def numbered(frames: RecordArray) -> RecordArray:
    """Return the frames (n,), numbered from 0 on and a period apart."""
    frames["sequence"] = np.arange(len(frames))
    frames["time_ns"] = np.arange(len(frames)) * PERIOD_NS
    return frames


def _filters_at_rest() -> CaseResult:
    """Feed silence after a stroke: states that decay for ever would become denormal."""
    stroke = stroke_pattern(10_000, whole_plane=True)
    frames = numbered(np.concatenate([stroke, *[np.zeros_like(stroke)] * 6]))
    stream, motion = StreamFilter(), StreamedMotion("z", 1000.0)
    seconds = []
    for start in range(0, len(frames), 1000):
        block = frames[start : start + 1000]
        started = time.thread_time()
        stream.process(block)
        motion.on_frames(block, 0)
        seconds.append(time.thread_time() - started)
    ratio = float(np.quantile(seconds[10:], 0.1) / np.quantile(seconds[:10], 0.1))
    return CaseResult(f"{ratio:.2f} x", held=ratio < _FLAT, figures={"rest_over_stroke": ratio})


def _queue_in_bursts() -> CaseResult:
    queue = FrameQueue(10_000, least_drop=1000)
    frames = numbered(stroke_pattern(20_000, whole_plane=True))
    short = queue.put(frames[:2000])
    kept_short = len(queue.pop_all())
    long = queue.put(frames)
    kept = queue.pop_all()
    newest = bool(kept["sequence"][-1] == 19_999)
    return CaseResult(
        f"of 2 s {short} dropped, of 20 s {long} dropped and {len(kept)} kept, "
        f"{'the newest' if newest else 'not the newest'}",
        held=short == 0 and kept_short == 2000 and long + len(kept) == 20_000 and newest,
    )


FAMILY: Final = Family("Clocks, bursts and uptime", cases)
