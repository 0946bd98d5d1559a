"""An hour of uptime at speed: the leader's parts on a fake clock."""

import gc
import random
import sys
import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import psutil

from mmt.core.arrays import RecordArray
from mmt.core.frames import empty_frames
from mmt.core.ticking import Ticker
from mmt.leader.modelling.frame_queue import FrameQueue
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.numbering import SessionNumbering
from mmt.leader.output.playout import PlayoutBuffer
from mmt.leader.output.stream import StreamedVibration
from mmt.leader.output.vibration import VibrationSwitch
from mmt.testing.simulation.actuator import SimulatedActuator
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import ModellingSettings
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.stability.cases import CaseResult
from mmt_lab.stability.fake_time import FakeClock, run_in_fake_time

PERIOD_NS: Final = 1_000_000
PATTERN_SAMPLES: Final = 20_000

MOST_BLOCKS: Final = 3000
MOST_MB: Final = 3.0
MOST_SLOWER: Final = 1.5

_LATE_NS: Final = 12_000_000
_NETWORK_NS: Final = 3_000_000
_CLOCK_DRIFT: Final = 50e-6
_SHORT_STROKE: Final = 240
"""Samples of a stroke that gives one segment."""


@dataclass
class MemoryWatch:
    """What the process holds at each quarter: interpreter blocks, and resident memory.

    ``since``: the quarter at whose end everything has its final size.
    """

    since: int = 1
    blocks: list[int] = field(default_factory=list)
    megabytes: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def look(self) -> None:
        """Note the present state."""
        gc.collect()
        self.seconds.append(time.thread_time())
        self.blocks.append(sys.getallocatedblocks())
        self.megabytes.append(psutil.Process().memory_info().rss / 1e6)

    def growth(self) -> tuple[int, float, float]:
        """Return blocks and MB from then to the end, and the slow-down.

        The slow-down is the processor's time for the last quarter over that for the first one
        after `since`.
        """
        spans = np.diff(self.seconds)
        return (
            self.blocks[-1] - self.blocks[self.since],
            self.megabytes[-1] - self.megabytes[self.since],
            float(spans[-1] / spans[self.since]),
        )

    def figures(self) -> dict[str, float]:
        """Return the growth by name."""
        names = ("growth_blocks", "growth_mb", "slower")
        return dict(zip(names, self.growth(), strict=True))

    def flat(self) -> bool:
        """Say whether nothing has grown."""
        blocks, megabytes, slower = self.growth()
        return blocks < MOST_BLOCKS and megabytes < MOST_MB and slower < MOST_SLOWER

    def as_text(self) -> str:
        """Return the growth in words."""
        blocks, megabytes, slower = self.growth()
        return f"{blocks:+d} objects, {megabytes:+.1f} MB, {slower:.2f} x the time"


def stroke_pattern(samples: int, *, whole_plane: bool, stroke_samples: int = 1000) -> RecordArray:
    """Return frames (n,) of strokes to and fro, over the plane or in one corner of it."""
    generator = np.random.default_rng(0)
    strokes = samples // stroke_samples
    speed = generator.uniform(20.0, 290.0 if whole_plane else 80.0, strokes)
    force = generator.uniform(0.2, 2.8 if whole_plane else 0.8, strokes)
    way = np.repeat(speed * (-1.0) ** np.arange(strokes), stroke_samples)
    frames = empty_frames(len(way))
    frames["position_mm"][:, 0] = np.cumsum(way) / 1000.0
    frames["force_n"][:, 2] = np.repeat(force, stroke_samples)
    level = np.repeat(speed * force / 300.0, stroke_samples)
    frames["acceleration_m_s2"][:, 2] = 9.81 + level * generator.standard_normal(len(way))
    return frames


class FrameSource:
    """Endless frames from a pattern, on a clock that runs slow by 50 in a million."""

    def __init__(self, pattern: RecordArray) -> None:
        self._twice = np.concatenate([pattern, pattern])
        self._length = len(pattern)
        self.sent = 0

    def until(self, now_ns: int) -> RecordArray:
        """Return the frames (n,) that the follower has made since the last call."""
        made = int((now_ns - _NETWORK_NS) * (1.0 - _CLOCK_DRIFT)) // PERIOD_NS
        count = min(max(0, made - self.sent), self._length)
        first = self.sent % self._length
        frames = self._twice[first : first + count].copy()
        frames["sequence"] = np.arange(self.sent, self.sent + count)
        frames["time_ns"] = np.arange(self.sent, self.sent + count) * PERIOD_NS
        self.sent += count
        return frames


class _Display:
    """Takes the force; stands in for the leader's interface."""

    def __init__(self) -> None:
        self.largest_n = 0.0

    def write(self, force_n: tuple[float, float, float]) -> None:
        self.largest_n = max(self.largest_n, force_n[2])


