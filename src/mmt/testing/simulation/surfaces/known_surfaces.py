"""What every surface with an exactly known texture has: its truth, and its vibration."""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.testing.simulation import RATE_HZ

VERSION: Final = 1
"""Version of the annotations of a texture that is the same in all directions."""

GRAINED_VERSION: Final = 2
"""Version of the annotations of a texture with a grain, which an earlier reader would ignore."""

COURSE_VERSION: Final = 3
"""Version of the annotations of several surfaces, see `mmt.testing.simulation.surfaces.course`."""

MODEL_VERSION: Final = 4
"""Version of the annotations of a model, see `mmt.testing.simulation.surfaces.model_surface`."""

ALTERED_VERSION: Final = 5
"""Version of the annotations of an altered surface."""

_POWER_GRID: Final = 4096


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


class KnownSurface(ABC):
    """A surface of known texture.

    Attributes
    ----------
    name
        Name in scenes and reports.
    tangential_share
        Amplitude of the vibration along the heading over that along the normal.
    friction_coefficient
        Coulomb friction between the tool and the surface.
    rate_hz
        Samples of its vibration a second.
    """

    name: str
    tangential_share: float
    friction_coefficient: float
    rate_hz: float

    @property
    @abstractmethod
    def isotropic(self) -> bool:
        """Whether the texture is the same in all directions."""

    @abstractmethod
    def spectrum(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact spectrum of the vibration along the normal.

        Parameters
        ----------
        speed_mm_s, force_n
            Shape (k,) or scalars, broadcast against each other; negative values count
            as 0, which gives no vibration.
        frequencies_hz
            Shape (f,), 0 to half the rate.
        heading_rad
            Heading of the stroke, from x to y; broadcast with speed and force. Needed if the
            texture is not isotropic.

        Returns
        -------
        density
            One-sided power spectral density, shape (k, f), (m/s2)^2/Hz.

        Raises
        ------
        InputError
            The texture depends on the heading, and none is given.
        """

    def power(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact power of the vibration along the normal, shape (k,), (m/s2)^2.

        Parameters and errors are those of `spectrum`, of which it is the integral. The midpoint
        rule covers a whole period of the spectrum, so that its error falls exponentially with the
        number of points: below 1e-12 for the narrowest line here.
        """
        points = round(_POWER_GRID * self.rate_hz / RATE_HZ)
        width = 0.5 * self.rate_hz / points
        frequencies = width * np.arange(0.5, points)
        blocks = self._steady_blocks(speed_mm_s, force_n, frequencies, heading_rad)
        return np.concatenate([density.sum(axis=1) * width for density in blocks])

    @abstractmethod
    def annotations(self) -> bytes:
        """Return the truth as JSON, from which `surface_from_annotations` rebuilds the surface."""

    @abstractmethod
    def vibration(self, generator: np.random.Generator) -> VibrationSource:
        """Return a generator of its vibration; nothing else draws from the random numbers."""

    def _steady(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: FloatArray,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the spectrum (k, f), or another of the same power that is quicker to compute."""
        return self.spectrum(speed_mm_s, force_n, frequencies_hz, heading_rad)

    def _steady_blocks(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: FloatArray,
        heading_rad: npt.ArrayLike | None,
    ) -> Iterator[FloatArray]:
        """Yield `_steady` (k, f) for 64 strokes at once, which bounds the memory."""
        towards = np.nan if heading_rad is None else heading_rad
        strokes = np.broadcast_arrays(np.atleast_1d(speed_mm_s), force_n, towards)
        speed, force, heading = (np.ravel(values) for values in strokes)
        for start in range(0, max(speed.size, 1), 64):
            part = slice(start, start + 64)
            yield self._steady(
                speed[part],
                force[part],
                frequencies_hz,
                None if heading_rad is None else heading[part],
            )

    def _strokes(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return speed, force, cosine and sine of the heading, each of shape (k,)."""
        if heading_rad is None and not self.isotropic:
            raise InputError(f"the texture {self.name} depends on the stroke's heading: give one")
        heading = np.asarray(0.0 if heading_rad is None else heading_rad, np.float64)
        speed, force, heading = np.broadcast_arrays(
            np.maximum(np.asarray(speed_mm_s, np.float64), 0.0),
            np.maximum(np.asarray(force_n, np.float64), 0.0),
            heading,
        )
        return speed.ravel(), force.ravel(), np.cos(heading).ravel(), np.sin(heading).ravel()


def encode_truth(name: str, version: int, parameters: Mapping[str, Any]) -> bytes:
    """Return the annotations of a known surface."""
    truth = {"surface": name, "version": version, "parameters": parameters}
    return json.dumps(truth, separators=(",", ":")).encode()
