"""Describe an imported recording, and warn of implausible data.

The bounds are wide ones for a hand that strokes a surface with a tool.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, MOST_SAMPLES, Channel, samples_per_frame
from mmt.core.units import GRAVITY_M_S2
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.resampling import RATE_HZ
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import Stamps

_SPEED_WINDOW_FRAMES = 20
_FASTEST_MM_S = 2000.0
_SLOWEST_MM_S = 2.0
_LARGEST_FORCE_N = 50.0
_SMALLEST_FORCE_N = 0.05
_LEAST_VIBRATION_M_S2 = 0.05
_LOWEST_RATE_HZ = 700.0
_SAME_RATE = 0.99
"""Least ratio of two rates that count as equal."""
_LEAST_LEFT_OUT = 0.01
"""Least share of the power above the kept band for a warning."""
_WELCH_ROWS: Final = 1024
_LONGEST_HELD_S = 0.05
_FARTHEST_MM: Final = 10.0
"""Least step from row to row that is no stroke, if it is far beyond nearly all others."""
_MOSTLY_HELD: Final = 0.4
"""Least share of rows that repeat the values before for a warning."""
_LEAST_CLIPPED = 0.005
"""Least share of rows at the largest value for a warning."""
_CLIPPED_STEP = 5
"""Least ratio of rows at the largest value to rows at the next one for a warning."""
_OUTLIER: Final = 20.0
"""Least ratio of a value to nearly all others (all but one row in 1000) for a warning."""
_MIDDLE: Final = 0.3
_FEW_BETWEEN: Final = 0.01
_LEAST_LEAPS: Final = 0.05
_FEW_VALUES: Final = 16
"""Half of the middle of a range, in shares of it; most values there and least leaps over it, and
how many values a square wave may have."""
_NOTED_JITTER = 0.05
"""Least jitter for a warning, in periods."""
_LEAST_COMMON: Final = 0.02
"""Least share of the longest channel's time that is in all channels, without a warning."""


@dataclass(frozen=True)
class ChannelReport:
    """A channel before resampling, in the units of frames."""

    channel: Channel
    rows: int
    rate_hz: float
    jitter_ms: float
    """RMS deviation of the stamps from regular times."""
    missing_rows: int
    low: tuple[float, ...]
    mean: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class ImportReport:
    """Description of an imported recording, and warnings."""

    channels: tuple[ChannelReport, ...]
    speed_mm_s: float | None
    """99th percentile of the speed, measured over 20 ms; None without position."""
    warnings: tuple[str, ...]
    """Sentences about implausible data, with options that may correct them."""
    told: frozenset[str] = frozenset()
    """See `Samples`."""


def assess(
    frames: RecordArray,
    samples: Samples,
    stamps: Mapping[Channel, Stamps],
    options: ImportOptions,
    *,
    resampled: bool,
) -> ImportReport:
    """Describe a recording's channels, and check them for plausible times, units and axes.

    Parameters
    ----------
    frames
        The imported frames, (n,).
    samples, stamps
        The channels, and the assessed times of their rows.
    options
        Options of the import, for the proposals in warnings.
    resampled
        Whether `frames` differ from the rows of the file.
    """
    warnings = _of_stamps(stamps, resampled=resampled)
    longest_s = max(float(np.ptp(each.time_s)) for each in stamps.values())
    if len(frames) < _LEAST_COMMON * longest_s * RATE_HZ:
        warnings.append(
            f"{len(frames) / RATE_HZ:g} s of {longest_s:.4g} s are in all channels: are their "
            "times in one unit and of one clock (--unit, --offset), or gaps long (--longest-gap)?"
        )
    speed_mm_s = None
    if "position" in samples.values:
        speed_mm_s = _high_speed_mm_s(frames)
        warnings += _of_jumps(samples.values["position"], stamps["position"].time_s)
        warnings += _of_position(np.ptp(samples.values["position"], axis=0), speed_mm_s, options)
    if "force" in samples.values:
        turned = "force" in options.tool_axes
        warnings += _of_force(frames["force_n"] if turned else samples.values["force"], options)
    if "acceleration" in samples.values:
        rate_hz = 1.0 / stamps["acceleration"].period_s
        warnings += _of_acceleration(samples.values["acceleration"], rate_hz, options)
        kept_hz = RATE_HZ * samples_per_frame(frames.dtype)
        if resampled:
            warnings += _left_out(samples.values["acceleration"], rate_hz, kept_hz)
    for channel in ("force", "acceleration"):
        if channel in samples.values:
            warnings += _of_sensor(channel, samples.values[channel], 1.0 / stamps[channel].period_s)
    channels = tuple(
        ChannelReport(
            channel,
            rows=len(values),
            rate_hz=1.0 / stamps[channel].period_s,
            jitter_ms=1e3 * stamps[channel].jitter_s,
            missing_rows=stamps[channel].missing_rows,
            low=tuple(np.min(values, axis=0).tolist()),
            mean=tuple(np.mean(values, axis=0).tolist()),
            high=tuple(np.max(values, axis=0).tolist()),
        )
        for channel, values in samples.values.items()
    )
    return ImportReport(channels, speed_mm_s, tuple(warnings), samples.told)


