"""Vibration of a known surface under a hand whose motion and force change, sample by sample."""

from abc import ABC, abstractmethod
from typing import NamedTuple


class Stroke(NamedTuple):
    """What the tip does on the surface."""

    speed_mm_s: float
    force_n: float
    heading: tuple[float, float] = (1.0, 0.0)
    """Unit vector of its velocity in the plane."""
    position_mm: tuple[float, float] = (0.0, 0.0)
    """Its place in the plane."""


class VibrationSource(ABC):
    """Makes the vibration of a surface at the surface's rate."""

    @property
    def friction_coefficient(self) -> float | None:
        """Friction of the surface that a course has reached, or None without a course."""
        return None

    @abstractmethod
    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples of a stroke that stays the same meanwhile.

        Returns
        -------
        samples
            The acceleration (m/s2) along the normal and along the heading, `count` times.
        """

    def step(self, stroke: Stroke) -> tuple[float, float]:
        """Return the next sample; see `run`."""
        return self.run(1, stroke)[0]
