"""Times of frames against those of what they hold: arrays in, figures out."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.arrays import FloatArray, IntArray
from mmt.evaluation.device_bench.motion import PERIOD_NS
from mmt.ticking import LATE_NS

_MS: Final = 1e6


def time_errors_ms(values: FloatArray, times_ns: IntArray) -> FloatArray:
    """Return how much later than a frame says its value was there, shape (n,).

    Parameters
    ----------
    values
        Vectors that turn as `Motion` does, (n, 3).
    times_ns
        What the frames say, (n,).
    """
    turned = np.arctan2(values[:, 1], values[:, 0]) / (2.0 * np.pi)
    apart = turned - (times_ns % PERIOD_NS) / PERIOD_NS
    return np.asarray((apart - np.round(apart)) * (PERIOD_NS / _MS), dtype=np.float64)


@dataclass(frozen=True)
class FrameTimes:
    """How late frames are and how true their times; all in ms."""

    latency_p50_ms: float
    """From the instant of a frame's oldest value to when the frame is there, less the latency
    that the slowest sensor states of itself."""
    latency_p99_ms: float
    on_time_p99_ms: float | None
    """The same of the frames of ticks that came less than 1 ms late; None where none did."""
    jitter_p99_ms: dict[str, float]
    """By the channel: how far the error of the time is from its median."""
    offset_ms: dict[str, float]
    """By the channel: the median error of the time, which is the transport that nobody sees."""
    apart_p99_ms: float
    """Between the instants of two values of one frame."""


def late_ns(ticked: IntArray, period_ns: int, numbers: IntArray) -> IntArray:
    """Return how late the tick came at which a frame fell due, shape (n,).

    The quickest tick of all was on time.

    Parameters
    ----------
    ticked
        How many ticks had fallen due by then, and the time, for each call of a ticker, (m, 2).
    period_ns
        From tick to tick.
    numbers
        Of the frames, 0 for that of the first tick, (n,).
    """
    counts, times = ticked[:, 0], ticked[:, 1]
    start_ns = np.min(times - counts * period_ns)
    due = numbers.astype(np.int64) + 1
    call = np.minimum(np.searchsorted(counts, due), len(counts) - 1)
    return np.asarray(times[call] - start_ns - due * period_ns)


def frame_times(
    values: dict[str, FloatArray],
    times_ns: IntArray,
    formed_ns: IntArray,
    late_ns: IntArray,
    stated_ms: float,
) -> FrameTimes:
    """Compare frames with the motion that they are of.

    Parameters
    ----------
    values
        Force and acceleration, (n, 3) each, by the channel.
    times_ns, formed_ns
        What the frames say, and when each of them was there, (n,).
    late_ns
        How late their ticks were, (n,).
    stated_ms
        The largest latency that a sensor states of itself.
    """
    errors = {name: time_errors_ms(value, times_ns) for name, value in values.items()}
    stacked = np.stack(list(errors.values()))
    added = (formed_ns - times_ns) / _MS - stacked.min(axis=0) - stated_ms
    on_time = added[late_ns < LATE_NS]
    return FrameTimes(
        latency_p50_ms=float(np.median(added)),
        latency_p99_ms=float(np.percentile(added, 99)),
        on_time_p99_ms=float(np.percentile(on_time, 99)) if len(on_time) else None,
        jitter_p99_ms={
            name: float(np.percentile(np.abs(error - np.median(error)), 99))
            for name, error in errors.items()
        },
        offset_ms={name: float(np.median(error)) for name, error in errors.items()},
        apart_p99_ms=float(np.percentile(np.ptp(stacked, axis=0), 99)),
    )