def _high_speed_mm_s(frames: RecordArray) -> float:
    window = min(_SPEED_WINDOW_FRAMES, len(frames) - 1)
    if window < 1:
        return 0.0
    position = frames["position_mm"].astype(np.float64)
    steps = (frames["sequence"][window:] - frames["sequence"][:-window]).astype(np.float64)
    distance = np.linalg.norm(position[window:] - position[:-window], axis=1)
    return float(np.percentile(1e3 * distance / steps, 99))


def _of_stamps(stamps: Mapping[Channel, Stamps], *, resampled: bool) -> list[str]:
    sentences = []
    for clock in {id(each): each for each in stamps.values()}.values():
        channels = ", ".join(channel for channel, each in stamps.items() if each is clock)
        if resampled and clock.jitter_s > _NOTED_JITTER * clock.period_s:
            size = f"{1e3 * clock.jitter_s:.2f} ms rms, {1e3 * clock.largest_s:.1f} ms at most"
            off = f"the stamps lie {size} off a clock of {1.0 / clock.period_s:.1f} Hz"
            if clock.regular:
                told = f"{off}; the rows were put at its times (--stamps kept takes the stamps)"
            elif clock.periodic:
                told = (
                    f"{off}, but the rows fit the stamps better, which were kept (--stamps "
                    "regular takes the clock)"
                )
            else:
                told = (
                    f"the intervals are uneven ({size}) and follow no clock; the stamps were "
                    "taken as they are, and speeds are as uncertain as they"
                )
            sentences.append(f"{channels}: {told}")
        if clock.missing_rows:
            sentences.append(f"{channels}: {clock.missing_rows} rows are missing by the stamps")
    return sentences


def _of_position(range_mm: FloatArray, speed_mm_s: float, options: ImportOptions) -> list[str]:
    largest_mm = float(np.max(range_mm))
    if largest_mm == 0:
        return ["position: it never changes; is it the right column?"]
    if speed_mm_s > _FASTEST_MM_S:
        return [
            f"position: the speed exceeds {speed_mm_s:.0f} mm/s in one frame of a hundred, a hand "
            f"strokes at 20 to 500; {_other_unit('position', 'um', options)}, or look at the times"
        ]
    if speed_mm_s < _SLOWEST_MM_S:
        return [
            f"position: it spans {largest_mm:.3g} mm, and the speed seldom exceeds "
            f"{speed_mm_s:.2g} mm/s; {_other_unit('position', 'm', options)}"
        ]
    return []


def _of_jumps(position_mm: FloatArray, time_s: FloatArray) -> list[str]:
    """Warn of steps that no hand makes, as of a lost marker."""
    steps_mm = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    speeds_mm_s = steps_mm / np.diff(time_s)
    usual_mm_s = float(np.percentile(speeds_mm_s, 99, method="lower"))
    far = np.flatnonzero((steps_mm > _FARTHEST_MM) & (speeds_mm_s > _OUTLIER * usual_mm_s))
    if not len(far):
        return []
    return [
        f"position: it jumps by {steps_mm[far[0]]:.4g} mm at row {far[0] + 2}, and {len(far)} "
        "times in all; --missing VALUE --blanks-as-gaps leaves out what stands for no position"
    ]


