"""The part that plays the vibration of each frame at once.

Plain Python filters, a few microseconds a frame, so that a leader that only streams needs
neither numba nor scipy.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import RecordArray
from mmt.leader.output.concealment import LONGEST_FRAMES, build_concealment
from mmt.leader.output.playout import PlayoutBuffer
from mmt.leader.part import Part, Session
from mmt.scene import Texture
from mmt.texture.settings import VibrationAxis
from mmt.texture.signals.biquad import (
    VIBRATION_CUTOFF_HZ,
    Biquad,
    BiquadFilter,
    butterworth_high_pass,
)

if TYPE_CHECKING:
    from prometheus_client.core import Metric

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
    """

    def __init__(
        self, buffer: PlayoutBuffer, axis: VibrationAxis, rate_hz: float, samples_per_frame: int = 1
    ) -> None:
        self.buffer = buffer
        self._session: Session | None = None
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

    @classmethod
    def build(cls, session: Session) -> "StreamedVibration | None":
        """Return the scene's playout, or None if no vibration is ever streamed."""
        scene, table = session.scene, session.scene.playout
        if table is None or not scene.streams:
            return None
        texture = scene.texture or Texture()
        buffer = PlayoutBuffer(
            table.delay_ms,
            table.longest_delay_ms,
            session.period_ns,
            build_concealment(scene.concealment, scene.session.seed, session.samples_per_frame),
        )
        made = cls(buffer, texture.axis, session.rate_hz, session.samples_per_frame)
        made._session = session
        return made

    def status(self) -> dict[str, Any]:
        """Return the current delay."""
        return {"playout_delay_ms": self.buffer.statistics().delay_ms}

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return delay and counts of the buffer."""
        _ = duration_s
        remote = self._session.remote if self._session is not None else None
        age_ms = self.buffer.age_ms(remote.clock_offset_ns if remote is not None else None)
        return {"vibration": {"playout": {**asdict(self.buffer.statistics()), "age_ms": age_ms}}}

    def metrics(self) -> "Iterable[Metric]":
        """Return the current delay."""
        from mmt.core.exposition import gauge

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
