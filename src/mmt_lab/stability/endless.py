"""A stream whose model is never complete: memory of the process, and time of updates."""

import gc
import sys
import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import psutil

from mmt.core.arrays import RecordArray
from mmt.core.frames import empty_frames
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import ModellingSettings
from mmt_lab.stability.cases import CaseResult

PERIOD_NS: Final = 1_000_000

MOST_BLOCKS: Final = 3000
MOST_MB: Final = 3.0
MOST_SLOWER: Final = 1.5

_SETTLED: Final = 2
"""Number of quarters after which everything has its final size."""
_STROKES: Final = 83
_STROKE_SAMPLES: Final = 240
"""Samples of a stroke that gives one segment."""


@dataclass
class MemoryWatch:
    """Memory of the process after each quarter of a run: interpreter blocks, resident memory."""

    blocks: list[int] = field(default_factory=list)
    megabytes: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def sample(self) -> None:
        """Note the present state."""
        gc.collect()
        self.seconds.append(time.thread_time())
        self.blocks.append(sys.getallocatedblocks())
        self.megabytes.append(psutil.Process().memory_info().rss / 1e6)

    def growth(self) -> tuple[int, float, float]:
        """Return the growth in blocks and MB over the second half, and the slow-down.

        The slow-down is the processor's time for the last quarter over that for the third one.
        """
        spans = np.diff(self.seconds)
        return (
            self.blocks[-1] - self.blocks[_SETTLED],
            self.megabytes[-1] - self.megabytes[_SETTLED],
            float(spans[-1] / spans[_SETTLED]),
        )

    def flat(self) -> bool:
        """Return whether growth and slow-down are within their bounds."""
        blocks, megabytes, slower = self.growth()
        return blocks < MOST_BLOCKS and megabytes < MOST_MB and slower < MOST_SLOWER


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
    modeller, watch = OnlineModeller(settings), MemoryWatch()
    strokes = corner_strokes()
    watch.sample()
    updates_s = []
    for second in range(1, seconds + 1):
        number = np.arange(1000 * (second - 1), 1000 * second)
        frames = strokes[number % len(strokes)]
        frames["sequence"], frames["time_ns"] = number, number * PERIOD_NS
        update = modeller.update(frames)
        updates_s.append(sum(update.durations_s.values()))
        if 4 * second >= seconds * len(watch.seconds):
            watch.sample()
    update_ms = 1e3 * float(np.median(updates_s[seconds // 2 :]))
    blocks, megabytes, slower = watch.growth()
    return CaseResult(
        f"{update.samples} samples, {blocks:+d} objects, {megabytes:+.1f} MB, {slower:.2f} x the "
        f"time, update {update_ms:.0f} ms",
        held=watch.flat() and not update.started,
        figures={
            "samples": update.samples,
            "growth_blocks": blocks,
            "growth_mb": megabytes,
            "slower": slower,
            "update_ms": update_ms,
        },
    )
