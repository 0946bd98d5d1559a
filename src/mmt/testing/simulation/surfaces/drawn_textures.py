"""Textures drawn at random from a broad family; none was chosen by a person.

Levels follow fifty models of the Penn Haptic Texture Toolkit (every second one by name), with their
range stretched to 300 mm/s and 3 N; spectra and exponents spread further. 5th, 50th and 95th
percentile of those models, and of 120 drawn textures:

==============================================  ===================  ===================
level at 100 mm/s and 1 N (dB re 1 (m/s2)^2)    -12.6   -4.8    8.5  -11.6    0.0   10.9
exponent of the power over speed                  0.8    1.9    2.9    0.4    1.9    3.2
exponent of the power over force                 -0.1    0.1    0.6   -0.2    0.2    0.8
rms of the level about that power law (dB)        1.1    2.1    4.4    1.0    2.3    4.2
slope of the spectrum, 10 to 500 Hz (dB/octave)   -10   -6.8   -3.2   -8.8   -6.0   -2.4
rms of the spectrum about that slope (dB)         5.4    7.2    8.2    2.7    4.0    6.0
centroid of the spectrum (Hz)                      66    112    186     44     82    182
==============================================  ===================  ===================

The models scatter about the power law: the difference between two of their points hardly grows with
the distance, from 2.5 dB (rms over the root of 2) at a quarter of an e-fold to 2.9 dB from one
e-fold on. Lines, grains, thresholds, patches and bursts are drawn in addition; those models have
none of them.

Seeds below `FINAL` are for development. The performance of a method on unseen textures is measured
once, on final ones; nothing is ever tuned on them.
"""

from dataclasses import replace
from functools import lru_cache
from math import pi
from typing import Final

import numpy as np

from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.alterations import Bursts, Level, Patches, Quantity
from mmt.testing.simulation.surfaces.altered_surface import AlteredSurface
from mmt.testing.simulation.surfaces.modes import Grain, Mode, Resonance, ridges
from mmt.testing.simulation.surfaces.surface import Surface, with_bands

FINAL: Final = 1_000_000
"""Seed of the first final texture."""

_WAVES: Final = 12
_UNEVEN: Final = 0.25  # share of the textures with patches, and of those with bursts


@lru_cache(maxsize=128)
def draw_texture(name: str, seed: int, rate_hz: float = RATE_HZ) -> AlteredSurface:
    """Return the texture of a seed at a rate.

    Parameters
    ----------
    name
        Name of the texture.
    seed
        Below `FINAL` for development.
    rate_hz
        See `Surface`; above 1 kHz the texture has further parts.
    """
    random = np.random.default_rng([seed, 40])
    grains = _grains(random)
    speed, force = random.normal(1.8, 0.65), random.normal(0.1, 0.22)
    modes = _resonances(random, grains, speed, force)
    if random.random() < 0.35:
        modes += _lines(random, grains, speed, force, sum(mode.power for mode in modes))
    base = Surface(name, modes, random.uniform(0.1, 0.6), random.uniform(0.15, 0.9))
    unevenness = random.random()
    texture = AlteredSurface(
        name,
        base,
        low_pass_hz=_log_uniform(random, 30.0, 300.0),
        level=_level(random),
        patches=Patches(random.uniform(2.0, 4.0), seed) if unevenness < _UNEVEN else None,
        bursts=Bursts(random.uniform(4.0, 8.0)) if unevenness > 1.0 - _UNEVEN else None,
    )
    # powers add up: one factor for all parts sets the power of a stroke along x
    wanted = 10.0 ** (random.uniform(-13.0, 9.0) / 10.0)
    factor = wanted / float(texture.power(100.0, 1.0, 0.0)[0])
    scaled = tuple(replace(mode, power=mode.power * factor) for mode in modes)
    return replace(texture, base=with_bands(replace(base, modes=scaled), rate_hz, seed))


def _grains(random: np.random.Generator) -> list[Grain | None]:
    """Return the grains from which each part draws its own: none, or up to three directions."""
    if random.random() < 0.6:
        return [None]
    count = int(random.integers(1, 4))
    naps = random.uniform(-0.6, 0.6, count) * (random.random(count) < 0.4)
    grains: list[Grain | None] = [
        Grain(random.uniform(0.0, 180.0), random.uniform(0.1, 0.7), float(nap)) for nap in naps
    ]
    return grains + [None] * int(random.integers(0, 2))


def _resonances(
    random: np.random.Generator, grains: list[Grain | None], speed: float, force: float
) -> tuple[Mode, ...]:
    """Return three to six resonances from narrow to broad, about a common slope."""
    tilt = random.normal(-1.0, 1.2)
    modes = []
    for _ in range(int(random.integers(3, 7))):
        frequency = _log_uniform(random, 30.0, 440.0)
        modes.append(
            Resonance(
                power=(frequency / 100.0) ** tilt * 10.0 ** random.normal(0.0, 0.7),
                speed_exponent=max(speed + random.normal(0.0, 0.7), 0.3),
                force_exponent=max(force + random.normal(0.0, 0.3), 0.02),
                frequency_hz=frequency,
                bandwidth_hz=_log_uniform(random, 6.0, 100.0),
                speed_shift_hz=random.normal(0.0, 0.4) * frequency,
                force_shift_hz=random.normal(0.0, 0.3) * frequency,
                force_damping=random.uniform(0.0, 0.8),
                grain=_chosen(random, grains),
            )
        )
    return tuple(modes)


def _lines(
    random: np.random.Generator,
    grains: list[Grain | None],
    speed: float,
    force: float,
    power: float,
) -> tuple[Mode, ...]:
    """Return one to four harmonics of ridges, with 0.2 to 3 times the given power."""
    falling = random.uniform(0.2, 0.7) ** np.arange(int(random.integers(1, 5)))
    powers = falling / falling.sum() * power * _log_uniform(random, 0.2, 3.0)
    return ridges(
        _log_uniform(random, 0.6, 4.0),
        tuple(powers.tolist()),
        random.uniform(0.03, 0.2),
        _chosen(random, grains),
        speed=max(speed, 0.3),
        force=max(force, 0.02),
    )


def _level(random: np.random.Generator) -> Level:
    """Return a level that varies by 1 to 4.4 dB rms, with a threshold in every third texture."""
    depth = random.uniform(0.5, 1.5, _WAVES)
    depth *= _log_uniform(random, 1.0, 4.4) / np.sqrt(0.5 * np.sum(depth**2))
    length = np.exp(random.uniform(np.log(0.3), np.log(3.0), _WAVES))  # in e-folds
    towards, phase = random.uniform(0.0, 2.0 * pi, (2, _WAVES))
    p, q = 2.0 * pi / length * (np.cos(towards), np.sin(towards))
    thresholds: tuple[tuple[Quantity, float, float], ...] = ()
    if random.random() < 1.0 / 3.0:
        at = random.uniform(50.0, 200.0), random.uniform(0.4, 2.0)
        step_db = random.uniform(3.0, 9.0) * (1.0 if random.random() < 0.7 else -1.0)
        of_speed = random.random() < 0.5
        thresholds = (("speed", at[0], step_db) if of_speed else ("force", at[1], step_db),)
    return Level(tuple(map(tuple, np.column_stack([depth, p, q, phase]).tolist())), thresholds)


def _chosen(random: np.random.Generator, grains: list[Grain | None]) -> Grain | None:
    return grains[int(random.integers(len(grains)))]


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** random.random())
