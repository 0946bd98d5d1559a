"""From raw frames to aligned speed, normal force and vibration, causally and online.

Motion and force pass a Bessel low-pass (20 Hz, as paper C), acceleration a Butterworth
high-pass (10 Hz, which removes gravity). At the defaults the filters delay the motion by 10.8
frames, the speed (a backward difference) by 0.5 more, and the vibration by less than one; several
samples in a frame lie before the frame's time. A frame is therefore output only when its motion has
passed the filter, `StreamFilter.delay_samples` frames later, with its own sequence number and time.

`mmt.texture.signals.bridging` fills a few missing frames in a row, and
`mmt.texture.signals.validity` finds acceleration that is no measurement. Position and force are not
judged in this way, as a tool at rest and a well controlled force repeat their values. They only
show when an acceleration may repeat its values.

Vibration for the actuator cannot wait for this delay: before the switch to the model the leader
filters the acceleration along one axis by a `mmt.texture.signals.biquad.BiquadFilter`.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray, RecordArray
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.core.frames import check_frames, samples_per_frame
from mmt.core.sequence_numbers import SEQUENCES
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.acceleration import SETTLED_SHARE, AccelerationFilter, filtered, taps_of
from mmt.texture.signals.aligned import AlignedBlock, SignalFaults
from mmt.texture.signals.biquad import (
    MOTION_CUTOFF_HZ,
    VIBRATION_CUTOFF_HZ,
    bessel_low_pass,
    butterworth_high_pass,
)
from mmt.texture.signals.bridging import FrameGaps
from mmt.texture.signals.validity import LEAST_LEARNT, Cause

_LONGEST_GAP: Final = 2**20  # frames, 17 min at 1 kHz, that may be missing at a wrap
_GRID: Final = 1000
"""A new run begins at a multiple of it, after at least as many missing frames. Cells of segments
and blocks lie on the same grid, so that those of a run do not depend on earlier runs."""

_SHORTEST_RUN: Final = 1000  # frames; after them a number not above the first is no repetition
_LATEST: Final = 60_000  # frames behind the newest; a number further back is no late frame


class StreamNumbering:
    """Continue the numbering of a stream across restarts and wraps of the frames' numbers.

    A number that is not above the newest one has one of three reasons. If numbers have wrapped,
    it is unwrapped. If the frame's time is later than the newest frame's, or its number further
    back than a late frame's, the sender has restarted: the frame begins a new run after the
    session so far, with missing frames in between, so that no segment spans both. Otherwise the
    frame is late or repeated, and its number stays in its run.

    Ascending numbers stay as they are. Cost: some 3 ns a frame.
    """

    def __init__(self) -> None:
        self._shift = 0
        self._first: int | None = None  # of the run, as the sender has numbered it
        self._newest = -1
        self._newest_time_ns = 0

    def number(self, frames: RecordArray) -> RecordArray:
        """Return the next frames (n,), renumbered; ``sequence`` is i8 if numbers changed."""
        if not len(frames):
            return frames
        own, times_ns = frames["sequence"].astype(np.int64), frames["time_ns"]
        if self._first is None:
            self._first, self._newest = int(own[0]), int(own[0]) - 1
        shifts = np.full(len(own), self._shift)
        start = 0
        while start < len(own):
            start = self._pass_run(own, times_ns, start)
            if start < len(own):
                self._begin_run(int(own[start]))
                shifts[start:] = self._shift
        if not shifts.any():
            return frames
        names = [(name, frames.dtype[name]) for name in frames.dtype.names or ()]
        kept = [("sequence", np.dtype(np.int64)) if n == "sequence" else (n, d) for n, d in names]
        numbered = frames.astype(np.dtype(kept))
        numbered["sequence"] = own + shifts
        return numbered

    def _pass_run(self, own: IntArray, times_ns: IntArray, start: int) -> int:
        """Record the frames of a run from `start` on; return the start of the next run."""
        newest = np.maximum.accumulate(np.concatenate([[self._newest], own[start:]]))
        behind = np.flatnonzero(own[start:] <= newest[:-1]) + start
        for at in behind.tolist():
            before = int(newest[at - start])
            time_ns = self._newest_time_ns
            if before > self._newest:
                time_ns = int(times_ns[start + int(np.argmax(own[start:at] == before))])
            number, first = int(own[at]), self._first or 0
            wrapped = _has_wrapped(before, number)
            back = number <= first and before >= first + _SHORTEST_RUN
            if wrapped or back or before - number > _LATEST or int(times_ns[at]) > time_ns:
                self._note(own, times_ns, start, at)
                return at
        self._note(own, times_ns, start, len(own))
        return len(own)

    def _note(self, own: IntArray, times_ns: IntArray, start: int, stop: int) -> None:
        if stop > start and int(own[start:stop].max()) >= self._newest:
            at = start + int(np.argmax(own[start:stop]))
            self._newest, self._newest_time_ns = int(own[at]), int(times_ns[at])

    def _begin_run(self, number: int) -> None:
        """Shift the numbers from here on: unwrapped, or on the grid behind the newest frame."""
        if _has_wrapped(self._newest, number):
            self._shift += SEQUENCES
        else:
            behind = self._newest + self._shift + 1
            self._shift = -(-(behind + _GRID) // _GRID) * _GRID - number
        self._first, self._newest = number, number - 1


def _has_wrapped(newest: int, number: int) -> bool:
    return newest >= SEQUENCES - _LONGEST_GAP and number < _LONGEST_GAP


_AXES: Final = "xyz"


class StreamFilter:
    """Filter and align a stream of frames; the cut into blocks does not matter.

    Up to ``longest_bridged_samples`` missing frames in a row are filled and marked as not measured.
    A frame with a number that is not finite, or beyond `bridging.LARGEST_MEASUREMENT`, in a
    channel that is used counts as missing. After a longer gap the filters restart: those of motion
    and force in the steady state of the first frame after it, that of the vibration in the steady
    state of its offset before it. Samples are marked invalid until the filters have settled. The
    last `delay_samples` frames before such a gap are not output, as their filtered motion is
    missing; the newest frames are output later. The numbering continues if the frames' own numbers
    restart or wrap (`StreamNumbering`); times are examined only for this. Frames that
    come late or twice are ignored.

    Cost: about 0.1 ms a block plus 0.5 us a frame (four channels and one axis; 0.8 us with three
    axes) and 0.3 us for each further sample of a frame (0.7 us with three axes): give it many
    frames at a time. The results are the same to the bit for any partition into blocks.

    Parameters
    ----------
    settings
        Axes, rates, longest gap to fill, and least speed and force of a stroke (a value can be
        held only in a stroke). None takes the defaults.

    Raises
    ------
    InputError
        The rate is too low for the filters.
    """

    def __init__(self, settings: ModellingSettings | None = None) -> None:
        settings = settings or ModellingSettings()
        rate_hz, axis = settings.rate_hz, settings.axis
        low_pass = bessel_low_pass(MOTION_CUTOFF_HZ, rate_hz)
        high_pass = butterworth_high_pass(VIBRATION_CUTOFF_HZ, settings.vibration_rate_hz)
        self._rate_hz, self._per_frame = rate_hz, settings.samples_per_frame
        normal, longest_bridged = _AXES.index(settings.normal), settings.longest_bridged_samples
        self._tangential = [k for k in range(3) if k != normal]
        axes = [0, 1, 2] if axis == "dft321" else [_AXES.index(axis)]
        speed = low_pass.delay_samples(0.0) + 0.5
        vibration = high_pass.delay_samples(
            min(10.0 * VIBRATION_CUTOFF_HZ, high_pass.rate_hz / 4.0)
        )
        middle = vibration + 0.5 * (self._per_frame - 1)
        self.delay_samples = max(0, round(speed - middle / self._per_frame))
        """Frames by which the vibration is held back to meet the speed: the difference of the group
        delays at low frequency and a decade above the high-pass's cutoff, less half a frame's
        samples."""
        self._motion_settling = low_pass.settling_samples(SETTLED_SHARE)
        self._low_taps, self._low_state = taps_of(low_pass), np.zeros((4, 2))
        self._vibration = AccelerationFilter(
            high_pass,
            len(axes),
            self._per_frame,
            self.delay_samples,
            longest_bridged,
            np.array([settings.least_speed_mm_s / rate_hz, settings.least_force_n]),
        )
        self._last_position_mm = np.zeros(3)
        self._run_start = -1
        self._numbering = StreamNumbering()
        self.first, self.newest = 0, -1
        """Session's numbers of the first frame and of the newest one."""
        self._gaps = FrameGaps(normal, axes, longest_bridged, self._per_frame)
        self._waiting = np.zeros((2, 0), np.int64)
        self._bridged = 0
        self._causes = np.zeros(len(Cause), np.int64)

    @property
    def faults(self) -> SignalFaults:
        """Faults of the signals so far."""
        causes, rate_hz = self._causes, self._rate_hz
        constant = int(causes[Cause.CONSTANT])
        constant = constant if constant >= LEAST_LEARNT else 0
        return SignalFaults(
            held_s=int(causes[Cause.HELD]) / rate_hz,
            saturated_s=int(causes[Cause.SATURATED]) / rate_hz,
            constant_s=constant / rate_hz,
            not_finite_s=self._gaps.not_finite / rate_hz,
            missing_s=self._gaps.missing / rate_hz,
            bridged_s=self._bridged / rate_hz,
            throughout=constant > 0 and not self._vibration.channels.changed,
        )

    def process(self, frames: RecordArray) -> AlignedBlock:
        """Filter the next frames (n,), n >= 0, and return the samples that are now complete.

        Raises
        ------
        InputError
            The array holds no frames, lacks position, force or acceleration, or the number of
            samples in a frame is not that of the settings.
        """
        check_frames(frames)
        given = samples_per_frame(frames.dtype)
        if given != self._per_frame:
            raise InputError(
                f"a frame has {given} samples of the acceleration, the settings say "
                f"samples_per_frame = {self._per_frame}"
            )
        numbered = self._numbering.number(frames)
        if len(numbered):
            self.first = int(numbered["sequence"][0]) if self.newest < 0 else self.first
            self.newest = max(self.newest, int(numbered["sequence"].max()))
        elements, restart = self._gaps.fill(numbered)
        index, motion = elements.index, elements.motion
        settled = self._settled(index, restart)
        raw_motion = motion.take([*self._tangential, 3], axis=1)
        _filter_channels(motion, restart, self._low_taps, self._low_state)
        position_mm = np.ascontiguousarray(motion[:, :3])
        step_mm = self._steps(position_mm, restart)
        speed_mm_s = np.hypot(step_mm[:, 0], step_mm[:, 1]) * self._rate_hz
        force_n = np.maximum(motion[:, 3], 0.0)
        found = self._vibration.process(
            elements.acceleration, raw_motion, elements.missing, restart
        )

        waiting = self._waiting.shape[1]
        everything = np.concatenate([self._waiting, [index, elements.time_ns]], axis=1)
        complete = max(0, everything.shape[1] - self.delay_samples)
        self._waiting = everything[:, complete:]
        measured = found.cause == Cause.MEASURED
        self._causes += np.bincount(found.cause, minlength=len(Cause))
        self._bridged += int(np.count_nonzero(found.valid & ~measured))
        # The motion of element i is in the filter's output `delay_samples` elements later, and
        # never among the waiting elements, which are at most that many.
        later = slice(self.delay_samples - waiting, None) if complete else slice(0)
        ready, time_ns = everything[:, :complete]
        unbroken = index[later] - ready == self.delay_samples
        return AlignedBlock(
            index=ready[unbroken],
            time_ns=time_ns[unbroken],
            position_mm=position_mm[later][unbroken],
            velocity_mm_s=step_mm[later][unbroken] * self._rate_hz,
            speed_mm_s=speed_mm_s[later][unbroken],
            normal_force_n=force_n[later][unbroken],
            vibration_m_s2=found.vibration_m_s2[unbroken],
            valid=(found.valid & settled[later])[unbroken],
            measured=measured[unbroken],
        )

    def _settled(self, index: IntArray, restart: BoolArray) -> BoolArray:
        """Return where the filters of motion and force have settled, (n,)."""
        starts = np.maximum.accumulate(
            np.concatenate([[self._run_start], np.where(restart, index, -1)])
        )
        self._run_start = int(starts[-1])
        return index - starts[1:] >= self._motion_settling

    def _steps(self, position_mm: FloatArray, restart: BoolArray) -> FloatArray:
        """Return the tangential motion from sample to sample (n, 2)."""
        before = np.concatenate([self._last_position_mm[None], position_mm])
        self._last_position_mm = before[-1].copy()
        step_mm = np.diff(before, axis=0)
        step_mm[restart] = 0.0
        return step_mm[:, self._tangential]


@kernel("void(f8[:, ::1], b1[::1], f8[::1], f8[:, ::1])")
def _filter_channels(
    samples: FloatArray, restart: BoolArray, taps: FloatArray, state: FloatArray
) -> None:
    """Filter (n, channels) in place from and into `state` (channels, 2); O(n channels)."""
    for channel in range(samples.shape[1]):
        own = state[channel]
        for n in range(samples.shape[0]):
            if restart[n]:
                own[0], own[1] = taps[5] * samples[n, channel], taps[6] * samples[n, channel]
            samples[n, channel] = filtered(samples[n, channel], taps, own)
