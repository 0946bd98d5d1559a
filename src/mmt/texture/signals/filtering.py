"""From raw frames to aligned speed, normal force and vibration, causally and online.

Motion and force pass a Bessel low-pass (20 Hz, as paper C), acceleration a Butterworth
high-pass (10 Hz; it takes gravity away). The filters delay: the motion by 10.8 samples at
the defaults and the speed, a backward difference, by 0.5 more; the vibration by less than
one. A frame is therefore given out only when the motion that belongs to it has passed its
filter, `StreamFilter.delay_samples` frames later, under its own sequence number and time.

Vibration for the actuator must not wait for that: before the switch to the model the leader
takes the acceleration along one axis through a `mmt.texture.signals.biquad.BiquadFilter`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray, RecordArray
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.core.frames import FIELD_OF_CHANNEL
from mmt.texture.settings import Axis, VibrationAxis
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.biquad import SMALLEST, Biquad, bessel_low_pass, butterworth_high_pass

SETTLED_SHARE: Final = 0.05
"""Samples count as valid when what a filter's restart left has decayed to this share in
amplitude, 0.25 % in power."""

VIBRATION_CUTOFF_HZ: Final = 10.0
"""The published corner of the high-pass of the acceleration."""

LARGEST_MEASUREMENT: Final = 1e6
"""No position (mm), force (N) or acceleration (m/s2) is beyond this: a broken number."""

_AXES: Final = "xyz"


@dataclass(frozen=True)
class ChannelDelays:
    """Group delays in samples, and the whole delay that aligns the channels.

    ``position``, ``force`` and ``speed`` are limits at low frequency; ``vibration`` is taken
    a decade above the high-pass's cutoff. ``alignment`` is the whole number of samples by
    which the vibration is held back to meet the speed.
    """

    position: float
    force: float
    speed: float
    vibration: float
    alignment: int

    def residual(self) -> dict[str, float]:
        """Return how many samples each motion channel still lags behind the vibration."""
        held = self.alignment + self.vibration
        return {
            "position": self.position - held,
            "force": self.force - held,
            "speed": self.speed - held,
        }


class StreamFilter:
    """Filter and align a stream of frames; the cut into blocks does not matter.

    After a gap in the sequence every filter restarts in the steady state of the first frame
    behind it, and `warm_up_samples` samples are marked invalid. Frames whose motion the gap
    has swallowed (the last `delay_samples` before it) are not given out, and the newest
    ones not yet: nothing is invented. A frame with a number that is not finite, or beyond
    `LARGEST_MEASUREMENT`, in a channel that is used counts as missing. Frames that come
    late or twice (sequence not above the newest) are ignored.

    Cost: about 0.05 ms a block plus 0.1 us a frame (four channels and one); feed it many at
    a time. The results are the same to the bit for any partition into blocks.

    Parameters
    ----------
    normal
        The surface's normal axis.
    axis
        Source of the vibration: one axis, or all three for DFT321.
    rate_hz, motion_cutoff_hz, vibration_cutoff_hz
        Frames a second, and the cutoffs of the low-pass and of the high-pass.

    Raises
    ------
    InputError
        A cutoff does not fit the rate.
    """

    def __init__(
        self,
        normal: Axis = "z",
        axis: VibrationAxis = "z",
        rate_hz: float = 1000.0,
        motion_cutoff_hz: float = 20.0,
        vibration_cutoff_hz: float = VIBRATION_CUTOFF_HZ,
    ) -> None:
        low_pass = bessel_low_pass(motion_cutoff_hz, rate_hz)
        high_pass = butterworth_high_pass(vibration_cutoff_hz, rate_hz)
        self._rate_hz = rate_hz
        self._normal = _AXES.index(normal)
        self._tangential = [k for k in range(3) if k != self._normal]
        self._axes = [0, 1, 2] if axis == "dft321" else [_AXES.index(axis)]
        self._low_taps, self._high_taps = _taps(low_pass), _taps(high_pass)
        self.delays = _delays(low_pass, high_pass, vibration_cutoff_hz)
        self.delay_samples = self.delays.alignment
        self.warm_up_samples = max(
            high_pass.settling_samples(SETTLED_SHARE),
            low_pass.settling_samples(SETTLED_SHARE) - self.delay_samples,
        )
        self.reset()

    def reset(self) -> None:
        """Forget the past, as for a new session whose sequence starts anew."""
        self._low_state = np.zeros((4, 2))
        self._high_state = np.zeros((len(self._axes), 2))
        self._last_position_mm = np.zeros(3)
        self._last_index = self._run_start = -2
        self._pending = _Pending(
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
            np.zeros((0, len(self._axes))),
            np.zeros(0, np.bool_),
        )

    def process(self, frames: RecordArray) -> AlignedBlock:
        """Filter the next frames (n,), n >= 0, and return the samples that are now complete.

        Raises
        ------
        InputError
            The frames lack position, force or acceleration.
        """
        index, time_ns, motion, vibration = self._usable(frames)
        restart, valid = self._runs(index)
        _filter_channels(motion, restart, self._low_taps, self._low_state)
        _filter_channels(vibration, restart, self._high_taps, self._high_state)
        position_mm = np.ascontiguousarray(motion[:, :3])
        step_mm = self._steps(position_mm, restart)
        speed_mm_s = np.hypot(step_mm[:, 0], step_mm[:, 1]) * self._rate_hz
        force_n = np.maximum(motion[:, 3], 0.0)

        waiting = self._pending
        everything = _Pending(
            np.concatenate([waiting.index, index]),
            np.concatenate([waiting.time_ns, time_ns]),
            np.concatenate([waiting.vibration_m_s2, vibration]),
            np.concatenate([waiting.valid, valid]),
        )
        complete = max(0, len(everything.index) - self.delay_samples)
        self._pending = everything[complete:]
        # The motion of element i is in the filter's output `delay_samples` elements later;
        # never among those that waited, for they are at most as many.
        later = slice(self.delay_samples - len(waiting.index), None) if complete else slice(0)
        ready = everything[:complete]
        later_index = index[later]
        unbroken = later_index - ready.index == self.delay_samples
        return AlignedBlock(
            index=ready.index[unbroken],
            time_ns=ready.time_ns[unbroken],
            position_mm=position_mm[later][unbroken],
            velocity_mm_s=step_mm[later][unbroken] * self._rate_hz,
            speed_mm_s=speed_mm_s[later][unbroken],
            normal_force_n=force_n[later][unbroken],
            vibration_m_s2=ready.vibration_m_s2[unbroken],
            valid=ready.valid[unbroken],
        )

    def _usable(self, frames: RecordArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return sequence, time, (n, 4) position and force, (n, axes) acceleration."""
        names = frames.dtype.names or ()
        missing = [channel for channel, field in FIELD_OF_CHANNEL.items() if field not in names]
        if missing:
            raise InputError(
                f"frames without {', '.join(missing)}: a texture model needs "
                f"{', '.join(FIELD_OF_CHANNEL)}; add the channels to the scene"
            )
        index = frames["sequence"].astype(np.int64)
        motion = np.empty((len(frames), 4))
        motion[:, :3] = frames["position_mm"]
        motion[:, 3] = frames["force_n"][:, self._normal]
        vibration = frames["acceleration_m_s2"][:, self._axes].astype(np.float64)
        good = (np.abs(motion) <= LARGEST_MEASUREMENT).all(axis=1)
        good &= (np.abs(vibration) <= LARGEST_MEASUREMENT).all(axis=1)
        received = np.concatenate([[self._last_index], np.where(good, index, -2)])
        good &= index > np.maximum.accumulate(received)[:-1]
        return index[good], frames["time_ns"][good].astype(np.int64), motion[good], vibration[good]

    def _runs(self, index: IntArray) -> tuple[BoolArray, BoolArray]:
        """Return where the filters restart and which samples are valid, both (n,)."""
        before = np.concatenate([[self._last_index], index])
        restart = np.diff(before) != 1
        starts = np.maximum.accumulate(
            np.concatenate([[self._run_start], np.where(restart, index, -2)])
        )
        self._last_index, self._run_start = int(before[-1]), int(starts[-1])
        return restart, index - starts[1:] >= self.warm_up_samples

    def _steps(self, position_mm: FloatArray, restart: BoolArray) -> FloatArray:
        """Return the tangential motion from sample to sample (n, 2)."""
        before = np.concatenate([self._last_position_mm[None], position_mm])
        self._last_position_mm = before[-1].copy()
        step_mm = np.diff(before, axis=0)
        step_mm[restart] = 0.0
        return step_mm[:, self._tangential]


