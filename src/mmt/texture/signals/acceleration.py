"""The vibration in an accelerometer's signal: judged, bridged and high-passed, sample by sample.

The output is delayed by a fixed number of samples. By then it is known whether a sample was a
measurement (`mmt.texture.signals.validity`), and what follows a gap that is bridged
(`mmt.texture.signals.bridging`). After a longer gap the high-pass restarts in the steady state of
the offset before the gap, as gravity does not change in a gap. If the offset has changed all the
same, the high-pass starts anew and needs time to settle.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.signals.biquad import SMALLEST, Biquad
from mmt.texture.signals.bridging import fill, history_of
from mmt.texture.signals.validity import Cause, ChannelStates, judge

SETTLED_SHARE: Final = 0.05
"""Samples count as valid once the transient of a filter's restart has decayed to this share in
amplitude, 0.25 % in power."""

_OFFSET_FRAMES: Final = 300.0  # of the running means of offset and power
_CHANGED_OFFSET: Final = 2.0  # deviations

_MEASURED, _SATURATED = int(Cause.MEASURED), int(Cause.SATURATED)

# columns of the state of an axis, and of the state of all
_FIRST, _SECOND, _OFFSET, _POWER = range(4)
_AGE, _KNOWN, _LOST, _LEFT, _COUNT = range(5)


class FilteredVibration(NamedTuple):
    """Output frames: ``vibration_m_s2`` (n, k, axes), ``cause``, ``valid`` (n,).

    A frame is valid if all its samples are; its cause is that of the first sample not measured.
    """

    vibration_m_s2: FloatArray
    cause: IntArray
    valid: BoolArray


@kernel("b1(i8)", inner=True)
def _is_unknown(cause: int) -> bool:
    """Return whether a sample is not measured; at the end of the range it is, roughly."""
    return cause not in (_MEASURED, _SATURATED)


@kernel("void(f8[:, ::1], i8[::1], b1[::1], i8, i8, i8, i8, i8[::1])", inner=True)
def _bridge(
    samples: FloatArray,
    cause: IntArray,
    restart: BoolArray,
    row: int,
    newest: int,
    longest_bridged: int,
    per_frame: int,
    state: IntArray,
) -> None:
    """Fill the gap that begins at a row if it is short, else mark the filter as lost."""
    if restart[row] or state[_COUNT] == 0:
        state[_LOST], state[_LEFT], state[_KNOWN] = 1, 0, 0
    if state[_LEFT]:
        state[_LEFT] -= 1
        return
    if state[_LOST] or not _is_unknown(cause[row]):
        return
    stop, end = row, row
    while end <= newest and (end == row or not restart[end]):
        end += 1
    while stop < end and _is_unknown(cause[stop]):
        stop += 1
    if stop == end or stop - row > longest_bridged:
        state[_LOST] = 1
        return
    unknown = np.empty(end, np.bool_)
    for at in range(row, end):
        unknown[at] = _is_unknown(cause[at])
    fill(samples, unknown, row, stop, state[_KNOWN], end - 1, per_frame)
    state[_LEFT] = stop - row - 1


@kernel("void(f8[:, ::1], i8[::1], b1[::1], i8, i8, i8, f8[::1], f8[:, ::1], i8[::1])", inner=True)
def _restart(
    samples: FloatArray,
    cause: IntArray,
    restart: BoolArray,
    row: int,
    newest: int,
    settling: int,
    taps: FloatArray,
    axes: FloatArray,
    state: IntArray,
) -> None:
    """Set the filter to the steady state of the known offset, or of the sample itself."""
    stop = row + 1
    while stop <= newest and not _is_unknown(cause[stop]) and not restart[stop]:
        stop += 1
    same = state[_COUNT] >= settling
    for axis in range(samples.shape[1]):
        mean = power = 0.0
        for at in range(row, stop):
            mean += samples[at, axis]
        mean /= stop - row
        for at in range(row, stop):
            power += (samples[at, axis] - mean) ** 2
        usual = math.sqrt(max(power / (stop - row), axes[axis, _POWER]))
        away = abs(mean - axes[axis, _OFFSET])
        same = same and away <= _CHANGED_OFFSET * usual
    for axis in range(samples.shape[1]):
        if not same:
            axes[axis, _OFFSET] = samples[row, axis]
        axes[axis, _FIRST] = taps[5] * axes[axis, _OFFSET]
        axes[axis, _SECOND] = taps[6] * axes[axis, _OFFSET]
    state[_LOST] = 0
    state[_AGE] = settling if same else 0
    if not same:
        state[_COUNT] = 0


@kernel("f8(f8, f8[::1], f8[::1])")
def filtered(value: float, taps: FloatArray, state: FloatArray) -> float:
    """Return a sample filtered by `taps_of`; `state` begins with the two states of the filter."""
    output = taps[0] * value + state[_FIRST]
    first = taps[1] * value - taps[3] * output + state[_SECOND]
    second = taps[2] * value - taps[4] * output
    state[_FIRST] = 0.0 if abs(first) < SMALLEST else first
    state[_SECOND] = 0.0 if abs(second) < SMALLEST else second
    return float(output)


@kernel("void(f8[::1], f8[::1], f8[:, ::1], i8[::1], f8)", inner=True)
def _learn(
    sample: FloatArray, vibration: FloatArray, axes: FloatArray, state: IntArray, longest: float
) -> None:
    """Take a measured sample into the running means of offset and power."""
    state[_COUNT] += 1
    share = 1.0 / min(float(state[_COUNT]), longest)
    for axis in range(len(sample)):
        axes[axis, _OFFSET] += share * (sample[axis] - axes[axis, _OFFSET])
        axes[axis, _POWER] += share * (vibration[axis] ** 2 - axes[axis, _POWER])


@kernel(
    "void(f8[:, ::1], i8[::1], f8[:, ::1], b1[::1], f8[::1], i8[::1], i8[::1], f8[::1],"
    " f8[:, ::1], i8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1], f8[:, ::1], b1[::1])"
)
def _process(
    samples: FloatArray,
    cause: IntArray,
    motion: FloatArray,
    restart: BoolArray,
    least: FloatArray,
    begins: IntArray,
    limits: IntArray,
    taps: FloatArray,
    axes: FloatArray,
    state: IntArray,
    judged: FloatArray,
    repeats: FloatArray,
    extremes: FloatArray,
    vibration: FloatArray,
    valid: BoolArray,
) -> None:
    """Judge each new sample, and filter the one `delay` samples before it."""
    waiting, first = begins
    per_frame = len(samples) // max(len(motion), 1)
    delay, settling, longest_bridged = limits
    for newest in range(first, len(samples)):
        judge(samples, cause, motion, restart, least, newest, delay, judged, repeats, extremes)
        row = newest - delay
        if row < waiting:
            continue
        _bridge(samples, cause, restart, row, newest, longest_bridged, per_frame, state)
        unknown = _is_unknown(cause[row])
        if state[_LOST] and unknown:
            state[_KNOWN] = 0
            continue
        if state[_LOST]:
            _restart(samples, cause, restart, row, newest, settling, taps, axes, state)
        for axis in range(len(axes)):
            vibration[row, axis] = filtered(samples[row, axis], taps, axes[axis])
        if not unknown:
            _learn(samples[row], vibration[row], axes, state, _OFFSET_FRAMES * per_frame)
        valid[row] = cause[row] != _SATURATED and state[_AGE] >= settling
        state[_AGE] += 1
        state[_KNOWN] += 1


def taps_of(section: Biquad) -> FloatArray:
    """Return the coefficients (5) and the steady states (2) for a constant 1, shape (7,)."""
    coefficients = (section.b0, section.b1, section.b2, section.a1, section.a2)
    return np.array([*coefficients, *section.steady_state(1.0)])


class AccelerationFilter:
    """Judge, bridge and high-pass a stream of acceleration; cost: see `StreamFilter`.

    Parameters
    ----------
    high_pass
        The filter, at the rate of the samples.
    axes
        Number of axes; a gap in one is a gap in all.
    per_frame
        Samples in a frame, k.
    delay
        Delay of the output in frames.
    longest_bridged
        Largest number of successive frames without a measurement that are filled.
    least : (2,)
        Tangential motion in mm a frame, and force in N, from which on the tool strokes.
    """

    def __init__(
        self,
        high_pass: Biquad,
        axes: int,
        per_frame: int,
        delay: int,
        longest_bridged: int,
        least: FloatArray,
    ) -> None:
        self._taps = taps_of(high_pass)
        settling = high_pass.settling_samples(SETTLED_SHARE)
        self._limits = np.array([per_frame * delay, settling, per_frame * longest_bridged])
        self._per_frame = per_frame
        self._least = least
        self.channels = ChannelStates(axes, per_frame)
        self._axes = np.zeros((axes, 4))
        self._all = np.zeros(5, np.int64)
        self._history = 0
        self._samples, self._motion = np.zeros((0, axes)), np.zeros((0, 3))
        self._cause = np.zeros(0, np.int64)
        self._restart = np.zeros(0, np.bool_)

    def process(
        self, samples: FloatArray, motion: FloatArray, missing: BoolArray, restart: BoolArray
    ) -> FilteredVibration:
        """Add frames, and return those that are now due.

        Parameters
        ----------
        samples : (n, k, axes)
        motion : (n, 3)
            Raw tangential position in mm, and normal force in N.
        missing : (n,)
            Frames that did not come and are to be filled.
        restart : (n,)
            Frames that follow a gap which is not filled.
        """
        per_frame = self._per_frame
        first = len(self._samples)
        joined = np.concatenate([self._samples, samples.reshape(-1, samples.shape[2])])
        gone = np.repeat(np.where(missing, int(Cause.MISSING), _MEASURED), per_frame)
        cause = np.concatenate([self._cause, gone])
        moved = np.concatenate([self._motion, motion])
        begins = np.zeros(gone.shape, np.bool_)
        begins[::per_frame] = restart
        starts = np.concatenate([self._restart, begins])
        leaving = slice(self._history, max(self._history, len(joined) - int(self._limits[0])))
        vibration, valid = np.zeros_like(joined), np.zeros(len(joined), np.bool_)
        channels = self.channels
        _process(
            joined,
            cause,
            moved,
            starts,
            self._least,
            np.array([self._history, first]),
            self._limits,
            self._taps,
            self._axes,
            self._all,
            channels.axes,
            channels.repeats,
            channels.extremes,
            vibration,
            valid,
        )
        kept = max(0, leaving.stop - history_of(per_frame)) // per_frame * per_frame
        self._history = leaving.stop - kept
        self._samples, self._cause = joined[kept:], cause[kept:]
        self._motion, self._restart = moved[kept // per_frame :], starts[kept:]
        causes = cause[leaving].reshape(-1, per_frame)
        worst = (causes != _MEASURED).argmax(axis=1)
        return FilteredVibration(
            vibration[leaving].reshape(-1, per_frame, vibration.shape[1]),
            causes[np.arange(len(causes)), worst],
            np.logical_and.reduce(valid[leaving].reshape(-1, per_frame), axis=1),
        )
