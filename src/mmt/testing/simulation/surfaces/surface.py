"""Surfaces whose texture is known exactly: the truth that models are compared with.

The vibration along the surface's normal is the sum of independent parts (`modes`) after one
fixed high-pass, which removes the mean: a contact cannot push the tool away for ever. For a
constant speed, force and heading this is a stationary Gaussian process of known spectrum. Its
spectrum is not that of an autoregressive process of finite order, and nothing in it is
interpolated between samples, so that no texture model contains it.

The vibration along the stroke's heading has the same spectrum, is independent of the
normal one, and has `Surface.tangential_share` of its amplitude; across the heading there
is none.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.modes import Grain, Line, Mode, Resonance, maps_at

HIGH_PASS_POLE: Final = 0.95
"""Pole of the fixed high-pass at 1 kHz, a corner of 8 Hz, below the band of texture."""

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

_KINDS: Final[dict[str, type[Resonance] | type[Line]]] = {"resonance": Resonance, "line": Line}
_POWER_GRID: Final = 4096

_EDGES_HZ: Final = np.geomspace(600.0, 4200.0, 7)
"""One resonance above 500 Hz is drawn between each two of these."""

_HIGHEST: Final = 0.42
"""Highest frequency of a resonance over the rate, so that none reaches half the rate."""

_LARGEST_SHIFT: Final = 0.1


@dataclass(frozen=True)
class Surface:
    """A surface of known texture.

    Parameters
    ----------
    name
        Name in scenes and reports.
    modes
        The independent parts of its vibration.
    tangential_share
        Amplitude of the vibration along the heading over that along the normal.
    friction_coefficient
        Coulomb friction between the tool and the surface.
    rate_hz
        Samples of its vibration a second.
    """

    name: str
    modes: tuple[Mode, ...]
    tangential_share: float = 0.3
    friction_coefficient: float = 0.3
    rate_hz: float = RATE_HZ

    @property
    def high_pass_pole(self) -> float:
        """Pole of the high-pass at the surface's rate."""
        return float(HIGH_PASS_POLE ** (RATE_HZ / self.rate_hz))

    @property
    def isotropic(self) -> bool:
        """Whether the texture is the same in all directions."""
        return all(mode.grain is None for mode in self.modes)

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
        speed, force, cosine, sine = strokes_on(self, speed_mm_s, force_n, heading_rad)
        omega = 2.0 * np.pi / self.rate_hz * np.atleast_1d(np.asarray(frequencies_hz, np.float64))
        cosines, sines = np.cos(omega), np.sin(omega)
        density = np.zeros((speed.size, omega.size))
        for mode in self.modes:
            power, frequency, bandwidth = maps_at(mode, speed, force, cosine, sine)
            radius = np.exp(-np.pi / self.rate_hz * bandwidth)[:, None]
            turn = (2.0 * np.pi / self.rate_hz * frequency)[:, None]
            # The sum of 1 / (unit - 2 radius cos(omega -+ turn)), with few cosines.
            middle = 1.0 + radius * radius - (2.0 * radius * np.cos(turn)) * cosines
            apart = (2.0 * radius * np.sin(turn)) * sines
            scale = 2.0 * power[:, None] * (1.0 - radius * radius)
            density += scale * middle / ((middle - apart) * (middle + apart))
        return density / self.rate_hz * _high_pass(cosines, self.high_pass_pole)

    def power(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact power of the vibration along the normal, shape (k,), (m/s2)^2.

        Parameters and errors are those of `spectrum`.
        """
        return integrated_power(self.spectrum, self.rate_hz, speed_mm_s, force_n, heading_rad)

    def annotations(self) -> bytes:
        """Return the truth as JSON, which `surface_from_parameters` reads."""
        modes = [
            {"kind": kind}
            | {key: value for key, value in asdict(mode).items() if value is not None}
            for mode in self.modes
            for kind, record in _KINDS.items()
            if isinstance(mode, record)
        ]
        parameters = {
            "rate_hz": self.rate_hz,
            "high_pass_pole": self.high_pass_pole,
            "tangential_share": self.tangential_share,
            "friction_coefficient": self.friction_coefficient,
            "modes": modes,
        }
        version = VERSION if self.isotropic else GRAINED_VERSION
        return encode_truth(self.name, version, parameters)


def encode_truth(name: str, version: int, parameters: Mapping[str, Any]) -> bytes:
    """Return the annotations of a known surface."""
    truth = {"surface": name, "version": version, "parameters": parameters}
    return json.dumps(truth, separators=(",", ":")).encode()


def integrated_power(
    spectrum: Callable[..., FloatArray],
    rate_hz: float,
    speed_mm_s: npt.ArrayLike,
    force_n: npt.ArrayLike,
    heading_rad: npt.ArrayLike | None,
) -> FloatArray:
    """Return the integral (k,) of a `Surface.spectrum` at a rate, with its parameters.

    The midpoint rule covers a whole period of the spectrum, so that its error falls
    exponentially with the number of points: below 1e-12 for the narrowest line here.
    """
    points = round(_POWER_GRID * rate_hz / RATE_HZ)
    width = 0.5 * rate_hz / points
    frequencies = (np.arange(points) + 0.5) * width
    blocks = spectra(spectrum, speed_mm_s, force_n, frequencies, heading_rad)
    return np.concatenate([density.sum(axis=1) * width for density in blocks])


def spectra(
    spectrum: Callable[..., FloatArray],
    speed_mm_s: npt.ArrayLike,
    force_n: npt.ArrayLike,
    frequencies_hz: npt.ArrayLike,
    heading_rad: npt.ArrayLike | None,
) -> Iterator[FloatArray]:
    """Yield a `Surface.spectrum` (k, f) for 64 strokes at once, which bounds the memory."""
    towards = np.nan if heading_rad is None else heading_rad
    strokes = np.broadcast_arrays(np.atleast_1d(speed_mm_s), force_n, towards)
    speed, force, heading = (np.ravel(values) for values in strokes)
    for start in range(0, max(speed.size, 1), 64):
        part = slice(start, start + 64)
        yield spectrum(
            speed[part],
            force[part],
            frequencies_hz,
            None if heading_rad is None else heading[part],
        )


def strokes_on(
    surface: "Named",
    speed_mm_s: npt.ArrayLike,
    force_n: npt.ArrayLike,
    heading_rad: npt.ArrayLike | None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return speed, force, cosine and sine of the heading, each of shape (k,).

    Raises
    ------
    InputError
        The texture depends on the heading, and none is given.
    """
    if heading_rad is None and not surface.isotropic:
        raise InputError(f"the texture {surface.name} depends on the stroke's heading: give one")
    heading = np.asarray(0.0 if heading_rad is None else heading_rad, np.float64)
    speed, force, heading = np.broadcast_arrays(
        np.maximum(np.asarray(speed_mm_s, np.float64), 0.0),
        np.maximum(np.asarray(force_n, np.float64), 0.0),
        heading,
    )
    return speed.ravel(), force.ravel(), np.cos(heading).ravel(), np.sin(heading).ravel()


class Named(Protocol):
    """The part of a surface that `strokes_on` needs."""

    @property
    def name(self) -> str:
        """Name of the surface."""

    @property
    def isotropic(self) -> bool:
        """Whether the texture is the same in all directions."""


def with_bands(surface: Surface, rate_hz: float, seed: int) -> Surface:
    """Return a surface at a rate, with resonances above 500 Hz as far as the rate allows.

    The surface keeps its own parts. The new resonances continue from the density below 500 Hz: they
    fall with the frequency to the power of 1.5 +- 0.5, with 3.5 dB of chance. Each follows speed,
    force and heading like one of the surface's parts. A higher rate has all those of a lower one.

    Parameters
    ----------
    surface
        At 1 kHz.
    rate_hz
        Samples of acceleration a second.
    seed
        Seed of the resonances.
    """
    if rate_hz == RATE_HZ:
        return surface
    random = np.random.default_rng([seed, 41])
    reference = surface.spectrum(100.0, 1.0, np.linspace(300.0, 500.0, 41), 0.0).mean()
    slope = random.normal(-1.5, 0.5)
    above: list[Mode] = []
    for low, high in pairwise(_EDGES_HZ):
        frequency = float(low * (high / low) ** random.random())
        bandwidth = float(frequency * 0.03 * 10.0 ** random.random())
        peak = reference * (frequency / 500.0) ** slope * 10.0 ** random.normal(0.0, 0.35)
        speed_shift, force_shift = random.uniform(-_LARGEST_SHIFT, _LARGEST_SHIFT, 2) * frequency
        followed = surface.modes[int(random.integers(len(surface.modes)))]
        resonance = Resonance(
            power=float(0.5 * math.pi * bandwidth * peak),
            speed_exponent=followed.speed_exponent,
            force_exponent=followed.force_exponent,
            frequency_hz=frequency,
            bandwidth_hz=bandwidth,
            speed_shift_hz=float(speed_shift),
            force_shift_hz=float(force_shift),
            grain=followed.grain,
        )
        if frequency < _HIGHEST * rate_hz:
            above.append(resonance)
    return replace(surface, modes=(*surface.modes, *above), rate_hz=rate_hz)


def surface_from_parameters(name: str, parameters: Mapping[str, Any]) -> Surface:
    """Rebuild a surface from the parameters in its annotations.

    Raises
    ------
    ValueError, KeyError, TypeError
        The parameters do not describe a surface.
    """
    return Surface(
        name=name,
        modes=tuple(_mode(part) for part in parameters["modes"]),
        tangential_share=float(parameters["tangential_share"]),
        friction_coefficient=float(parameters["friction_coefficient"]),
        rate_hz=float(parameters["rate_hz"]),
    )


def _mode(part: Mapping[str, object]) -> Mode:
    grain = part.get("grain")
    return _KINDS[str(part["kind"])](
        **_numbers(part), grain=Grain(**_numbers(grain)) if isinstance(grain, Mapping) else None
    )


def _numbers(part: Mapping[str, object]) -> dict[str, float]:
    return {
        key: value
        for key, value in part.items()
        if isinstance(value, (int, float)) and math.isfinite(value)
    }


def _high_pass(cosine: FloatArray, pole: float) -> FloatArray:
    gain = 0.25 * (1.0 + pole) ** 2
    return gain * (2.0 - 2.0 * cosine) / (1.0 + pole * pole - 2.0 * pole * cosine)