class SectionFilter:
    """One second-order section, applied to all channels of a signal block by block.

    Parameters
    ----------
    section
        Coefficients for all channels; it starts in the steady state of the first sample.
    """

    def __init__(self, section: Biquad) -> None:
        self._taps = _taps(section)
        self._state: FloatArray | None = None

    def process(self, samples: FloatArray, restart: BoolArray) -> FloatArray:
        """Filter samples (n, channels), restarting where `restart` (n,) is true."""
        if self._state is None:
            self._state = np.zeros((samples.shape[1], 2))
        filtered = np.array(samples, dtype=np.float64, order="C")
        _filter_channels(filtered, restart, self._taps, self._state)
        return filtered


@dataclass(frozen=True, eq=False)
class _Pending:
    """Frames that wait for the motion filters' delay."""

    index: IntArray
    time_ns: IntArray
    vibration_m_s2: FloatArray
    valid: BoolArray

    def __getitem__(self, part: slice) -> "_Pending":
        return _Pending(
            self.index[part], self.time_ns[part], self.vibration_m_s2[part], self.valid[part]
        )


def _taps(section: Biquad) -> FloatArray:
    """Return the coefficients (5) and the steady states (2) for a constant 1, shape (7,)."""
    coefficients = (section.b0, section.b1, section.b2, section.a1, section.a2)
    return np.array([*coefficients, *section.steady_state(1.0)])


def _delays(low_pass: Biquad, high_pass: Biquad, vibration_cutoff_hz: float) -> ChannelDelays:
    motion = low_pass.delay_samples(0.0)
    reference_hz = min(10.0 * vibration_cutoff_hz, high_pass.rate_hz / 4.0)
    vibration = high_pass.delay_samples(reference_hz)
    speed = motion + 0.5
    return ChannelDelays(motion, motion, speed, vibration, max(0, round(speed - vibration)))


@kernel("void(f8[:, ::1], b1[::1], f8[::1], f8[:, ::1])")
def _filter_channels(
    samples: FloatArray, restart: BoolArray, taps: FloatArray, state: FloatArray
) -> None:
    """Filter (n, channels) in place from and into `state` (channels, 2); O(n channels)."""
    b0, b1, b2, a1, a2, first_of_one, second_of_one = taps
    for channel in range(samples.shape[1]):
        first, second = state[channel]
        for n in range(samples.shape[0]):
            value = samples[n, channel]
            if restart[n]:
                first, second = first_of_one * value, second_of_one * value
            output = b0 * value + first
            first = b1 * value - a1 * output + second
            second = b2 * value - a2 * output
            if abs(first) < SMALLEST:
                first = 0.0
            if abs(second) < SMALLEST:
                second = 0.0
            samples[n, channel] = output
        state[channel, 0], state[channel, 1] = first, second
