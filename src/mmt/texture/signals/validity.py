"""Samples of an accelerometer that are no measurement: held, saturated, or constant throughout.

Causal and online, sample by sample, from the past of the channel itself:

- *Held*: the channel repeats one value for longer than chance allows. The rate of repeats is learnt
  for each octave of the steps before them: a coarse converter near silence repeats often and a slow
  sensor always, a vibration in a fine converter hardly ever. A run of n repeats whose chance is
  below `CHANCE` is held, unless it is silence. Silence meets two conditions. The channel has
  stopped at that value before, or has never stopped and the value is its mean. And the last values
  before the run were closer to it than the vibration usually is, or the tool was at rest. A
  vibration that rings out ends in ever smaller steps, after which repeats are no surprise either.
- *Saturated*: a sample at the rail. A rail is an extreme, of the last samples or of all, that
  recurs to the last bit, more often than the values right beside it and the channel's resolution
  explain. It remains a rail until a sample lies beyond it.
- *Constant*: no axis has ever changed.

Vibration must change only while the tool strokes a texture: a value that is repeated at rest or in
the air is neither held nor constant, unless it is repeated in a stroke too.
"""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.core.compiled import kernel


class Cause(IntEnum):
    """Why a sample is no measurement of the acceleration; `MEASURED` if it is one."""

    MEASURED = 0
    MISSING = 1
    HELD = 2
    SATURATED = 3
    CONSTANT = 4


CHANCE: Final = 1e-6
"""Probability of a run of repeats, or of equal extremes, below which it counts as a fault."""

RECENT: Final = 100
"""Frames after which an extreme that has not recurred is no longer recent."""

LEAST_LEARNT: Final = 100
"""Least number of values from which a channel is learnt; if an octave has fewer, values after
smaller steps count too. A texture may begin silent for as many frames."""

_EVIDENCE: Final = -math.log(CHANCE)
_COUNTED: Final = 20  # repeats of a run that are learnt from: one long run is one event
_OCTAVES: Final = 80
_LOWEST_OCTAVE: Final = -50
_MEAN_FRAMES: Final = 12000.0
_NEAR_MEAN: Final = 4.5  # deviations over the root of the frames: some 98 % of means of textures
_ACTIVITY_FRAMES: Final = 128.0
_DECLINED: Final = 0.5  # of the activity: 3 of 100 silences begin from further away
_LEAST_STEPS: Final = 8.0  # of the resolution: least change of a value that may be a rail
_LEAST_ACTIVE: Final = 0.01  # of the activity, likewise
_LEAST_ALIKE: Final = 4.0  # extremes: two waves that ring out can have the same peak
_MARGIN: Final = 1.25  # of the chance of an extreme over that of a value right beside it

_MEASURED, _MISSING, _HELD, _SATURATED, _CONSTANT = (int(cause) for cause in Cause)

# columns of the state of an axis, and of the trackers of its extremes
_LAST, _REPEATS, _STEP, _OCTAVE, _DECIDED, _MEAN, _POWER, _COUNT = range(8)
_RESOLUTION, _CHANGES, _ACTIVITY, _UPPER, _LOWER = range(8, 13)
_STOPS: Final = 13  # and those behind it: values at which runs stopped
_STOPS_KEPT: Final = 4
_BEFORE: Final = _STOPS + _STOPS_KEPT  # and all behind it: the last values before the run
_BEFORE_FRAMES: Final = 3
_EXTREME, _ALIKE, _NEAR, _SINCE = range(4)

# What a run of repeats is: within chance, beyond it at rest or in the air, or, in a stroke,
# silence or held.
_UNDECIDED, _AT_REST, _SILENT, _HOLDING = 0.0, 1.0, 2.0, 3.0


class ChannelStates:
    """State of each axis of an accelerometer, which `judge` updates.

    Parameters
    ----------
    axes
        Number of axes.
    per_frame
        Samples in a frame.
    """

    def __init__(self, axes: int, per_frame: int) -> None:
        self.axes = np.zeros((axes, _BEFORE + _BEFORE_FRAMES * per_frame))
        self.axes[:, _RESOLUTION] = self.axes[:, _UPPER] = np.inf
        self.axes[:, _LOWER] = -np.inf
        self.axes[:, _STOPS:_BEFORE] = np.nan
        self.repeats: FloatArray = np.zeros((axes, _OCTAVES, 2))
        """For each octave of steps: values that could have been repeated, and that were."""
        self.extremes: FloatArray = np.zeros((axes, 4, 4))
        """Upper and lower extremes, recent and of all samples; the lower ones are negated."""
        self.extremes[:, :, _EXTREME] = -np.inf

    @property
    def changed(self) -> bool:
        """Whether any axis has ever given another value than its first."""
        return bool(self.axes[:, _CHANGES].any())


