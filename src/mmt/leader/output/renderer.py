"""What plays from a model or another method's generator, and what it may do besides."""

from typing import Protocol, runtime_checkable

from mmt.core.arrays import FloatArray


class SynthesizedVibration(Protocol):
    """Renders vibration from a model, or from another method's generator."""

    @property
    def directed(self) -> bool:
        """Whether the inputs are velocity x, y and force, not speed and force."""

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return one sample in m/s2 for each moment of the inputs, shape (n,)."""


@runtime_checkable
class TouchDownRenderer(Protocol):
    """A renderer that renders the transient of a touch-down too."""

    def touch_down(self, approach_speed_mm_s: float) -> None:
        """Add the transient to the samples that follow."""


@runtime_checkable
class MotionFollowing(SynthesizedVibration, Protocol):
    """Synthesized vibration that follows the motion even while it is not played."""

    def follow(self, *inputs: FloatArray) -> object:
        """Follow the motion, given the inputs of `render`, without rendering."""
