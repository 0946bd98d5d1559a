"""Join the files of one recording on one clock."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.session.importing.options import MATCHED
from mmt.session.importing.resampling import RATE_HZ
from mmt.session.importing.samples import Samples

_LONGEST_S: Final = 600.0
"""Length of each file that is compared."""
_SHOCK_STEPS = 25
_CLEAR: Final = 20.0
"""Least ratio of the correlation's peak to its median; noise has a ratio of 7."""


def joined(
    parts: Sequence[Samples],
    names: Sequence[str],
    offsets: Mapping[str, str],
    dates_ns: Sequence[int | None],
) -> Samples:
    """Join the channels of several files, with all times on the clock of the first.

    Parameters
    ----------
    parts, names
        Channels and name of each file.
    offsets
        See `ImportOptions.offsets`.
    dates_ns
        Date from which the times of each file count (ns, UTC), None if it is not known.

    Raises
    ------
    InputError
        A channel is in two files.
    """
    whole, begin_ns = parts[0], dates_ns[0]
    for part, name, date_ns in zip(parts[1:], names[1:], dates_ns[1:], strict=True):
        if twice := set(part.values) & set(whole.values):
            raise InputError(f"{name} has {', '.join(sorted(twice))} too; map it in one file")
        apart_ns = None if date_ns is None or begin_ns is None else date_ns - begin_ns
        offset_s, notes = _offset(whole, part, (names[0], name), offsets.get(name), apart_ns)
        moved = {id(time_s): time_s + offset_s for time_s in part.times.values()}
        times = {channel: moved[id(time_s)] for channel, time_s in part.times.items()}
        whole = replace(
            whole,
            values={**whole.values, **part.values},
            times={**whole.times, **times},
            row_names={**whole.row_names, **part.row_names},
            notes=(*whole.notes, *part.notes, *notes),
            told=whole.told | part.told,
        )
    return whole


def _offset(
    whole: Samples, part: Samples, names: tuple[str, str], given: str | None, apart_ns: int | None
) -> tuple[float, list[str]]:
    """Return the seconds to add to the times of a part, and a note on where they are from."""
    first, name = names
    if given == MATCHED:
        offset_s = _matched_s(whole, part, name)
        return offset_s, [f"{name}: {offset_s:+.3f} s were added to its times, found by its shocks"]
    if given is not None:
        return float(given), []
    if apart_ns is not None:
        note = (
            f"{name}: {apart_ns / 1e9:.9f} s were added to its times, by the dates in both files "
            f"(--offset {name}=S adds others)"
        )
        return apart_ns / 1e9, [note]
    note = (
        f"{name}: its clock was taken for that of {first} (--offset {name}=S adds seconds to it, "
        f"--offset {name}={MATCHED} finds them by shocks that are in both)"
    )
    return 0.0, [note]


def _matched_s(first: Samples, second: Samples, name: str) -> float:
    """Return the offset of the second file's times with which shocks in both files coincide."""
    require("scipy")
    from scipy.signal import correlate, correlation_lags

    (begin_s, one), (other_begin_s, other) = _shocks(first), _shocks(second)
    product = correlate(one, other, mode="full", method="fft")
    if not np.max(product, initial=0.0) > _CLEAR * np.median(np.abs(product)):
        raise InputError(
            f"--offset {name}={MATCHED}: no shock stands out in both files; tap "
            f"once on what is recorded by both, or say the seconds (--offset {name}=S)"
        )
    lag = correlation_lags(len(one), len(other))[int(np.argmax(product))]
    return begin_s - other_begin_s + float(lag) / RATE_HZ


def _shocks(samples: Samples) -> tuple[float, FloatArray]:
    """Return the first time, and from there the rate of change of all channels at 1 kHz."""
    begin_s = min(float(time_s[0]) for time_s in samples.times.values())
    grid_s = begin_s + np.arange(0.0, _LONGEST_S, 1 / RATE_HZ)
    end_s = max(float(time_s[-1]) for time_s in samples.times.values())
    total = np.zeros(int(np.searchsorted(grid_s, end_s)))
    for channel, values in samples.values.items():
        time_s = samples.times[channel]
        change = np.linalg.norm(np.diff(values, axis=0), axis=1)
        spread = float(np.std(change)) or 1.0
        counts, _ = np.histogram(
            time_s[1:] - begin_s, len(total), (0.0, len(total) / RATE_HZ), weights=change / spread
        )
        # smoothed, so that the middle of a shock counts, not its edges
        total += np.convolve(counts - np.mean(counts), np.hanning(_SHOCK_STEPS), mode="same")
    return begin_s, total
