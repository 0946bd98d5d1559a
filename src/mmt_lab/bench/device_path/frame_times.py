"""Vectors that turn, so that a value gives its time, and the errors of frame times against them."""

import math
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


def frame_times(
    values: dict[str, FloatArray],
    times_ns: IntArray,
    formed_ns: IntArray,
    stated_ms: float,
) -> tuple[dict[str, float], dict[str, float]]:
    """Compare frames with the motions that the devices emulated.

    Parameters
    ----------
    values
        Force and acceleration, (n, 3) each, by channel.
    times_ns, formed_ns
        Time stamp of each frame, and the time at which it was formed, (n,).
    stated_ms
        The largest latency that a sensor states.

    Returns
    -------
    times
        Latency from the instant of a frame's oldest value until the frame is formed, less
        `stated_ms`; distance of each channel's time error from its median; time between the
        instants of a frame's two values. By the columns of the bench.
    offset_ms
        By channel: median time error, which is the part of the transport delay that is not
        compensated.
    """
    errors = {name: time_errors_ms(value, times_ns) for name, value in values.items()}
    stacked = np.stack(list(errors.values()))
    added = (formed_ns - times_ns) / _MS - stacked.min(axis=0) - stated_ms
    offset_ms = {name: float(np.median(error)) for name, error in errors.items()}
    jitter_ms = {
        name: float(np.percentile(np.abs(error - offset_ms[name]), 99))
        for name, error in errors.items()
    }
    times = {
        "latency p50 (ms)": float(np.median(added)),
        "p99 (ms)": float(np.percentile(added, 99)),
        "jitter p99: force (ms)": jitter_ms["force"],
        "acceleration (ms)": jitter_ms["acceleration"],
        "apart, p99 (ms)": float(np.percentile(np.ptp(stacked, axis=0), 99)),
    }
    return times, offset_ms
