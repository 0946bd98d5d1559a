"""The services and their parts: clocks that step, stopped processes, and endless modelling."""

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.leader.output.playout import PlayoutBuffer
from mmt_lab.stability import endless
from mmt_lab.stability.cases import CaseResult, Extreme, Family
from mmt_lab.stability.endless import PERIOD_NS
from mmt_lab.stability.interrupted import interrupted_cases

_STEP_NS: Final = 10_000_000_000
_START_NS: Final = 100_000_000_000
_EVENT_MS: Final = 4000


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
            f"under {endless.MOST_BLOCKS} objects and {endless.MOST_MB:g} MB more, "
            f"time within {endless.MOST_SLOWER:g} x",
            partial(endless.run_endless_modelling, modelling_s),
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


FAMILY: Final = Family("Clocks, stops and endless modelling", cases)