class LeaderInProcess:
    """The leader's parts, joined as `Leader` joins them, without link and recorder."""

    def __init__(self) -> None:
        self.playout = PlayoutBuffer()
        self.vibration = StreamedVibration(self.playout, "z", 1000.0)
        self.display = _Display()
        self.feedback = StreamedForce(self.display, limit_n=2.0)
        self.modeller: OnlineModeller | None = OnlineModeller()
        self.queue = FrameQueue(10_000, least_drop=1000)
        self.dropped = 0
        self.synthesizer = Synthesizer(seed=1, renewal_samples=10)
        self.switch = VibrationSwitch(self.playout.pull, self.synthesizer, crossfade_samples=50)
        self.actuator = SimulatedActuator(limit_m_s2=60.0)
        self.numbering = SessionNumbering(PERIOD_NS)

    def receive(self, frames: RecordArray, arrival_ns: int) -> None:
        """Handle frames as they arrive."""
        if not len(frames):
            return
        frames, _ = self.numbering.number(frames, arrival_ns)
        self.vibration.on_frames(frames, arrival_ns)
        self.feedback.on_frames(frames)
        if self.modeller is not None:
            self.dropped += self.queue.put(frames)
            if self.queue.first_sequence is not None and (
                int(frames["sequence"][-1]) - self.queue.first_sequence >= 999
            ):
                self._model(self.modeller)

    def tick(self, now_ns: int, elapsed: int) -> None:
        """Render the elapsed ticks."""
        self.feedback.tick(elapsed, None)
        hand = np.full(elapsed, 150.0), np.full(elapsed, 1.5)
        self.actuator.write(self.switch.render(now_ns, *hand))

    def _model(self, modeller: OnlineModeller) -> None:
        update = modeller.update(self.queue.pop_all())
        if update.started and update.model is not None:
            self.synthesizer.model = update.model
            self.switch.use_model(True)
        if update.stopped:
            self.modeller = None


def run_hour(samples: int) -> CaseResult:
    """Run the leader's parts for `samples` ticks of a fake clock, waking late at random."""
    chance = random.Random(1)  # noqa: S311 - no secret
    clock = FakeClock(lambda: int(chance.expovariate(1.0 / _LATE_NS)))
    leader, watch = LeaderInProcess(), MemoryWatch()
    source = FrameSource(stroke_pattern(PATTERN_SAMPLES, whole_plane=True))
    started_ns = clock.now_ns()
    ticks = 0

    def tick(elapsed: int) -> None:
        nonlocal ticks
        ticks += elapsed
        now_ns = clock.now_ns()
        leader.receive(source.until(now_ns - started_ns), now_ns)
        leader.tick(now_ns, elapsed)
        if ticks * 4 >= samples * len(watch.seconds):
            watch.look()
        if ticks >= samples:
            ticker.stop()

    ticker = Ticker(PERIOD_NS, tick, clock_ns=clock.now_ns)

    async def work() -> None:
        ticker.start()
        await ticker.wait()

    watch.look()
    run_in_fake_time(clock, work)
    drift_ticks = ticks - (clock.now_ns() - started_ns) // PERIOD_NS
    return _judge(leader, watch, ticks, drift_ticks)


def _judge(leader: LeaderInProcess, watch: MemoryWatch, ticks: int, drift_ticks: int) -> CaseResult:
    playout, actuator = leader.playout.statistics(), leader.actuator.statistics
    held = (
        drift_ticks == 0
        and actuator.samples == ticks
        and watch.flat()
        and leader.dropped == 0
        and playout.resyncs <= 1
        and leader.modeller is None
        and leader.display.largest_n <= 2.0 + 1e-9
    )
    return CaseResult(
        f"{ticks} ticks, drift {drift_ticks}, {watch.as_text()}, {playout.slips} slips, "
        f"{playout.resyncs} jumps",
        held=held,
        figures={
            "ticks": ticks,
            "drift_ticks": drift_ticks,
            **watch.figures(),
            "slips": playout.slips,
            "resyncs": playout.resyncs,
            "bridged": playout.bridged,
        },
    )


def run_endless_modelling(seconds: int) -> CaseResult:
    """Model a hand that stays in one corner, so that the sum of distances is never met."""
    settings = ModellingSettings(method="published")  # an expected share is of its own strokes
    modeller, watch = OnlineModeller(settings), MemoryWatch(since=2)
    pattern = stroke_pattern(PATTERN_SAMPLES, whole_plane=False, stroke_samples=_SHORT_STROKE)
    source = FrameSource(pattern)
    watch.look()
    updates_s = []
    for second in range(1, seconds + 1):
        update = modeller.update(source.until(second * 1000 * PERIOD_NS + _NETWORK_NS))
        updates_s.append(sum(update.durations_s.values()))
        if 4 * second >= seconds * len(watch.seconds):
            watch.look()
    update_ms = 1e3 * float(np.median(updates_s[seconds // 2 :]))
    return CaseResult(
        f"{update.samples} samples, {watch.as_text()}, update {update_ms:.0f} ms",
        held=watch.flat() and not update.started,
        figures={
            "samples": update.samples,
            **watch.figures(),
            "update_ms": update_ms,
        },
    )
