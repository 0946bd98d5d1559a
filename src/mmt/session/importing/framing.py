"""Convert samples to frames: unchanged if they lie on a 1 kHz grid, else resampled."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import MOST_SAMPLES, Channel
from mmt.core.sequence_numbers import SEQUENCES
from mmt.session.data import FRAME_PERIOD_NS, FRAME_PERIOD_S, frames_of, sample_times
from mmt.session.importing.resampling import RATE_HZ, resample
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import StampChoice, Stamps, assess_stamps

_GRID_TOLERANCE: Final = 0.2
"""Tolerance of times on the 1 kHz grid, in periods."""
_RATE_TOLERANCE: Final = 0.01


class _Rows(NamedTuple):
    """Rows that can be frames: numbers (n,), times (n,) and samples of acceleration per frame."""

    numbers: IntArray
    time_s: FloatArray
    samples_per_frame: int


def to_frames(
    samples: Samples,
    longest_gap_s: float | None = None,
    choice: StampChoice = "auto",
    acceleration_rate_hz: int | None = None,
) -> tuple[RecordArray, dict[Channel, Stamps], bool]:
    """Return samples as frames (n,) at 1 kHz, their times, and whether they were resampled.

    Rows on a 1 kHz grid (within a fifth of a period) become frames unchanged, if acceleration
    beside motion is on the grid of its requested rate. So do rows of an exported session, which
    have frame numbers. All others go through `assess_stamps` and `resample`, which need scipy.
    `samples` must have been checked.

    Raises
    ------
    InputError
        Equal times do not follow a clock, or the samples are too far apart to give a frame.
    """
    rows = _as_frames(samples)
    if acceleration_rate_hz is None:
        several = rows.samples_per_frame if rows and samples.sequence is not None else 1
    else:
        several = acceleration_rate_hz // round(RATE_HZ) if "acceleration" in samples.values else 1
    if rows and rows.samples_per_frame == several:
        time_ns = np.rint((rows.time_s - rows.time_s[0]) * 1e9).astype(np.int64)
        kept = on_the_grid(samples.values, rows.time_s, rows.numbers, several)
        return _frames(samples, rows.numbers, time_ns, samples.values, several), kept, False
    require("scipy")
    stamps = _stamps(samples, choice)
    for channel, assessed in stamps.items():
        repeated = np.flatnonzero(np.diff(assessed.time_s) <= 0)
        if len(repeated):
            row = int(repeated[0]) + 1
            raise InputError(
                f"the time of {channel} is {assessed.time_s[row]:.9g} s in "
                f"{samples.row_name(channel, row)} and in the row before; such stamps can be "
                "used only where the rows follow a clock, and these do not (--rate HZ says the "
                "rows a second)"
            )
    numbers, values = resample(samples, stamps, longest_gap_s, several)
    return _frames(samples, numbers, numbers * FRAME_PERIOD_NS, values, several), stamps, True


def on_the_grid(
    channels: Iterable[Channel], time_s: FloatArray, numbers: IntArray, samples_per_frame: int
) -> dict[Channel, Stamps]:
    """Return the stamps of each channel, for frames with times (n,) and numbers (n,)."""
    motion, acceleration = (
        _of_frames(time_s, numbers, several) for several in (1, samples_per_frame)
    )
    return {each: acceleration if each == "acceleration" else motion for each in channels}


def _of_frames(time_s: FloatArray, numbers: IntArray, samples_per_frame: int) -> Stamps:
    """Return the stamps of a channel's samples, with deviations from the frame numbers."""
    off_s = time_s - time_s[0] - numbers / RATE_HZ
    off_s -= np.mean(off_s)
    missing = int(numbers[-1] - numbers[0]) + 1 - len(numbers)
    return Stamps(
        time_s=sample_times(time_s, samples_per_frame, FRAME_PERIOD_S),
        period_s=1.0 / (RATE_HZ * samples_per_frame),
        jitter_s=float(np.sqrt(np.mean(off_s**2))),
        largest_s=float(np.abs(off_s).max()),
        missing_rows=samples_per_frame * missing,
        periodic=True,
        regular=False,
    )


def _stamps(samples: Samples, choice: StampChoice) -> dict[Channel, Stamps]:
    """Assess the times of each channel; channels with the same times are assessed once."""
    found: dict[int, Stamps] = {}
    for time_s in samples.times.values():
        if id(time_s) not in found:
            smooth = [
                samples.values[channel]
                for channel in ("position", "force")
                if samples.times.get(channel) is time_s
            ]
            found[id(time_s)] = assess_stamps(time_s, smooth[0] if smooth else None, choice)
    return {channel: found[id(time_s)] for channel, time_s in samples.times.items()}


def _as_frames(samples: Samples) -> _Rows | None:
    """Return the rows as frames, or None if they are not on a grid."""
    times, sequence = dict(samples.times), samples.sequence
    fast_s = times.pop("acceleration", None)
    time_s = next(iter(times.values()), fast_s)
    several = 1
    if time_s is None or any(other is not time_s for other in times.values()):
        return None
    if fast_s is not None:
        count = len(time_s) if times or sequence is None else len(sequence)
        several, rest = divmod(len(fast_s), max(1, count))
        if rest or not 1 <= several <= MOST_SAMPLES:
            several = 1
        if not times:
            time_s = fast_s[several - 1 :: several]
        elif several == 1 and fast_s is not time_s:
            return None
        off_s = fast_s - sample_times(time_s, several, FRAME_PERIOD_S)
        if np.abs(off_s).max() > _GRID_TOLERANCE / (RATE_HZ * several):
            return None
    numbers = _frame_numbers(time_s, sequence)
    if numbers is None:
        return None
    return _Rows(numbers, time_s, several)


def _frame_numbers(time_s: FloatArray, sequence: FloatArray | None) -> IntArray | None:
    """Return the numbers of frames at times (n,), or None if the times are not on a grid."""
    periods = (time_s - time_s[0]) * 1000.0
    if sequence is not None and len(sequence) == len(periods):
        numbers = np.rint(sequence)
        span = numbers[-1] - numbers[0]
        in_range = numbers[0] >= 0 and numbers[-1] < SEQUENCES
        at_the_rate = abs(span - periods[-1]) <= max(1.0, _RATE_TOLERANCE * span)
        if in_range and at_the_rate and bool(np.all(np.diff(numbers) > 0)):
            return np.asarray(numbers, dtype=np.int64)
    numbers = np.rint(periods)
    steps = np.diff(numbers)
    on_the_grid = np.abs(periods - numbers).max() <= _GRID_TOLERANCE
    if on_the_grid and steps.min() > 0 and np.median(steps) == 1:
        return np.asarray(numbers, dtype=np.int64)
    return None


def _frames(
    samples: Samples,
    numbers: IntArray,
    time_ns: IntArray,
    values: Mapping[Channel, FloatArray],
    samples_per_frame: int,
) -> RecordArray:
    if len(numbers) == 0:
        spans = (f"{c} has {t[0]:.11g} to {t[-1]:.11g} s" for c, t in samples.times.items())
        raise InputError(
            f"no frame can be made: its channels share no time in which "
            f"their samples are close enough together ({', '.join(spans)}); are the times in "
            "seconds (else say their unit, as in --unit time=ms)? Otherwise allow a longer gap "
            "(--longest-gap), or move a file's times (--offset)"
        )
    return frames_of(numbers, time_ns, values, samples_per_frame)