def _of_force(force_n: FloatArray, options: ImportOptions) -> list[str]:
    size_n = np.linalg.norm(force_n, axis=1)
    high_n = float(np.percentile(size_n, 99))
    if high_n > _LARGEST_FORCE_N:
        about = f"force: it exceeds {high_n:.3g} N, a hand presses with 0.2 to 10"
        if high_n > 1e3 * _LARGEST_FORCE_N:
            return [f"{about}; counts become N by a factor, as in --map force_z=NAME*1e-6"]
        return [f"{about}; {_other_unit('force', 'mN', options)}"]
    if high_n < _SMALLEST_FORCE_N:
        unit = _other_unit("force", "kN", options)
        return [f"force: it stays below {high_n:.2g} N, so nothing is touched; {unit}"]
    mean_n = np.mean(force_n[size_n > max(_SMALLEST_FORCE_N, 0.2 * high_n)], axis=0)
    axis = int(np.argmax(np.abs(mean_n)))
    if abs(mean_n[axis]) > 2.0 * abs(mean_n[2]):
        mean = ", ".join(f"{value:.2g}" for value in mean_n)
        return [
            f"force: in contact it points along {'xyz'[axis]} (({mean}) N on average), "
            "where z is taken for the surface's normal; map the axes anew (position and "
            "acceleration too), or set normal in the scene's [texture]"
        ]
    if mean_n[2] < 0:
        return [
            f"force: z is {mean_n[2]:.2g} N on average in contact; it must be the surface's force "
            f"on the tool, away from the surface: {_turned(options)}"
        ]
    return []


def _of_acceleration(
    acceleration_m_s2: FloatArray, rate_hz: float, options: ImportOptions
) -> list[str]:
    sentences = []
    mean = float(np.linalg.norm(np.mean(acceleration_m_s2, axis=0)))
    spread = float(np.sqrt(np.sum(np.var(acceleration_m_s2, axis=0))))
    about = f"acceleration: its mean is {mean:.3g} m/s2 long; gravity is 9.81, and none is 0"
    if unit := unit_by_gravity(mean):
        sentences.append(f"{about}: {_other_unit('acceleration', unit, options)}")
    elif mean > 2.0 and not 0.8 < mean / GRAVITY_M_S2 < 1.2:
        sentences.append(
            f"{about}: its offset or its scale is wrong; counts become m/s2 by a factor, as in "
            "--map acceleration_x=NAME*0.0006"
        )
    elif spread < _LEAST_VIBRATION_M_S2 and np.ptp(acceleration_m_s2, axis=0).any():
        unit = _other_unit("acceleration", "g", options)
        sentences.append(f"acceleration: it varies by {spread:.2g} m/s2 rms only; {unit}")
    asked_hz = options.acceleration_rate_hz
    if rate_hz < max(_LOWEST_RATE_HZ, _SAME_RATE * (asked_hz or 0)):
        felt = "; texture is felt up to 500 Hz" if rate_hz < _LOWEST_RATE_HZ else ""
        sentences.append(
            f"acceleration: at {rate_hz:.0f} Hz nothing above {rate_hz / 2:.0f} Hz is in it{felt}"
        )
    return sentences


def _left_out(acceleration_m_s2: FloatArray, rate_hz: float, kept_hz: float) -> list[str]:
    """Warn of power above the band that is kept, and name the option that would keep it."""
    if _SAME_RATE * rate_hz <= kept_hz:
        return []
    from scipy.signal import welch

    rows = min(_WELCH_ROWS, len(acceleration_m_s2))
    frequency_hz, density = welch(acceleration_m_s2, rate_hz, nperseg=rows, axis=0)
    power = density.sum(axis=1)
    above = power[frequency_hz > kept_hz / 2].sum()
    if above <= _LEAST_LEFT_OUT * power.sum():
        return []
    whole_hz = min(RATE_HZ * np.ceil(_SAME_RATE * rate_hz / RATE_HZ), RATE_HZ * MOST_SAMPLES)
    keeps = f": --acceleration-rate {whole_hz:.0f} keeps it to {whole_hz / 2:.0f} Hz"
    return [
        f"acceleration: {100 * above / power.sum():.0f} % of its power is above {kept_hz / 2:.0f} "
        f"Hz and is left out{keeps if whole_hz > kept_hz else ''}"
    ]


