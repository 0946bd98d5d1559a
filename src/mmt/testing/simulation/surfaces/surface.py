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

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from math import cos, exp, pi, sin, sqrt
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.testing.simulation import RATE_HZ, NoiseRows
from mmt.testing.simulation.surfaces.known_surfaces import (
    GRAINED_VERSION,
    VERSION,
    KnownSurface,
    Stroke,
    VibrationSource,
    encode_truth,
)
from mmt.testing.simulation.surfaces.modes import Grain, Line, Mode, Resonance, maps_at

HIGH_PASS_POLE: Final = 0.95
"""Pole of the fixed high-pass at 1 kHz, a corner of 8 Hz, below the band of texture."""

_KINDS: Final[dict[str, type[Resonance] | type[Line]]] = {"resonance": Resonance, "line": Line}
_EDGES_HZ: Final = np.geomspace(600.0, 4200.0, 7)
"""One resonance above 500 Hz is drawn between each two of these."""

_HIGHEST: Final = 0.42
"""Highest frequency of a resonance over the rate, so that none reaches half the rate."""

_LARGEST_SHIFT: Final = 0.1


@dataclass(frozen=True)
class Surface(KnownSurface):
    """A surface whose texture is a sum of parts.

    Parameters
    ----------
    name, tangential_share, friction_coefficient, rate_hz
        See `KnownSurface`.
    modes
        The independent parts of its vibration.
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
        """Return the exact spectrum along the normal, (k, f); see `KnownSurface.spectrum`."""
        speed, force, cosine, sine = self._strokes(speed_mm_s, force_n, heading_rad)
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

    def vibration(self, generator: np.random.Generator) -> "SurfaceVibration":
        """Return a generator of its vibration."""
        return SurfaceVibration(self, generator)


class SurfaceVibration(VibrationSource):
    """A causal generator whose stationary spectrum is exactly `Surface.spectrum`.

    Each mode is a pair of numbers. At every sample the pair rotates, shrinks by a factor below 1
    and is fed two white noises; one number of the pair is the output. Frequency, bandwidth and
    gain follow speed, force and heading. However they change, the generator is stable: apart from
    the noise added, a state only shrinks, which a filter in direct form does not guarantee. Cost:
    about 0.6 us a mode and call of `run`, 0.4 us a mode and sample.

    Parameters
    ----------
    surface
        The texture.
    generator
        Source of every random number; nothing else draws from it.
    """

    def __init__(self, surface: Surface, generator: np.random.Generator) -> None:
        self._share = surface.tangential_share
        self._width, self._angle = pi / surface.rate_hz, 2.0 * pi / surface.rate_hz
        self._pole = surface.high_pass_pole
        # a part without a grain ignores the heading: one call less, four times a tick
        self._modes = [(mode, mode.maps if mode.grain is None else None) for mode in surface.modes]
        self._states = [(0.0, 0.0, 0.0, 0.0) for _ in surface.modes]
        self._noise = NoiseRows(generator, 4 * len(surface.modes))
        self._sums = (0.0, 0.0)
        self._passed = (0.0, 0.0)

    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        speed_mm_s, force_n, (cosine, sine), _ = stroke
        turns: list[tuple[float, float, float]] = []
        for mode, maps in self._modes:
            power, frequency, bandwidth = (
                maps(speed_mm_s, force_n)
                if maps is not None
                else maps_at(mode, speed_mm_s, force_n, cosine, sine)
            )
            radius = exp(-self._width * bandwidth)
            c = radius * cos(self._angle * frequency)
            s = radius * sin(self._angle * frequency)
            turns.append((c, s, sqrt(power * (1.0 - radius * radius))))
        return [self._advance(turns) for _ in range(count)]

    def _advance(self, turns: list[tuple[float, float, float]]) -> tuple[float, float]:
        """Rotate each mode's pairs by cosine and sine, and feed them noise times the gain."""
        noise = self._noise.next()
        normal = along = 0.0
        for index, (c, s, gain) in enumerate(turns):
            x, y, u, v = self._states[index]
            place = 4 * index
            output = c * x - s * y + gain * noise[place]
            other = c * u - s * v + gain * noise[place + 2]
            self._states[index] = (
                output,
                s * x + c * y + gain * noise[place + 1],
                other,
                s * u + c * v + gain * noise[place + 3],
            )
            normal += output
            along += other
        return self._high_pass(normal, along)

    def _high_pass(self, normal: float, along: float) -> tuple[float, float]:
        pole = self._pole
        scale = 0.5 * (1.0 + pole)
        before_normal, before_along = self._sums
        passed_normal = pole * self._passed[0] + scale * (normal - before_normal)
        passed_along = pole * self._passed[1] + scale * (along - before_along)
        self._sums = (normal, along)
        self._passed = (passed_normal, passed_along)
        return passed_normal, self._share * passed_along


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
