"""Streamed vibration, played through a buffer that bridges the jitter of the network.

Frames of vibration are played in the order of their sequence numbers, one a tick, a delay after
the quickest frame would have arrived. The delay follows the measured jitter. A frame that is
missing at its turn is concealed (`mmt.leader.output.concealment`). When the stream stops, the
buffer runs empty and the output falls silent, so that no frame older than the buffer is played. A
step in either clock is detected, the follower's by its sequence numbers and the leader's by its
ticks, and the clocks are compared anew.

Plain Python filters, a few microseconds a frame, so that a leader that only streams needs
neither numba nor scipy.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from mmt.core.arrays import RecordArray
from mmt.leader.output.concealment import LONGEST_FRAMES, Concealment, FadeOut
from mmt.leader.part import Part, Session
from mmt.texture.settings import VibrationAxis
from mmt.texture.signals.biquad import (
    VIBRATION_CUTOFF_HZ,
    Biquad,
    BiquadFilter,
    butterworth_high_pass,
)

if TYPE_CHECKING:
    from prometheus_client.core import Metric


_RING: Final = 4096
_WINDOW_TICKS: Final = 2000
_SPREAD_EVERY: Final = 100
_SLIP_EVERY: Final = 20
_RESYNC_FRAMES: Final = 50
_MARGIN_FRAMES: Final = 2
_CLOCK_STEP_NS: Final = 100_000_000


@dataclass(frozen=True)
class PlayoutStatistics:
    """Delay and counts of the buffer.

    ``delay_ms`` is the current delay between the time at which the quickest frame would have
    arrived and its turn. ``bridged`` counts frames that were missing at their turn, ``late``
    frames that came after it, ``slips`` single frames skipped or repeated to hold the delay, and
    ``resyncs`` jumps after an interruption.
    """

    delay_ms: float
    played: int
    bridged: int
    late: int
    slips: int
    resyncs: int


class PlayoutBuffer:
    """A jitter buffer for one channel of vibration.

    Parameters
    ----------
    delay_ms
        Fixed delay, or "auto": the 99th percentile of the arrivals' lateness over the last
        two seconds, plus two frames. Frames that are later than the longest delay do not
        count, because no delay would save them.
    longest_delay_ms
        Bound of the automatic delay.
    period_ns
        Time between frames.
    concealment
        Fills in for missing frames; None fades out and in, with one sample a frame.
    """

    def __init__(
        self,
        delay_ms: float | Literal["auto"] = "auto",
        longest_delay_ms: float = 100.0,
        period_ns: int = 1_000_000,
        concealment: Concealment | None = None,
    ) -> None:
        self._concealment = concealment or FadeOut()
        self._period_ns = period_ns
        self._automatic = delay_ms == "auto"
        self._longest = max(1, round(longest_delay_ms * 1e6 / period_ns))
        fixed = _MARGIN_FRAMES if delay_ms == "auto" else round(delay_ms * 1e6 / period_ns)
        self._delay = min(max(fixed, 0), self._longest)
        self._values: list[Sequence[float]] = [()] * _RING
        self._sequences = list(range(1, _RING + 1))  # none at its own place, so none matches yet
        self._newest = -1
        self._next: int | None = None
        self._lags: deque[int] = deque(maxlen=_WINDOW_TICKS)
        self._anchor: tuple[int, int] | None = None  # (sequence, time_ns) of the newest frame
        self._quickest_ns = 0
        self._now_ns: int | None = None
        self._ticks = 0
        self._played = self._bridged = self._late = self._slips = self._resyncs = 0

    def push(self, sequence: int, time_ns: int, arrival_ns: int, values: Sequence[float]) -> None:
        """Take a frame's samples, its follower's time stamp and the leader's arrival time."""
        lag = arrival_ns - time_ns
        if self._anchor is not None:
            expected_ns = self._anchor[1] + (sequence - self._anchor[0]) * self._period_ns
            if abs(time_ns - expected_ns) > _CLOCK_STEP_NS:
                self._forget_clocks()
        self._lags.append(lag)
        if self._anchor is None or lag < self._quickest_ns:
            self._quickest_ns = lag
        if self._next is not None and sequence < self._next:
            self._late += 1
        if sequence > self._newest:
            self._newest = sequence
            self._anchor = (sequence, time_ns)
        place = sequence % _RING
        self._values[place] = values
        self._sequences[place] = sequence

    def pull(self, now_ns: int) -> Sequence[float]:
        """Return the samples of this tick; call once for each tick, missed ones included."""
        self._ticks += 1
        if self._now_ns is not None:
            step_ns = now_ns - self._now_ns - self._period_ns
            if abs(step_ns) > _CLOCK_STEP_NS:
                self._forget_clocks()
        self._now_ns = now_ns
        if self._anchor is not None:
            if self._ticks % _SPREAD_EVERY == 0:
                self._follow_jitter()
            self._hold_delay(self._due(now_ns, self._anchor))
        if self._next is None:
            return self._concealment.bridge()
        sequence = self._next
        self._next = sequence + 1
        place = sequence % _RING
        if self._sequences[place] == sequence:
            self._played += 1
            return self._concealment.play(self._values[place])
        if sequence <= self._newest + self._longest:
            self._bridged += 1
        return self._concealment.bridge()

    def statistics(self) -> PlayoutStatistics:
        """Return the counts so far."""
        return PlayoutStatistics(
            delay_ms=self._delay * self._period_ns / 1e6,
            played=self._played,
            bridged=self._bridged,
            late=self._late,
            slips=self._slips,
            resyncs=self._resyncs,
        )

    def age_ms(self, clock_offset_ns: int | None) -> float | None:
        """Return how long after its measurement a frame is played (ms), or None if unknown.

        Parameters
        ----------
        clock_offset_ns
            The follower's clock minus this one, or None if it is not known.
        """
        if clock_offset_ns is None or self._anchor is None:
            return None
        quickest_ns = self._quickest_ns + clock_offset_ns
        return round((quickest_ns + self._delay * self._period_ns) / 1e6, 3)

    def _forget_clocks(self) -> None:
        """Compare the clocks anew from the next frame on; frames in the buffer are still played."""
        self._lags.clear()
        self._anchor = None

    def _due(self, now_ns: int, anchor: tuple[int, int]) -> int:
        """Return the sequence number whose turn it is at this time."""
        sequence, time_ns = anchor
        since = now_ns - self._quickest_ns - time_ns
        return sequence + since // self._period_ns - self._delay

    def _follow_jitter(self) -> None:
        lags = sorted(self._lags)
        self._quickest_ns = lags[0]
        if not self._automatic:
            return
        saved = bisect_right(lags, lags[0] + self._longest * self._period_ns)
        spread = lags[min(saved - 1, (99 * saved) // 100)] - lags[0]
        wanted = -(-spread // self._period_ns) + _MARGIN_FRAMES
        self._delay = min(int(wanted), self._longest)

    def _hold_delay(self, due: int) -> None:
        """Slip by one frame now and then; jump after an interruption or in silence."""
        if self._next is None:
            self._next = due if due >= 0 else None
            return
        off = due - self._next
        if abs(off) > _RESYNC_FRAMES:
            self._next = due
            self._resyncs += 1
        elif abs(off) > 1 and self._concealment.silent:
            self._next = due
        elif abs(off) > 1 and self._ticks % _SLIP_EVERY == 0:
            self._next += 1 if off > 0 else -1
            self._slips += 1


_PEAK_DECAY: Final = 0.995
_PEAKS: Final = 2.0


class StreamedVibration(Part):
    """High-pass the streamed acceleration and pass it to the playout buffer.

    If the model reduces three axes by DFT321, the stream does so too, by `ThreeAxes`.

    Parameters
    ----------
    buffer
        Plays the vibration of frames.
    axis
        Direction of the acceleration that is played.
    rate_hz
        Rate of the frames.
    samples_per_frame
        Samples of acceleration in a frame.
    session
        Session of the run, whose follower's clock gives the age; None outside a run.
    """

    def __init__(
        self,
        buffer: PlayoutBuffer,
        axis: VibrationAxis,
        rate_hz: float,
        samples_per_frame: int = 1,
        session: Session | None = None,
    ) -> None:
        self.buffer = buffer
        self._session = session
        high_pass = butterworth_high_pass(VIBRATION_CUTOFF_HZ, samples_per_frame * rate_hz)
        self._samples_per_frame = samples_per_frame
        self._axis: int | slice
        self._high_pass: BiquadFilter | _AllAxes
        if axis == "dft321":
            self._axis, self._high_pass = slice(None), _AllAxes(high_pass, rate_hz)
        else:
            self._axis, self._high_pass = "xyz".index(axis), BiquadFilter(high_pass)
        self._next: int | None = None
        self._peak = 0.0

    def status(self) -> dict[str, Any]:
        """Return the current delay."""
        return {"playout_delay_ms": self.buffer.statistics().delay_ms}

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return delay and counts of the buffer."""
        remote = self._session.remote if self._session is not None else None
        age_ms = self.buffer.age_ms(remote.clock_offset_ns if remote is not None else None)
        return {"vibration": {"playout": {**asdict(self.buffer.statistics()), "age_ms": age_ms}}}

    def metrics(self) -> "Iterable[Metric]":
        """Return the current delay."""
        from mmt.core.output.exposition import gauge

        delay_s = self.buffer.statistics().delay_ms / 1e3
        yield gauge("playout_delay_seconds", "Delay of the playout buffer.", delay_s)

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Filter frames (n,) and queue their vibration.

        The filter is not reset at a gap that can be concealed: after a reset its output would
        have an offset that decays for longer than the gap lasted. The filter is reset after a
        longer gap, and if the acceleration has moved by more than it vibrates.
        """
        samples = frames["acceleration_m_s2"].reshape(-1, self._samples_per_frame, 3)
        values = samples[..., self._axis].tolist()
        sequences = frames["sequence"].tolist()
        times_ns = frames["time_ns"].tolist()
        high_pass = self._high_pass
        for sequence, time_ns, value in zip(sequences, times_ns, values, strict=True):
            vibration = high_pass.steps(value)
            if sequence != self._next and not self._goes_on(sequence, vibration):
                high_pass.reset()
                vibration = high_pass.steps(value)
            self._next = sequence + 1
            largest = max(map(abs, vibration))
            self._peak = max(largest, _PEAK_DECAY * self._peak)
            self.buffer.push(sequence, time_ns, arrival_ns, vibration)

    def _goes_on(self, sequence: int, vibration: Sequence[float]) -> bool:
        """Return whether a frame's samples continue those before the gap."""
        near = self._next is not None and 0 < sequence - self._next <= LONGEST_FRAMES
        return near and max(map(abs, vibration)) <= _PEAKS * self._peak


class _AllAxes:
    """Replaces the filter of one axis if three are played: high-passes and reduces all three."""

    def __init__(self, high_pass: Biquad, rate_hz: float) -> None:
        from mmt.leader.output.three_axes import ThreeAxes

        self._filters = tuple(BiquadFilter(high_pass) for _ in range(3))
        self._together = ThreeAxes(rate_hz)

    def reset(self) -> None:
        """Restart the filters; the directions stay."""
        for each in self._filters:
            each.reset()

    def steps(self, acceleration_m_s2: Sequence[Sequence[float]]) -> list[float]:
        """Return the vibration of a frame's samples, each of three axes."""
        x, y, z = map(BiquadFilter.steps, self._filters, zip(*acceleration_m_s2, strict=True))
        return self._together.steps(x, y, z)
