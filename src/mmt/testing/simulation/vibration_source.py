"""Base class of the generators of a known surface's vibration."""

from abc import ABC, abstractmethod


class VibrationSource(ABC):
    """Makes the vibration of a surface at the surface's rate."""

    @abstractmethod
    def run(
        self,
        count: int,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),
    ) -> list[tuple[float, float]]:
        """Return the next samples of a stroke that stays the same meanwhile.

        Parameters
        ----------
        count
            Number of samples.
        speed_mm_s, force_n
            Speed and force of the stroke.
        heading
            The unit vector of its velocity in the plane.
        position_mm
            Position of the tip in the plane.

        Returns
        -------
        samples
            The acceleration (m/s2) along the normal and along the heading, `count` times.
        """

    def step(
        self,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[float, float]:
        """Return the next sample; see `run`."""
        return self.run(1, speed_mm_s, force_n, heading, position_mm)[0]
