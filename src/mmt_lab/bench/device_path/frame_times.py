"""Vectors that turn, so that a value gives its time, and the errors of frame times against them."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, Vector

PERIOD_NS: Final = 50_000_000
"""Period of a turn; a value's angle gives the time in it, even if a filter changes its length."""

_MS: Final = 1e6


class Motion:
    """A constant vector, to which a vector that turns about z is added from `begin` on."""

    def __init__(self, size: float, rest: Vector = (0.0, 0.0, 0.0)) -> None:
        self._size = size
        self._rest = rest
        self._begun = False

    def begin(self) -> None:
        """Turn from now on."""
        self._begun = True

    def __call__(self, time_ns: int) -> Vector:
        """Return the vector at a time of the monotonic clock."""
        x, y, z = self._rest
        if not self._begun:
            return self._rest
        angle = time_ns % PERIOD_NS / PERIOD_NS * math.tau
        return (x + self._size * math.cos(angle), y + self._size * math.sin(angle), z)


def time_errors_ms(values: FloatArray, times_ns: IntArray) -> FloatArray:
    """Return the time that each value gives, less the time stamp of its frame, in ms, shape (n,).

    Parameters
    ----------
    values
        Values of a `Motion`, (n, 3).
    times_ns
        Time stamps of the frames, (n,).
    """
    turned = np.arctan2(values[:, 1], values[:, 0]) / (2.0 * np.pi)
    apart = turned - (times_ns % PERIOD_NS) / PERIOD_NS
    return np.asarray((apart - np.round(apart)) * (PERIOD_NS / _MS), dtype=np.float64)


@dataclass(frozen=True)
class FrameTimes:
    """Latency of frames and errors of their times; all in ms."""

    latency_p50_ms: float
    """From the instant of a frame's oldest value until the frame is formed, less the largest
    latency that a sensor states."""
    latency_p99_ms: float
    jitter_p99_ms: dict[str, float]
    """By channel: distance of the time error from its median."""
    offset_ms: dict[str, float]
    """By channel: median time error, which is the part of the transport delay that is not
    compensated."""
    apart_p99_ms: float
    """Time between the instants of a frame's two values."""


def frame_times(
    values: dict[str, FloatArray],
    times_ns: IntArray,
    formed_ns: IntArray,
    stated_ms: float,
) -> FrameTimes:
    """Compare frames with the motions that the devices emulated.

    Parameters
    ----------
    values
        Force and acceleration, (n, 3) each, by channel.
    times_ns, formed_ns
        Time stamp of each frame, and the time at which it was formed, (n,).
    stated_ms
        The largest latency that a sensor states.
    """
    errors = {name: time_errors_ms(value, times_ns) for name, value in values.items()}
    stacked = np.stack(list(errors.values()))
    added = (formed_ns - times_ns) / _MS - stacked.min(axis=0) - stated_ms
    return FrameTimes(
        latency_p50_ms=float(np.median(added)),
        latency_p99_ms=float(np.percentile(added, 99)),
        jitter_p99_ms={
            name: float(np.percentile(np.abs(error - np.median(error)), 99))
            for name, error in errors.items()
        },
        offset_ms={name: float(np.median(error)) for name, error in errors.items()},
        apart_p99_ms=float(np.percentile(np.ptp(stacked, axis=0), 99)),
    )
