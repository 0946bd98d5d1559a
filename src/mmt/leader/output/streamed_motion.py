"""The part that follows the tool's motion and force, for rendering without a hand."""

from typing import Final

from mmt.core.arrays import RecordArray
from mmt.leader.part import Part, Session
from mmt.scene import Texture
from mmt.texture.settings import Axis
from mmt.texture.signals.biquad import MOTION_CUTOFF_HZ, BiquadFilter, bessel_low_pass

_REST_TICKS: Final = 100


class StreamedMotion(Part):
    """The follower's velocity and normal force, for a scene without a hand at the leader.

    Both are low-passed at 20 Hz (Bessel) and lag by the network's delay plus about 11 ms of the
    filter.
    """

    def __init__(self, normal: Axis, rate_hz: float) -> None:
        self._normal = "xyz".index(normal)
        self._tangential = tuple(axis for axis in range(3) if axis != self._normal)
        self._rate_hz = rate_hz
        lowpass = bessel_low_pass(MOTION_CUTOFF_HZ, rate_hz)
        self._filters = tuple(BiquadFilter(lowpass) for _ in range(3))
        self._position = (0.0, 0.0)
        self._next: int | None = None
        self._idle_ticks = 0
        self.velocity_mm_s = (0.0, 0.0)
        self.force_n = 0.0

    @classmethod
    def build(cls, session: Session) -> "StreamedMotion":
        """Return the motion that drives the scene's model."""
        return cls((session.scene.texture or Texture()).normal, session.rate_hz)

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Follow the newest frames (n,)."""
        _ = arrival_ns
        self._idle_ticks = 0
        first, second = self._tangential
        positions = frames["position_mm"].tolist()
        forces = frames["force_n"][:, self._normal].tolist()
        sequences = frames["sequence"].tolist()
        for sequence, position, force in zip(sequences, positions, forces, strict=True):
            raw = (position[first], position[second], force)
            if sequence != self._next:
                for lowpass in self._filters:
                    lowpass.reset()
                self._position = raw[:2]
            self._next = sequence + 1
            x, y, smooth_force = (
                lowpass.step(value) for lowpass, value in zip(self._filters, raw, strict=True)
            )
            rate_hz, (x_before, y_before) = self._rate_hz, self._position
            self.velocity_mm_s = ((x - x_before) * rate_hz, (y - y_before) * rate_hz)
            self._position = (x, y)
            self.force_n = max(0.0, smooth_force)

    def step(self, elapsed: int) -> tuple[float, float, float]:
        """Return velocity (mm/s) and force (N) now, at rest after 100 ticks without a frame."""
        self._idle_ticks += elapsed
        if self._idle_ticks > _REST_TICKS:
            self.on_lost()
        return *self.velocity_mm_s, self.force_n

    def on_lost(self) -> None:
        """Forget the motion: the stream has stopped, or the follower is lost."""
        self._next = None
        self.velocity_mm_s = (0.0, 0.0)
        self.force_n = 0.0
