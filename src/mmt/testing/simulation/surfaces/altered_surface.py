"""A known surface made rough over speed and force, uneven over position, or bursty.

The truth stays exact: a gain that depends on speed and force multiplies the spectrum. Patches and
bursts leave the mean power as it is, and bursts widen the spectrum by that of their gain.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import exp, floor, pi, sqrt
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.testing.simulation import RATE_HZ, NoiseRows
from mmt.testing.simulation.surfaces.alterations import LAGS, Bursts, Level, Patches, burst_decay
from mmt.testing.simulation.surfaces.known_surfaces import (
    ALTERED_VERSION,
    KnownSurface,
    Stroke,
    VibrationSource,
    encode_truth,
)


@dataclass(frozen=True)
class AlteredSurface(KnownSurface):
    """A known surface and the alterations of its vibration.

    Parameters
    ----------
    name
        Name in reports.
    base
        The surface that is altered.
    low_pass_hz
        Corner of a low-pass of first order.
    level, patches, bursts
        Gains on the low-passed vibration.
    """

    name: str
    base: KnownSurface
    low_pass_hz: float | None = None
    level: Level | None = None
    patches: Patches | None = None
    bursts: Bursts | None = None

    def __post_init__(self) -> None:
        for name in ("tangential_share", "friction_coefficient", "rate_hz"):
            object.__setattr__(self, name, getattr(self.base, name))

    @property
    def isotropic(self) -> bool:
        """Whether the texture is the same in all directions."""
        return self.base.isotropic

    @property
    def pole(self) -> float:
        """Pole of the low-pass; 0 lets everything pass."""
        return 0.0 if self.low_pass_hz is None else exp(-2.0 * pi * self.low_pass_hz / self.rate_hz)

    def spectrum(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact spectrum along the normal, (k, f); see `KnownSurface.spectrum`.

        With patches it is the mean over the reach of a hand.
        """
        frequencies = np.atleast_1d(np.asarray(frequencies_hz, np.float64))
        if self.bursts is None:
            return self._steady(speed_mm_s, force_n, frequencies, heading_rad)
        grid = np.linspace(0.0, 0.5 * self.rate_hz, round(LAGS * self.rate_hz / RATE_HZ) + 1)
        blocks = self._steady_blocks(speed_mm_s, force_n, grid, heading_rad)
        return np.concatenate(
            [self.bursts.widened(steady, frequencies, self.rate_hz) for steady in blocks]
        )

    def _steady(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: FloatArray,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the spectrum (k, f) without bursts."""
        density = self.base.spectrum(speed_mm_s, force_n, frequencies_hz, heading_rad)
        cosine, pole = np.cos(2.0 * pi / self.rate_hz * frequencies_hz), self.pole
        density *= (1.0 - pole) ** 2 / (1.0 + pole * pole - 2.0 * pole * cosine)
        if self.level is not None:
            speed, force, _, _ = self._strokes(speed_mm_s, force_n, heading_rad)
            density *= 10.0 ** (self.level.level_db(speed, force) / 10.0)[:, None]
        return density

    def annotations(self) -> bytes:
        """Return the truth as JSON, from which `from_altered_parameters` rebuilds it."""
        done = {key: getattr(self, key) for key in _PARTS}
        parameters = {
            "base": json.loads(self.base.annotations()),
            "low_pass_hz": self.low_pass_hz,
            **{key: asdict(part) for key, part in done.items() if part is not None},
        }
        return encode_truth(self.name, ALTERED_VERSION, parameters)

    def vibration(self, generator: np.random.Generator) -> "AlteredVibration":
        """Return a generator of its vibration."""
        return AlteredVibration(self, generator)


_PARTS: Final = {"level": Level, "patches": Patches, "bursts": Bursts}


def from_altered_parameters(
    name: str, base: KnownSurface, parameters: Mapping[str, Any]
) -> AlteredSurface:
    """Rebuild the surface on its base from the parameters of `AlteredSurface.annotations`.

    Raises
    ------
    InputError
        The base is an altered surface itself.
    ValueError, KeyError, TypeError
        The parameters do not describe an altered surface.
    """
    if isinstance(base, AlteredSurface):
        raise InputError("annotations hold an altered surface of an altered one")
    parts = {key: kind(**parameters[key]) for key, kind in _PARTS.items() if key in parameters}
    return AlteredSurface(name, base, parameters["low_pass_hz"], **parts)


def alter_surface(surface: KnownSurface, alteration: str, seed: int) -> AlteredSurface:
    """Return a surface with ``patches`` or ``bursts``, in place of those that it has.

    Parameters
    ----------
    surface
        The surface to alter.
    alteration
        ``patches`` or ``bursts``; ``patches-4`` has a standard deviation of 4 dB (3 by default),
        ``bursts-8`` a kurtosis of 8 (6 by default).
    seed
        Seed of the places of the patches.

    Raises
    ------
    InputError
        There is no such alteration, or its number is out of range.
    """
    kind, _, number = alteration.partition("-")
    name = f"{surface.name}+{alteration}"
    if not isinstance(surface, AlteredSurface):
        surface = AlteredSurface(name, surface)
    try:
        if kind == "patches" and 0.0 < (deviation := float(number or 3.0)) <= 20.0:
            return replace(surface, name=name, patches=Patches(deviation, seed))
        if kind == "bursts" and 3.0 < (kurtosis := float(number or 6.0)) <= 30.0:
            return replace(surface, name=name, bursts=Bursts(kurtosis))
    except ValueError:
        pass
    raise InputError(
        f"surface {name}: +{alteration} is not known, allowed are +patches and +patches-DB (dB, "
        "above 0 to 20), +bursts and +bursts-KURTOSIS (above 3 to 30)"
    )


class AlteredVibration(VibrationSource):
    """A generator of the vibration of an altered surface.

    Cost: that of the unaltered surface, plus some 5 us a call of `run` for a level, and 1 us for
    patches or for each sample of bursts.
    """

    def __init__(self, surface: AlteredSurface, generator: np.random.Generator) -> None:
        source, chance = generator.spawn(2)
        self._base = surface.base.vibration(source)
        self._pole = surface.pole
        self._passed = (0.0, 0.0)
        self._level = surface.level
        self._gains = None if surface.patches is None else surface.patches.gains()
        self._spread = 0.0 if surface.bursts is None else surface.bursts.spread
        self._keep = exp(-burst_decay(surface.rate_hz))
        self._noise = NoiseRows(chance, 1)
        self._burst = self._noise.next()[0]

    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        gain = 1.0
        if self._level is not None:
            gain = 10.0 ** (float(self._level.level_db(stroke.speed_mm_s, stroke.force_n)) / 20.0)
        if self._gains is not None:
            x_mm, y_mm = stroke.position_mm
            row = self._gains[floor(y_mm) % len(self._gains)]
            gain *= row[floor(x_mm) % len(row)]
        made = self._base.run(count, stroke)
        return [self._altered(normal, along, gain) for normal, along in made]

    def _altered(self, normal: float, along: float, gain: float) -> tuple[float, float]:
        """Return a sample after the low-pass, times this gain and that of the bursts."""
        pole, (normal_before, along_before) = self._pole, self._passed
        normal = (1.0 - pole) * normal + pole * normal_before
        along = (1.0 - pole) * along + pole * along_before
        self._passed = (normal, along)
        if self._spread:
            kick = sqrt(1.0 - self._keep**2) * self._noise.next()[0]
            self._burst = self._keep * self._burst + kick
            gain *= exp(self._spread * (self._burst - self._spread))
        return gain * normal, gain * along
