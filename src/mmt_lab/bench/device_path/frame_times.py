"""Vectors that turn, so that a value tells its time, and the times of frames judged by them."""

import math
import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.devices.protocols import Vector

PERIOD_NS: Final = 50_000_000
"""Period of a turn; a value tells the time within it, even if a filter changes its length."""

HELD_UP_NS: Final = 500_000
"""What runs this much later than it was due was held up."""
_MS: Final = 1e6


class Motion:
    """A vector at rest, and from `begin` on one that turns about z on top of it."""

    def __init__(self, size: float, rest: Vector = (0.0, 0.0, 0.0)) -> None:
        self._size = size
        self._rest = rest
        self._begun = False
        self.asked: list[tuple[int, int]] = []
        """What was asked for since `begin`, and when (ns): a device held up asks late."""

    def begin(self) -> None:
        """Turn from now on."""
        self._begun = True

    def __call__(self, time_ns: int) -> Vector:
        """Return the vector at a time of the monotonic clock."""
        x, y, z = self._rest
        if not self._begun:
            return self._rest
        self.asked.append((time_ns, time.monotonic_ns()))
        angle = time_ns % PERIOD_NS / PERIOD_NS * math.tau
        return (x + self._size * math.cos(angle), y + self._size * math.sin(angle), z)


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
    running_p99_ms: float | None
    """The same of the frames that were not held up; None where all were."""
    held_up_share: float
    """Share of the frames during which the machine ran the follower or a device half a
    millisecond or more after it was due."""
    jitter_p99_ms: dict[str, float]
    """By the channel: how far the error of the time is from its median."""
    offset_ms: dict[str, float]
    """By the channel: the median error of the time, the part of the transport delay that is not
    compensated."""
    apart_p99_ms: float
    """Between the instants of two values of one frame."""


def pauses_of_ticks(ticked: IntArray, period_ns: int) -> IntArray:
    """Return from when to when ticks were held up, (k, 2).

    Parameters
    ----------
    ticked
        How many ticks had fallen due by then, and the time, for each call of a ticker, (m, 2).
    period_ns
        From tick to tick; the quickest call was on time.
    """
    counts, times_ns = ticked[:, 0], ticked[:, 1]
    before = np.concatenate([counts[:1] - 1, counts[:-1]])
    first_due_ns = np.min(times_ns - counts * period_ns) + (before + 1) * period_ns
    return _pauses(first_due_ns, times_ns)


def pauses_of_device(asked: IntArray) -> IntArray:
    """Return from when to when an emulated device was held up, (k, 2).

    Parameters
    ----------
    asked
        What it asked its world for, and when, (m, 2); usually it does so with some delay.
    """
    if not len(asked):
        return np.empty((0, 2), dtype=np.int64)
    times_ns, now_ns = asked[:, 0], asked[:, 1]
    return _pauses(times_ns + int(np.median(now_ns - times_ns)), now_ns)


def _pauses(due_ns: IntArray, done_ns: IntArray) -> IntArray:
    held_up = done_ns - due_ns > HELD_UP_NS
    return np.stack([due_ns[held_up], done_ns[held_up]], axis=1)


def within(pauses_ns: IntArray, times_ns: IntArray, formed_ns: IntArray) -> BoolArray:
    """Return of which frames a pause lies between their instant and when they were there, (n,).

    Parameters
    ----------
    pauses_ns
        From when to when, (k, 2).
    times_ns, formed_ns
        Neither goes back, (n,) each.
    """
    first = np.searchsorted(formed_ns, pauses_ns[:, 0], side="right")
    last = np.searchsorted(times_ns, pauses_ns[:, 1], side="left")
    edges = np.zeros(len(times_ns) + 1, dtype=np.int64)
    np.add.at(edges, first[first < last], 1)
    np.add.at(edges, last[first < last], -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)


def frame_times(
    values: dict[str, FloatArray],
    times_ns: IntArray,
    formed_ns: IntArray,
    held_up: BoolArray,
    stated_ms: float,
) -> FrameTimes:
    """Compare frames with the motion that they are of.

    Parameters
    ----------
    values
        Force and acceleration, (n, 3) each, by the channel.
    times_ns, formed_ns
        What the frames say, and when each of them was there, (n,).
    held_up
        Whether the machine held up the follower or a device meanwhile, (n,).
    stated_ms
        The largest latency that a sensor states of itself.
    """
    errors = {name: time_errors_ms(value, times_ns) for name, value in values.items()}
    stacked = np.stack(list(errors.values()))
    added = (formed_ns - times_ns) / _MS - stacked.min(axis=0) - stated_ms
    running = added[~held_up]
    return FrameTimes(
        latency_p50_ms=float(np.median(added)),
        latency_p99_ms=float(np.percentile(added, 99)),
        running_p99_ms=float(np.percentile(running, 99)) if len(running) else None,
        held_up_share=float(np.mean(held_up)),
        jitter_p99_ms={
            name: float(np.percentile(np.abs(error - np.median(error)), 99))
            for name, error in errors.items()
        },
        offset_ms={name: float(np.median(error)) for name, error in errors.items()},
        apart_p99_ms=float(np.percentile(np.ptp(stacked, axis=0), 99)),
    )
