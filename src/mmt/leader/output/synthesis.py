"""Rendering from a model: the part with the synthesizer, and its motion without a hand."""

import math
from collections import deque
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.part import Part
from mmt.texture.settings import LONGEST_BRIDGED, Axis
from mmt.texture.signals.biquad import MOTION_CUTOFF_HZ, BiquadFilter, bessel_low_pass

if TYPE_CHECKING:
    from mmt.leader.output.renderer import ModelCrossfade
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.synthesis.synthesizer import Synthesizer


APPROACH_S: Final = 0.02
"""Time before the contact over which the approach speed is averaged."""


def at_session_rate(model: "TextureModel", rate_hz: float) -> "tuple[TextureModel, str]":
    """Return a model at the rate of a session's vibration, and a sentence if its own rate differs.

    Slow for a large model: not for the event loop.
    """
    if model.rate_hz == rate_hz:
        return model, ""
    above = f"above {min(model.rate_hz, rate_hz) / 2.0:g} Hz"
    what = (
        f"nothing {above} is in it" if model.rate_hz < rate_hz else f"what is {above} is left out"
    )
    rate_remark = f"the model is of {model.rate_hz:g} Hz and is played at {rate_hz:g} Hz: {what}"
    return model.at_rate(rate_hz), rate_remark


class SynthesizingPart(Part):
    """Holds the synthesizer from which the tick renders; the newest model is assigned to it.

    Parameters
    ----------
    synthesizer
        Renders from one model.
    crossfade
        The same synthesizer, if it crossfades from one surface's model to another's.
    rate_remark
        Sentence for the user about the saved model, "" for none.
    """

    def __init__(
        self,
        synthesizer: "Synthesizer | ModelCrossfade",
        crossfade: "ModelCrossfade | None" = None,
        rate_remark: str = "",
    ) -> None:
        self.synthesizer = synthesizer
        self.crossfade = crossfade
        self.rate_remark = rate_remark


class Landing:
    """Measure the approach speed when a hand's contact begins.

    Parameters
    ----------
    normal
        Number of the surface's normal axis.
    rate_hz
        Rate of the ticks.
    """

    def __init__(self, normal: int, rate_hz: float) -> None:
        self._normal = normal
        self._count = round(APPROACH_S * rate_hz)
        self._speeds: deque[float] = deque(maxlen=self._count)

    def step(self, state: InterfaceState | None, elapsed: int) -> float:
        """Return the approach speed (mm/s) at the first tick of a contact, else 0.

        Return 0 too if the hand was not in the air for `APPROACH_S`. ``elapsed`` is the number of
        ticks since the last call.
        """
        if state is not None and not state.contact:
            ticks = min(elapsed, self._count)
            self._speeds.extend([-state.velocity_mm_s[self._normal]] * ticks)
            return 0.0
        if not self._speeds:
            return 0.0
        mean, whole = sum(self._speeds) / len(self._speeds), len(self._speeds) == self._count
        self._speeds.clear()
        return max(0.0, mean) if whole and state is not None else 0.0


_REST_TICKS: Final = 100


class StreamedMotion(Part):
    """The follower's velocity and normal force, for a scene without a hand at the leader.

    Both are low-passed at 20 Hz (Bessel) and lag by the network's delay plus about 11 ms of the
    filter. Few missing frames are filled by a straight line, as in the modelling; after a longer
    gap, or a farther jump than the robot may make, the filters restart.
    """

    def __init__(self, normal: Axis, rate_hz: float, limit_mm_s: float) -> None:
        self._normal = "xyz".index(normal)
        self._tangential = tuple(axis for axis in range(3) if axis != self._normal)
        self._rate_hz, self._farthest_mm = rate_hz, limit_mm_s / rate_hz
        lowpass = bessel_low_pass(MOTION_CUTOFF_HZ, rate_hz)
        self._filters = tuple(BiquadFilter(lowpass) for _ in range(3))
        self._position, self._raw = (0.0, 0.0), (0.0, 0.0, 0.0)
        self._next: int | None = None
        self._idle_ticks = 0
        self.velocity_mm_s = (0.0, 0.0)
        self.force_n = 0.0

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Follow the newest frames (n,)."""
        self._idle_ticks = 0
        first, second = self._tangential
        positions = frames["position_mm"].tolist()
        forces = frames["force_n"][:, self._normal].tolist()
        sequences = frames["sequence"].tolist()
        for sequence, position, force in zip(sequences, positions, forces, strict=True):
            raw = (position[first], position[second], force)
            missing = -1 if self._next is None else sequence - self._next
            if missing and not self._bridges(missing, raw):
                for lowpass in self._filters:
                    lowpass.reset()
                self._position, missing = raw[:2], 0
            for left in range(missing, -1, -1):
                share, (x_before, y_before) = left / (missing + 1), self._position
                x, y, smooth_force = (
                    lowpass.step(value + share * (before - value))
                    for lowpass, value, before in zip(self._filters, raw, self._raw, strict=True)
                )
                self._position = (x, y)
            rate_hz, self._next, self._raw = self._rate_hz, sequence + 1, raw
            self.velocity_mm_s = ((x - x_before) * rate_hz, (y - y_before) * rate_hz)
            self.force_n = max(0.0, smooth_force)

    def _bridges(self, missing: int, raw: tuple[float, float, float]) -> bool:
        farthest_mm = (missing + 1) * self._farthest_mm
        return 0 < missing <= LONGEST_BRIDGED and math.dist(raw[:2], self._raw[:2]) <= farthest_mm

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
