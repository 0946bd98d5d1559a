"""Join several files of one recording, each with its own times, on one clock."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.session.importing.options import MATCHED, ImportOptions, quantity_of
from mmt.session.importing.resampling import RATE_HZ
from mmt.session.importing.samples import Samples

_LONGEST_S: Final = 600.0
"""Length of each file that is compared."""
_SHOCK_STEPS = 25
_CLEAR: Final = 20.0
"""Least ratio of the correlation's peak to its median; noise has a ratio of 7."""


def options_of_each(options: ImportOptions, paths: Sequence[Path]) -> list[ImportOptions]:
    """Split the options for several files, which map ``FILE:COLUMN``, into options for each.

    Raises
    ------
    InputError
        Two files have the same name, or an option is for none of them.
    """
    names = [path.name for path in paths]
    if len(set(names)) < len(names):
        raise InputError(f"import {', '.join(map(str, paths))}: each file needs a name of its own")
    for name in set(options.offsets) - set(names[1:]):
        raise InputError(
            f"--offset {name}=...: offsets are of {', '.join(names[1:])}, to {names[0]}"
        )
    of_each: dict[str, dict[str, str]] = {name: {} for name in names}
    constants = {}
    for target, text in options.columns.items():
        name, colon, column = text.removeprefix("-").partition(":")
        if colon and name in of_each:
            of_each[name][target] = f"-{column}" if text.startswith("-") else column
        else:
            constants[target] = text
    for target, text in constants.items():
        kind = quantity_of(target)
        owner = next((each for each in of_each.values() if kind in map(quantity_of, each)), None)
        if owner is None or not text.removeprefix("-").replace(".", "", 1).isdecimal():
            raise InputError(f"--map {target}={text}: say of which file, as {names[0]}:{text}")
        owner[target] = text
    return [replace(options, columns=columns, offsets={}) for columns in of_each.values()]


def joined(parts: Sequence[Samples], names: Sequence[str], options: ImportOptions) -> Samples:
    """Join the channels of several files, with all times on the clock of the first.

    Raises
    ------
    InputError
        A channel is in two files.
    """
    whole = parts[0]
    for part, name in zip(parts[1:], names[1:], strict=True):
        if twice := set(part.values) & set(whole.values):
            raise InputError(
                f"{whole.origin}: {name} has {', '.join(sorted(twice))} too; map it in one file"
            )
        given = options.offsets.get(name)
        offset_s = _matched_s(whole, part, name) if given == MATCHED else float(given or 0.0)
        notes = {
            None: f"{name}: its clock was taken for that of {names[0]} (--offset {name}=S adds "
            f"seconds to it, --offset {name}={MATCHED} finds them by shocks that are in both)",
            MATCHED: f"{name}: {offset_s:+.3f} s were added to its times, found by its shocks",
        }
        moved = {id(time_s): time_s + offset_s for time_s in part.times.values()}
        times = {channel: moved[id(time_s)] for channel, time_s in part.times.items()}
        whole = replace(
            whole,
            origin=f"{whole.origin}, {name}",
            values={**whole.values, **part.values},
            times={**whole.times, **times},
            row_names={**whole.row_names, **part.row_names},
            notes=(*whole.notes, *part.notes, *([notes[given]] if given in notes else [])),
            told=whole.told | part.told,
        )
    return whole


def _matched_s(first: Samples, second: Samples, name: str) -> float:
    """Return the offset of the second file's times with which shocks in both files coincide."""
    require("scipy")
    from scipy.signal import correlate, correlation_lags

    (begin_s, one), (other_begin_s, other) = _shocks(first), _shocks(second)
    product = correlate(one, other, mode="full", method="fft")
    if not np.max(product, initial=0.0) > _CLEAR * np.median(np.abs(product)):
        raise InputError(
            f"{second.origin}: --offset {name}={MATCHED}: no shock stands out in both files; tap "
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