def _of_sensor(channel: str, values: FloatArray, rate_hz: float) -> list[str]:
    """Warn if a sensor held one value, or stood at the end of its range."""
    sentences = []
    still = np.concatenate([[0], np.all(np.diff(values, axis=0) == 0, axis=1), [0]]).astype(int)
    edges = np.flatnonzero(np.diff(still))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0))
    if longest + 1 == len(values):
        return [f"{channel}: it never changes; is it the right column, and was the sensor on?"]
    if channel == "acceleration" and longest > _LONGEST_HELD_S * rate_hz:
        sentences.append(f"{channel}: it held one value for {longest / rate_hz:.3g} s")
    elif channel == "acceleration" and np.mean(still) > _MOSTLY_HELD:
        own_hz = rate_hz * (1 - float(np.mean(still)))
        sentences.append(
            f"{channel}: most rows repeat the one before, so it has about {own_hz:.0f} values a "
            f"second, not {rate_hz:.0f}; import its own times, or its rows alone"
        )
    for axis, signed in zip("xyz", values.T, strict=True):
        if _is_cut_at_zero(signed):
            sentences.append(
                f"{channel}: {axis} leaps to and fro between {np.min(signed):.6g} and "
                f"{np.max(signed):.6g}, with hardly anything between: were negative numbers "
                "written without a sign? Then take 2^16, or the range's size, from the upper ones"
            )
            continue
        column = np.abs(signed)
        high = float(np.max(column))
        usual = float(np.percentile(column, 99.0 if _is_one_value(column) else 99.9))
        if high > _OUTLIER * usual > 0:
            row = int(np.argmax(column))
            sentences.append(
                f"{channel}: {axis} is {signed[row]:.12g} in row {row + 1}, "
                f"nearly all others are below {usual:.3g}; --missing VALUE --blanks-as-gaps "
                "leaves it out"
            )
        next_high = np.max(column, where=column < high, initial=0.0)
        rows, next_rows = (int(np.sum(column == size)) for size in (high, next_high))
        if next_high > 0 and rows > max(_LEAST_CLIPPED * len(column), _CLIPPED_STEP * next_rows):
            sentences.append(
                f"{channel}: {axis} stands at {high:.4g} in {rows} rows, the end of its range?"
            )
    return sentences


def _is_one_value(column: FloatArray) -> bool:
    """Return whether sizes (n,) far above nearly all others are equal: they may stand for none."""
    far = column[column > _OUTLIER * np.percentile(column, 99)]
    return len(far) > 1 and bool(np.ptp(far) == 0)


def _is_cut_at_zero(values: FloatArray) -> bool:
    """Return whether values (n,) lie near both ends of their range, and leap between these."""
    low, size = float(np.min(values)), float(np.ptp(values))
    if size == 0.0:
        return False
    between = np.abs((values - low) / size - 0.5) < _MIDDLE
    leaps = np.abs(np.diff(values)) > size / 2
    if np.mean(between) >= _FEW_BETWEEN or np.mean(leaps) <= _LEAST_LEAPS:
        return False
    return len(np.unique(values)) > _FEW_VALUES


def unit_by_gravity(mean_m_s2: float) -> str | None:
    """Return the unit ("g", "mg") in which a mean, read as m/s2, equals gravity; else None."""
    if 0.8 < mean_m_s2 < 1.2:
        return "g"
    return "mg" if 800.0 < mean_m_s2 < 1200.0 else None


def unit_by_speed(speed_mm_s: float) -> str | None:
    """Return "m" if a speed, read as mm/s, is a hand's only in m/s; else None."""
    in_metres = speed_mm_s < _SLOWEST_MM_S < 1e3 * speed_mm_s
    return "m" if in_metres else None


def _other_unit(quantity: str, unit: str, options: ImportOptions) -> str:
    if quantity in options.units:
        return f"is it in {options.units[quantity]}, as --unit says?"
    return f"is it in {unit}? Then say --unit {quantity}={unit}"


def _turned(options: ImportOptions) -> str:
    """Return the options that invert the force."""
    given = {target: text for target, text in options.columns.items() if "time" not in target}
    mapped = {target: text for target, text in given.items() if target.startswith("force")}
    if not mapped:
        mapped = {"force": FIELD_OF_CHANNEL["force"]}
    texts = (f"--map {t}={n[1:] if n.startswith('-') else f'-{n}'}" for t, n in mapped.items())
    return " ".join(texts)
