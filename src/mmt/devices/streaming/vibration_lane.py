"""A lane that keeps vibration: it interpolates from nine readings or more.

If frames have several samples of acceleration, and the sensor is faster than these samples, the
weights act as an anti-alias filter as well.
"""

from collections import deque
from functools import lru_cache
from math import ceil
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, Vector
from mmt.core.frames import FRAMES_HZ
from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.lanes import Lane, Waiting, on_line

BEFORE: Final = 8
"""Readings before the instant that make up its value, with one after it."""

PHASES: Final = 256
"""Instants between two readings with weights of their own; the nearest is taken."""

_SHARE: Final = 0.42
"""Band of a slow sensor, as a share of its rate. Nearer to half its rate, past readings give no
value without amplifying the frequencies in between."""
_NOISE: Final = 1e-3
"""Assumed power outside the band, over that within it."""

_FASTER: Final = 1.1
"""Factor over the rate of the samples from which a sensor's readings are filtered."""
_SPAN_BEFORE: Final = 10.0
_SPAN_AFTER: Final = 4.0
"""Length of the filter before and after the instant, in spacings of the samples."""
_PASSED: Final = 0.33
"""Share of the samples' rate up to which the filter passes; it stops from half of it on."""
_STOPPED: Final = 100.0
"""Assumed density of the power to be stopped, over that within the band."""
_FREE: Final = 1e-8
"""Share of it that is assumed between the two bands, so that the weights stay small."""


class Weights(NamedTuple):
    """Weights of the readings around an instant in its value."""

    before: int
    """Readings before the instant."""
    after: int
    """Readings after it."""
    rows: tuple[tuple[float, ...], ...]
    """Rows by the instant, 0 at the reading before it to `PHASES` at the one after it; columns by
    the reading, the oldest first."""


def weights_for(rate_hz: float, samples_hz: float = FRAMES_HZ) -> Weights:
    """Return the weights for a sensor's rate and the rate of the samples.

    Frames of one sample have no anti-alias filter, since it would hold the whole frame back by
    4 ms: the sensor's own filter has to cut off.
    """
    ratio = rate_hz / samples_hz
    if samples_hz > FRAMES_HZ and ratio > _FASTER:
        after = ceil(_SPAN_AFTER * ratio)
        before = ceil(_SPAN_BEFORE * ratio)
        before += (before + after + 1) % 2  # an odd number, which has a middle
        band = _PASSED / ratio
        rows = weights(band, 0.5 / ratio, before, after, 0.5 * _STOPPED / band)
        return Weights(before, after, rows)
    return Weights(BEFORE, 1, weights(min(0.5 * samples_hz / rate_hz, _SHARE)))


@lru_cache(maxsize=8)
def weights(
    band: float, stop: float = 0.0, before: int = BEFORE, after: int = 1, noise: float = _NOISE
) -> tuple[tuple[float, ...], ...]:
    """Return the rows of weights for a band from 0 up; some 0.3 ms for nine readings.

    They have the least error if the vibration has flat power within the band, and the vibration to
    be removed has flat power from `stop` on.

    Parameters
    ----------
    band
        Highest frequency over the sensor's rate, above 0 and below 0.5.
    stop
        Lowest frequency to remove, over the sensor's rate.
    before, after
        Number of readings before and after the instant.
    noise
        Power to be removed, over that within the band.

    Raises
    ------
    ValueError
        There is no such band.
    """
    if not 0.0 < band < 0.5:
        raise ValueError(f"band is {band}: it must lie within 0 to half the rate")
    places = np.arange(1.0 - before, 1.0 + after)
    instants = np.arange(PHASES + 1) / PHASES
    count = len(places)
    apart = places[:, None] - places
    exact: FloatArray = np.vstack((np.ones(count), places))
    system = np.zeros((count + 2, count + 2))
    system[:count, :count] = np.sinc(2.0 * band * apart)
    passing = (1.0 - _FREE) * 2.0 * stop * np.sinc(2.0 * stop * apart)
    system[:count, :count] += noise * (np.eye(count) - passing)
    system[:count, count:], system[count:, :count] = exact.T, exact
    wanted = np.vstack(
        (
            np.sinc(2.0 * band * (places[:, None] - instants)),
            np.ones(len(instants)),
            instants,
        )
    )
    solved = np.linalg.solve(system, wanted)[:count]
    return tuple(tuple(row) for row in solved.T.tolist())


