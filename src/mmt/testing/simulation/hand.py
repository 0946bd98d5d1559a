"""A hand that holds the leader's interface and strokes a surface."""

from collections.abc import Iterator
from itertools import chain
from math import cos, exp, pi, sin, sqrt
from typing import Final

import numpy as np

from mmt.core.arrays import Vector
from mmt.devices.leader_reports import InterfaceState
from mmt.scene import Hand, Simulated
from mmt.testing.simulation import PERIOD_S, RATE_HZ, START_MM, NoiseRows, nominal_compliance_mm_n
from mmt.testing.simulation.strokes import Intent, Phase, Place, in_phases, strokes

LEAST_FORCE_N: Final = 0.01
"""Below this the hand does not press."""

_APPROACH: Final = (Phase(1, 300, 0.0, 0.0, START_MM[2]), Phase(300, 20, 0.0, 0.0))
_DRIFT_SHARE: Final = 0.02
_DRIFT_TIME_S: Final = 0.3
_TREMOR_SHARE: Final = 0.012
_TREMOR_HZ: Final = 9.0
_TREMOR_BANDWIDTH_HZ: Final = 3.0
_LEARNING_S: Final = 0.5
_SCALE_RANGE: Final = (0.2, 5.0)


class Unsteadiness:
    """Deviation of a hand from its intention: slow drift and physiological tremor.

    A unit-free share of the intended value: drift of 2 % rms with a time constant of 0.3 s, and
    tremor of 1.2 % rms around 9 Hz (physiological tremor of the hand, 8 to 12 Hz).
    """

    def __init__(self) -> None:
        self._keep = exp(-PERIOD_S / _DRIFT_TIME_S)
        self._kick = _DRIFT_SHARE * sqrt(1.0 - self._keep**2)
        radius = exp(-pi * _TREMOR_BANDWIDTH_HZ / RATE_HZ)
        self._cosine = radius * cos(2.0 * pi * _TREMOR_HZ / RATE_HZ)
        self._sine = radius * sin(2.0 * pi * _TREMOR_HZ / RATE_HZ)
        self._shake = _TREMOR_SHARE * sqrt(1.0 - radius * radius)
        self._drift = self._tremor = self._partner = 0.0

    def step(self, noise: list[float]) -> float:
        """Return the factor for the next tick, around 1; takes three numbers of noise."""
        self._drift = self._keep * self._drift + self._kick * noise[0]
        c, s, x, y = self._cosine, self._sine, self._tremor, self._partner
        self._tremor = c * x - s * y + self._shake * noise[1]
        self._partner = s * x + c * y + self._shake * noise[2]
        return 1.0 + self._drift + self._tremor


class SimulatedHand:
    """A seeded operator who explores the surface; implements `LeaderInterface`.

    The hand intends a speed and a normal force (`mmt.testing.simulation.motions`). To press, it
    commands a depth below the surface, computed from the compliance that it expects between handle
    and surface. If force is fed back (`write`), it corrects this expectation over half a second,
    like a person who feels too much or too little; without a force nothing is corrected.

    The motion depends only on the seed and the feedback, not on how ticks are grouped.
    Cost: about 3 us a tick.

    Parameters
    ----------
    settings
        The kind of hand, and its range of speeds and forces.
    seed
        The scene's seed.
    compliance_mm_n
        Expected depth of the command for each newton; by default that of the default
        `[simulated]` follower, see `nominal_compliance_mm_n`.

    Raises
    ------
    InputError
        The file of a recorded stroke is not usable.
    """

    def __init__(self, settings: Hand, seed: int, *, compliance_mm_n: float | None = None) -> None:
        plan, noise = np.random.SeedSequence([seed, 1]).spawn(2)
        self._noise = NoiseRows(np.random.default_rng(noise), 6)
        self._compliance = (
            nominal_compliance_mm_n(Simulated()) if compliance_mm_n is None else compliance_mm_n
        )
        self._scale = 1.0
        self._felt_n = 0.0
        self._speed_factor = Unsteadiness()
        self._force_factor = Unsteadiness()
        self._x, self._y, self._z = START_MM
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._force = 0.0
        self._heading = 0.0
        self._intents = chain(
            in_phases(_APPROACH, START_MM[2]),
            _motion(settings, np.random.default_rng(plan), lambda: (self._x, self._y)),
        )

    def connect(self) -> None:
        """Do nothing: there is no device."""

    def calibrate(self) -> None:
        """Do nothing: the hand knows where it is."""

    def close(self) -> None:
        """Do nothing: there is no device."""

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Let the ticks pass and return the handle's state after them."""
        for _ in range(elapsed_ticks):
            self._advance()
        return InterfaceState(
            (self._x, self._y, self._z),
            self._velocity,
            self._force,
            self._force > LEAST_FORCE_N,
        )

    def write(self, force_n: Vector) -> None:
        """Feel a force (N) at the handle; its z is the surface's normal force."""
        self._felt_n = force_n[2]

    def _advance(self) -> None:
        noise = self._noise.next()
        speed, force, clearance, heading, turn_rad_mm = next(self._intents)
        if heading is not None:
            self._heading = heading
        speed *= self._speed_factor.step(noise[:3])
        force *= max(self._force_factor.step(noise[3:]), 0.0)
        if self._felt_n and force > LEAST_FORCE_N:  # without a force there is nothing to judge
            self._correct(force, self._felt_n)
        self._heading += turn_rad_mm * speed * PERIOD_S
        u, v = speed * cos(self._heading), speed * sin(self._heading)
        z = clearance - self._compliance * self._scale * force
        self._velocity = (u, v, (z - self._z) * RATE_HZ)
        self._x += u * PERIOD_S
        self._y += v * PERIOD_S
        self._z = z
        self._force = force

    def _correct(self, intended_n: float, felt_n: float) -> None:
        error = (intended_n - felt_n) / max(intended_n, 0.3)
        low, high = _SCALE_RANGE
        scale = self._scale * (1.0 + PERIOD_S / _LEARNING_S * max(-1.0, min(error, 1.0)))
        self._scale = max(low, min(scale, high))


def _motion(settings: Hand, generator: np.random.Generator, place: Place) -> Iterator[Intent]:
    if settings.kind == "strokes":
        return strokes(settings, generator, place)
    from mmt.testing.simulation.motions import motion

    return motion(settings, generator, place)
