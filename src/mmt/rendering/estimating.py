"""The second part of rendering: the filter of the vibration, from the hand's motion."""

from collections.abc import Sequence
from dataclasses import dataclass

from mmt.core.errors import InputError
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.generation import VibrationFilter, estimate


@dataclass(frozen=True)
class Touch:
    """Motion of the hand: texture that is touched, velocity, and normal force."""

    texture: int
    velocity_x_mm_s: float
    velocity_y_mm_s: float
    force_n: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """Filter by which to generate, and the sampling rate that it is valid at.

    The newest estimate is replaced by one assignment, so that estimator and generator may run in
    threads of their own without a lock.
    """

    filter: VibrationFilter
    rate_hz: float


class Estimator:
    """Keep the newest estimate for the newest touch.

    Parameters
    ----------
    models
        The textures, at least one.
    """

    def __init__(self, models: Sequence[TextureModel]) -> None:
        self._models = tuple(models)
        self._touch: Touch | None = None
        self.newest: Estimate | None = None
        """The newest estimate; None before the first touch, and while nothing is touched."""

    def touch(self, touch: Touch | None) -> None:
        """Set the present motion of the hand; None if it touches nothing.

        Raises
        ------
        InputError
            There is no such texture.
        """
        count = len(self._models)
        if touch is not None and not 0 <= touch.texture < count:
            raise InputError(f"texture {touch.texture}: there are {count}, counted from 0")
        self._touch = touch

    def estimate(self) -> None:
        """Update `newest`; takes some 50 us with a triangulation."""
        touch = self._touch
        if touch is None:
            self.newest = None
            return
        model = self._models[touch.texture]
        inputs = model.space.from_motion(
            touch.velocity_x_mm_s, touch.velocity_y_mm_s, touch.force_n
        )[0]
        self.newest = Estimate(estimate(model, *inputs), model.rate_hz)