@kernel("b1(f8[::1], f8, f8, f8, i8)", inner=True)
def _is_rail(
    tracker: FloatArray, value: float, mean: float, resolution: float, recent: int
) -> bool:
    """Add a value to the tracker of an upper extreme; return whether this proves a rail.

    An extreme that has not recurred for `recent` samples is dropped; with 0 never.
    """
    tracker[_SINCE] += 1.0
    if recent > 0 and tracker[_SINCE] > recent:
        tracker[_EXTREME] = -np.inf
    beyond = tracker[_EXTREME] - value
    reach = max(4.0 * resolution, 0.25 * (max(value, tracker[_EXTREME]) - mean))
    if beyond > 0.0:
        tracker[_NEAR] += beyond < reach
        return False
    tracker[_SINCE] = 0.0
    if beyond < 0.0:
        tracker[_NEAR] = tracker[_NEAR] + tracker[_ALIKE] if -beyond < reach else 0.0
        tracker[_EXTREME], tracker[_ALIKE] = value, 1.0
        return False
    tracker[_ALIKE] += 1.0
    total = tracker[_ALIKE] + tracker[_NEAR]
    share, chance = tracker[_ALIKE] / total, _MARGIN * resolution / (reach + resolution)
    if share <= chance or tracker[_ALIKE] < _LEAST_ALIKE:
        return False
    evidence = share * math.log(share / chance)
    if share < 1.0:
        evidence += (1.0 - share) * math.log((1.0 - share) / (1.0 - chance))
    return bool(total * evidence > _EVIDENCE)


