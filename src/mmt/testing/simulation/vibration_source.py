"""What the generators of a known surface's vibration have in common."""

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
        """Return the next samples, through which the stroke stays as it is.

        Parameters
        ----------
        count
            How many.
        speed_mm_s, force_n
            Speed and force of the stroke.
        heading
            The unit vector of its velocity in the plane.
        position_mm
            The tip in the plane.

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