_UNEVEN: Final = 0.5
"""Share of a period by which readings may be off an even spacing; a lost reading makes 1."""
_OTHER_RATE: Final = 0.05
"""Relative change of the sensor's period from which the weights are computed again."""


class VibrationLane(Lane):
    """Like a `Lane`, but each value comes from eight readings before the instant and one after it.

    A fast sensor uses more of them, see `weights_for`. If one of them is missing, and at the
    beginning, the value lies on the straight line between its two neighbours. A value takes twice
    as long as on that line, and longer in proportion to the number of readings.

    Parameters
    ----------
    latency_ns
        Time from the physical instant to the stamp.
    samples_per_frame
        Values of a frame, evenly spaced, the last one at the frame's time.
    """

    def __init__(self, latency_ns: int = 0, samples_per_frame: int = 1) -> None:
        super().__init__(latency_ns)
        self._samples_hz = FRAMES_HZ * samples_per_frame
        self._ages_ns = [round(1e9 * j / self._samples_hz) for j in range(samples_per_frame)][::-1]
        """Time from each instant of a frame to the frame's last one."""
        self._weights = Weights(BEFORE, 1, ())
        self._made_for_ns = 0.0

    @property
    def ahead_ns(self) -> int:
        """Extra time that frames wait, beyond the first reading after their instant."""
        self._follow_period()
        return round((self._weights.after - 1) * self.period_ns)

    def _follow_period(self) -> None:
        if abs(self.period_ns - self._made_for_ns) > _OTHER_RATE * self.period_ns:
            self._made_for_ns = self.period_ns
            self._weights = weights_for(1e9 / self.period_ns, self._samples_hz)

    def _interpolate(self, time_ns: int, longest_ns: float) -> "tuple[float, ...] | Waiting | None":
        """Return x, y, z of each instant of a frame; see `Lane.at`."""
        self._follow_period()  # before readings are dropped, never between two instants
        readings, (before, after, _) = self._kept, self._weights
        if len(readings) < after or readings[-after].time_ns < time_ns:
            return self._lack(time_ns)
        values: tuple[float, ...] = ()
        for age_ns in self._ages_ns:
            instant_ns = time_ns - age_ns
            while len(readings) > before and readings[before].time_ns <= instant_ns:
                readings.popleft()
            value = self._value(readings, instant_ns, longest_ns)
            if value is None:
                return None
            if not values and age_ns:  # the frame may be asked for again
                readings = readings.copy()
            values += value
        return values

    def _value(
        self, readings: deque[SensorReading], time_ns: int, longest_ns: float
    ) -> Vector | None:
        """Return the value at an instant from the readings around it."""
        before, after, rows = self._weights
        count = before + after
        if len(readings) < count or readings[before - 1].time_ns > time_ns:
            return _near_the_beginning(readings, time_ns, longest_ns)
        start, end = readings[before - 1], readings[before]
        start_ns, end_ns, first_ns = start.time_ns, end.time_ns, readings[0].time_ns
        span = end_ns - start_ns
        if after == 1:
            uneven_ns = abs(end_ns - first_ns - BEFORE * span)
        else:  # stamps are rounded: compare the two halves of the readings
            middle_ns, last_ns = readings[count // 2].time_ns, readings[count - 1].time_ns
            uneven_ns = abs(last_ns - 2 * middle_ns + first_ns)
        if span > longest_ns or uneven_ns > _UNEVEN * span:
            return on_line(start, end, time_ns, longest_ns)
        x = y = z = 0.0
        row = rows[round((time_ns - start_ns) / span * PHASES)]
        for weight, (_, (u, v, w)) in zip(row, readings, strict=False):  # later ones are unused
            x += weight * u
            y += weight * v
            z += weight * w
        return x, y, z


def _near_the_beginning(
    readings: deque[SensorReading], time_ns: int, longest_ns: float
) -> Vector | None:
    """Return the value on a line, since too few readings lie before the instant."""
    older = newer = readings[0]
    for newer in readings:
        if newer.time_ns > time_ns:
            break
        older = newer
    return on_line(older, newer, time_ns, longest_ns)