@kernel("b1(f8[::1], f8, i8, f8[:, ::1], f8[:, ::1])")
def _step(
    state: FloatArray, value: float, per_frame: int, repeats: FloatArray, extremes: FloatArray
) -> bool:
    """Add a value that differs from the one before; return whether it proves a rail."""
    size = abs(value - state[_LAST])
    for place in range(len(state) - 1, _BEFORE, -1):
        state[place] = state[place - 1]
    state[_BEFORE] = state[_LAST]
    over_frame = abs(value - state[_BEFORE + per_frame - 1])
    if state[_DECIDED] == _UNDECIDED and state[_REPEATS] < _COUNTED and state[_CHANGES]:
        repeats[int(state[_OCTAVE]), 0] += 1.0
    stopped = state[_DECIDED] != _UNDECIDED or state[_REPEATS] >= _COUNTED
    stopped &= state[_DECIDED] != _HOLDING or state[_CHANGES] == 0.0
    for place in range(_STOPS, _BEFORE):
        stopped &= state[place] != state[_LAST]
    if stopped:
        for place in range(_BEFORE - 1, _STOPS, -1):
            state[place] = state[place - 1]
        state[_STOPS] = state[_LAST]
    state[_CHANGES] += 1.0
    state[_RESOLUTION] = min(state[_RESOLUTION], size)
    other = 0.0 if state[_REPEATS] > 0.0 else state[_STEP]
    octave = math.frexp(max(size, other))[1] - _LOWEST_OCTAVE
    state[_OCTAVE] = min(max(octave, 0), _OCTAVES - 1)
    state[_STEP], state[_LAST] = size, value
    state[_REPEATS], state[_DECIDED] = 0.0, _UNDECIDED
    count, mean = min(state[_CHANGES], _MEAN_FRAMES * per_frame), state[_MEAN]
    state[_MEAN] = mean + (value - mean) / count
    state[_POWER] += ((value - mean) ** 2 - state[_POWER]) / count
    recently = min(count, _ACTIVITY_FRAMES * per_frame)
    state[_ACTIVITY] += (abs(value - mean) - state[_ACTIVITY]) / recently
    found = False
    # In noise of a few steps of the converter, the extreme itself is a frequent value.
    least = max(_LEAST_STEPS * state[_RESOLUTION], _LEAST_ACTIVE * state[_ACTIVITY])
    for tracker in range(4 if over_frame >= least else 0):
        sign = 1.0 if tracker < 2 else -1.0
        recent = RECENT * per_frame if tracker % 2 == 0 else 0
        if _is_rail(
            extremes[tracker], sign * value, sign * state[_MEAN], state[_RESOLUTION], recent
        ):
            state[_UPPER + tracker // 2] = value
            found = True
    return found


@kernel("b1(f8[::1], i8)", inner=True)
def _is_silence(state: FloatArray, per_frame: int) -> bool:
    """Return whether a value that is repeated is one at which a vibration has ended."""
    away = 0.0
    for place in range(_BEFORE, len(state)):
        away += abs(state[place] - state[_LAST])
    away /= len(state) - _BEFORE
    declined = away <= _DECLINED * state[_ACTIVITY] + state[_RESOLUTION]
    if state[_DECIDED] != _AT_REST and not declined:
        return False
    again = False
    for place in range(_STOPS, _BEFORE):
        again |= abs(state[place] - state[_LAST]) <= state[_RESOLUTION]
    frames = state[_CHANGES] / per_frame
    near = _NEAR_MEAN * math.sqrt(state[_POWER] / min(frames, _MEAN_FRAMES))
    near += 0.5 * state[_RESOLUTION]
    first = np.isnan(state[_STOPS]) and abs(state[_LAST] - state[_MEAN]) <= near
    return bool(first or again)


@kernel("b1(f8[::1], f8[:, ::1])", inner=True)
def _is_surprise(state: FloatArray, repeats: FloatArray) -> bool:
    """Learn from a run of repeats, and return whether it is longer than chance allows."""
    octave, could, did = int(state[_OCTAVE]), 0.0, 0.0
    if state[_REPEATS] <= _COUNTED:
        repeats[octave, 0] += 1.0
        repeats[octave, 1] += 1.0
    while octave >= 0 and could < LEAST_LEARNT:
        could, did = could + repeats[octave, 0], did + repeats[octave, 1]
        octave -= 1
    chance = did / could if could >= LEAST_LEARNT else 1.0
    return bool(-state[_REPEATS] * math.log(chance) > _EVIDENCE)


@kernel("b1(f8[:, ::1], b1[::1], i8, i8, f8[::1])")
def _strokes(
    motion: FloatArray, restart: BoolArray, at: int, samples: int, least: FloatArray
) -> bool:
    """Return whether the tool slid under force in the frames of the newest samples up to `at`."""
    per_frame = len(restart) // len(motion)
    last = first = at // per_frame
    frames = -(-samples // per_frame)
    while first > 0 and last - first < frames and not restart[first * per_frame]:
        first -= 1
    x_mm, y_mm = motion[last, 0] - motion[first, 0], motion[last, 1] - motion[first, 1]
    slid = first < last and math.hypot(x_mm, y_mm) >= least[0] * (last - first)
    force_n = 0.0
    for frame in range(first, last + 1):
        force_n += motion[frame, 2]
    return bool(slid and force_n / (last + 1 - first) >= least[1])


@kernel("b1(f8[::1], f8[:, ::1], f8[:, ::1], b1[::1], f8[::1], i8, i8)", inner=True)
def _is_held(
    state: FloatArray,
    repeats: FloatArray,
    motion: FloatArray,
    restart: BoolArray,
    least: FloatArray,
    at: int,
    reach: int,
) -> bool:
    """Add a value that is repeated; return whether it is held."""
    state[_REPEATS] += 1.0
    if state[_CHANGES] == 0.0 or state[_DECIDED] > _AT_REST:
        return bool(state[_CHANGES] and state[_DECIDED] == _HOLDING)
    if state[_DECIDED] == _UNDECIDED and not _is_surprise(state, repeats):
        return False
    if not _strokes(motion, restart, at, min(int(state[_REPEATS]), reach), least):
        state[_DECIDED] = _AT_REST
        return False
    silent = _is_silence(state, len(restart) // len(motion))
    state[_DECIDED] = _SILENT if silent else _HOLDING
    return not silent


@kernel(
    "void(f8[:, ::1], i8[::1], f8[:, ::1], b1[::1], f8[::1], i8, i8,"
    " f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1])"
)
def judge(
    samples: FloatArray,
    cause: IntArray,
    motion: FloatArray,
    restart: BoolArray,
    least: FloatArray,
    at: int,
    reach: int,
    axes: FloatArray,
    repeats: FloatArray,
    extremes: FloatArray,
) -> None:
    """Judge the newest sample, and revise the causes of the samples before it.

    Parameters
    ----------
    samples : (n k, axes)
        Raw acceleration, k samples for each of n frames; missing ones hold anything.
    cause : (n k,)
        See `Cause`; those of the samples `at` - `reach` to `at` may be set.
    motion : (n, 3)
        Raw tangential position in mm, and normal force in N.
    restart : (n k,)
        True at the first sample of a frame that follows a gap which is not filled.
    least : (2,)
        Motion in mm a frame, and force in N, from which on the tool strokes.
    at, reach
        The newest sample, and how many samples before it may still be revised.
    axes, repeats, extremes
        See `ChannelStates`.
    """
    if cause[at] == _MISSING:
        return
    open_from = max(0, at - reach)
    changed = False
    for axis in range(samples.shape[1]):
        state, value = axes[axis], samples[at, axis]
        state[_COUNT] += 1.0
        held = found = False
        if state[_COUNT] == 1.0:
            state[_LAST] = state[_MEAN] = value
        elif value == state[_LAST]:
            held = _is_held(state, repeats[axis], motion, restart, least, at, reach)
        else:
            per_frame = len(samples) // len(motion)
            found = _step(state, value, per_frame, repeats[axis], extremes[axis])
        changed |= state[_CHANGES] != 0.0
        row = at
        while held and row >= open_from and (cause[row] == _MISSING or samples[row, axis] == value):
            cause[row] = _HELD if cause[row] == _MEASURED else cause[row]
            row -= 1
        state[_UPPER] = np.inf if value > state[_UPPER] else state[_UPPER]
        state[_LOWER] = -np.inf if value < state[_LOWER] else state[_LOWER]
        for row in range(open_from if found else at, at + 1):
            other = samples[row, axis]
            if cause[row] != _MISSING and (other == state[_UPPER] or other == state[_LOWER]):
                cause[row] = _SATURATED
    if changed or axes[0, _COUNT] <= reach:
        return
    if axes[0, _DECIDED] == _HOLDING or _strokes(motion, restart, at, reach, least):
        axes[0, _DECIDED] = _HOLDING
        for row in range(open_from, at + 1):
            cause[row] = _CONSTANT if cause[row] == _MEASURED else cause[row]
