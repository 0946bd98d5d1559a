"""The second part of rendering: from what a hand does to the filter that vibrates."""

from collections.abc import Sequence
from dataclasses import dataclass

from mmt.core.errors import InputError
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.generation import VibrationFilter, estimate


@dataclass(frozen=True)
class Touch:
    """What the hand does: on which texture it moves, how fast, and how hard it presses."""

    texture: int
    velocity_x_mm_s: float
    velocity_y_mm_s: float
    force_n: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """What to generate: a filter, and the sampling rate that it is valid at.

    The generator's buffer is one of these, replaced by one assignment, so that the two may run in
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
        """None before the first touch, and where nothing is touched."""

    def use(self, models: Sequence[TextureModel]) -> None:
        """Go on with other models, as many as before.

        Raises
        ------
        InputError
            They are more or fewer.
        """
        if len(models) != len(self._models):
            raise InputError(f"{len(models)} models in place of {len(self._models)}")
        self._models = tuple(models)

    def touch(self, touch: Touch | None) -> None:
        """Take note of what the hand does now; None where it touches nothing.

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
        """Bring `newest` up to date; some 50 us by triangles."""
        touch = self._touch
        if touch is None:
            self.newest = None
            return
        model = self._models[touch.texture]
        inputs = model.space.from_motion(
            touch.velocity_x_mm_s, touch.velocity_y_mm_s, touch.force_n
        )[0]
        self.newest = Estimate(estimate(model, *inputs), model.rate_hz)
