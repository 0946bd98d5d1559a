"""Clocks that step, a process that is held up, frames that come late."""

import asyncio
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.ticking import Ticker
from mmt.leader.numbering import SessionNumbering
from mmt.leader.output.playout import PlayoutBuffer
from mmt_lab.stability.cases import CaseResult, Extreme
from mmt_lab.stability.fake_time import FakeClock, run_in_fake_time
from mmt_lab.stability.uptime import PERIOD_NS, stroke_pattern

STEP_NS: Final = 10_000_000_000

_START_NS: Final = 100_000_000_000
_EVENT_MS: Final = 4000
_BURST_MS: Final = 2000


def clock_cases(real_s: float) -> Iterator[Extreme]:
    """Yield the cases of clocks and late frames; `real_s` seconds run on the system's clock."""
    for whose, step_ns in (
        ("follower", STEP_NS),
        ("follower", -STEP_NS),
        ("leader", STEP_NS),
        ("leader", -STEP_NS),
    ):
        yield Extreme(
            f"streamed vibration, the {whose}'s clock steps by {step_ns / 1e9:+g} s",
            "not one sample missing, same delay within 2 ms",
            partial(_stepping_clock, whose == "follower", step_ns),
        )
    for step_ns in (STEP_NS, -STEP_NS):
        yield Extreme(
            f"a follower that starts anew on a clock {step_ns / 1e9:+g} s off",
            "sequence and time go on",
            partial(_other_clock, step_ns),
        )
    yield Extreme(
        "ticks on a clock that is 10 s ahead at once (a process that was held up)",
        "every tick handed over, none drifts",
        _suspended,
    )
    yield Extreme(
        f"ticks on the system's clock for {real_s:g} s, held up by 0 to 200 ms at a time",
        "every tick handed over, none drifts",
        partial(_held_up, real_s),
    )
    yield Extreme(
        "streamed vibration, 2 s of frames late in one burst",
        "silent while late, nothing older than 110 ms, back within 60 ms",
        _late_burst,
    )


def play(lateness_ms: FloatArray, clocks: Callable[[int], tuple[int, int]]) -> FloatArray:
    """Play frames through a playout buffer; return what is played in each tick (n,).

    Frame k carries the value k + 1/3, so that a played value identifies its frame.

    Parameters
    ----------
    lateness_ms
        Lateness of each frame's arrival, shape (n,); frames overtake none before them.
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
    """Return the age of what is played in each tick (n,), NaN where it is silent or fading."""
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


def _late_burst() -> CaseResult:
    late_ms = np.full(2 * _EVENT_MS + _BURST_MS, 3.0)
    late_ms[_EVENT_MS : _EVENT_MS + _BURST_MS] += np.arange(_BURST_MS, 0, -1)
    played = play(late_ms, lambda _: (0, _START_NS))
    age_ms = ages_ms(played)
    during = np.abs(played[_EVENT_MS + 30 : _EVENT_MS + _BURST_MS]).max()
    silent = np.flatnonzero(np.isnan(age_ms[_EVENT_MS + _BURST_MS :]))
    back_ms = int(silent[-1]) + 1 if len(silent) else 0
    oldest_ms = float(np.nanmax(age_ms[1000:]))
    return CaseResult(
        f"{'silent' if during == 0.0 else 'audible'} while late, oldest {oldest_ms:.0f} ms, "
        f"back after {back_ms} ms",
        held=during == 0.0 and oldest_ms <= 110.0 and back_ms <= 60,
        figures={"oldest_ms": oldest_ms, "back_ms": back_ms},
    )


def _other_clock(step_ns: int) -> CaseResult:
    numbering = SessionNumbering(PERIOD_NS)
    pattern = stroke_pattern(2000, whole_plane=True)
    first, second = pattern[:1000].copy(), pattern[1000:].copy()
    for frames, offset_ns in ((first, 0), (second, step_ns)):
        frames["sequence"] = np.arange(1000)
        frames["time_ns"] = _START_NS + offset_ns + np.arange(1000) * PERIOD_NS
    before, _ = numbering.number(first, _START_NS + 1000 * PERIOD_NS)
    numbering.reconnect()
    after, left_out = numbering.number(second, _START_NS + 3000 * PERIOD_NS)
    gap = int(after["sequence"][0]) - int(before["sequence"][-1])
    gap_ms = (int(after["time_ns"][0]) - int(before["time_ns"][-1])) / 1e6
    return CaseResult(
        f"{left_out} frames missing, then the sequence goes on by {gap}, time by {gap_ms:.0f} ms",
        held=gap == left_out + 1 and abs(gap_ms - gap) <= 1.0 and left_out > 0,
        figures={"sequence_gap": gap, "time_gap_ms": gap_ms},
    )


def _suspended() -> CaseResult:
    """Let the clock run ahead by 10 s in the midst of a run of 20 s."""
    waits = iter(range(10**9))
    clock = FakeClock(lambda: STEP_NS if next(waits) == 5000 else 0)
    elapsed: list[int] = []
    started_ns = clock.now_ns()

    def tick(ticks: int) -> None:
        elapsed.append(ticks)
        if len(elapsed) >= 10_000:
            ticker.stop()

    ticker = Ticker(PERIOD_NS, tick, clock_ns=clock.now_ns)

    async def work() -> None:
        ticker.start()
        await ticker.wait()

    run_in_fake_time(clock, work)
    passed = (clock.now_ns() - started_ns) // PERIOD_NS
    return CaseResult(
        f"{sum(elapsed)} ticks in {passed} ms, {max(elapsed)} of them at once",
        held=sum(elapsed) == passed and max(elapsed) > STEP_NS // PERIOD_NS,
        figures={"ticks": sum(elapsed), "passed_ms": passed},
    )


def _held_up(seconds: float) -> CaseResult:
    """Hold up a real loop at random; count the ticks against the clock."""
    pauses_s = np.random.default_rng(2).uniform(0.0, 0.2, 1000)

    async def run() -> tuple[int, int, int]:
        count = 0

        def tick(elapsed: int) -> None:
            nonlocal count
            count += elapsed

        ticker = Ticker(PERIOD_NS, tick)
        started_ns = time.monotonic_ns()
        ticker.start()
        for pause_s in pauses_s:
            if time.monotonic_ns() - started_ns > 1e9 * seconds:
                break
            time.sleep(pause_s)
            await asyncio.sleep(0.005)
        await asyncio.sleep(0.02)
        before = (time.monotonic_ns() - started_ns) // PERIOD_NS
        await asyncio.sleep(0.02)
        ticker.stop()
        return before, count, (time.monotonic_ns() - started_ns) // PERIOD_NS

    least, count, most = asyncio.run(run())
    return CaseResult(
        f"{count} ticks in {least} to {most} ms",
        held=least - 1 <= count <= most + 1,
        figures={"ticks": count, "passed_ms": most},
    )
