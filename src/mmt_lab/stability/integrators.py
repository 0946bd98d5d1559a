"""Integrators of a tool against a stiff wall, side by side: two that break, and one that does not.

All advance the same system, a mass on a drive that meets a unilateral Kelvin-Voigt wall
(`Drive` and `ContactLaw`), and are called like `mmt.contact.steps.step_normal`, the integrator of
the simulated follower. The others serve for comparison.

==================  =====  ==========================================================
integrator          order  sustained contact is stable below
==================  =====  ==========================================================
explicit Euler      1      ``c/k``, but ``2/(s + sqrt(s^2 - w^2))`` if overdamped
semi-implicit       1      ``2 (sqrt(w^2 + s^2) - s)/w^2``
discrete gradient   2      every step
==================  =====  ==========================================================

with w^2 = k/m and s = c/2m of the wall and the drive together. The first two also gain energy
in single impacts below their limits, since they see the surface only after it is crossed.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from mmt.contact.steps import ContactLaw, Drive, step_normal

State = tuple[float, float]
"""Height (m) and velocity (m/s)."""

Step = Callable[[Drive, ContactLaw, State, float, float], tuple[float, float, float]]
"""From drive, law, state, command (m) and step (s) to height, velocity and mean force (N)."""


@dataclass(frozen=True)
class Integrator:
    """An integrator, and its stability according to theory.

    ``safe``: total energy never grows while the command stands still, for any step. ``limit_s``
    returns the step (s) beyond which sustained contact is unstable, or infinity if every step is
    stable.
    """

    name: str
    step: Step
    safe: bool
    limit_s: Callable[[Drive, ContactLaw], float]


def total_energy_j(drive: Drive, law: ContactLaw, state: State) -> float:
    """Return the kinetic energy plus that stored in the wall and in the spring of a drive to 0."""
    height_m, velocity_m_s = state
    stored = drive.stiffness_n_m * height_m**2 + law.stiffness_n_m * min(height_m, 0.0) ** 2
    return 0.5 * (drive.mass_kg * velocity_m_s**2 + stored)


def step_explicit(
    drive: Drive, law: ContactLaw, state: State, command_m: float, step_s: float
) -> tuple[float, float, float]:
    """Advance by explicit Euler; arguments and results as `step_normal`."""
    height_m, velocity_m_s = state
    force_n, acceleration = _accelerate(drive, law, state, command_m)
    return height_m + step_s * velocity_m_s, velocity_m_s + step_s * acceleration, force_n


def step_semi_implicit(
    drive: Drive, law: ContactLaw, state: State, command_m: float, step_s: float
) -> tuple[float, float, float]:
    """Advance by semi-implicit (symplectic) Euler: the new velocity moves the mass."""
    height_m, velocity_m_s = state
    force_n, acceleration = _accelerate(drive, law, state, command_m)
    velocity_m_s += step_s * acceleration
    return height_m + step_s * velocity_m_s, velocity_m_s, force_n


def explicit_limit_s(drive: Drive, law: ContactLaw) -> float:
    """Return the largest step at which explicit Euler rests stably in contact.

    Both factors ``1 + h lambda`` must be within the unit circle, lambda being the eigenvalues of
    the contact (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2).
    """
    square, decay = _poles(drive, law)
    if decay * decay < square:
        return 2.0 * decay / square
    return 2.0 / (decay + math.sqrt(decay * decay - square))


def semi_implicit_limit_s(drive: Drive, law: ContactLaw) -> float:
    """Return the largest step at which semi-implicit Euler rests stably in contact.

    The limit follows from the Jury conditions of ``z^2 - (2 - 2 s h - w^2 h^2) z + 1 - 2 s h``.
    """
    square, decay = _poles(drive, law)
    return 2.0 / (math.sqrt(square + decay * decay) + decay)


INTEGRATORS: Final[Mapping[str, Integrator]] = {
    integrator.name: integrator
    for integrator in (
        Integrator("explicit Euler", step_explicit, safe=False, limit_s=explicit_limit_s),
        Integrator(
            "semi-implicit Euler", step_semi_implicit, safe=False, limit_s=semi_implicit_limit_s
        ),
        Integrator("discrete gradient", step_normal, safe=True, limit_s=lambda *_: math.inf),
    )
}


def _poles(drive: Drive, law: ContactLaw) -> tuple[float, float]:
    """Return w^2 and s of the sustained contact."""
    stiffness = drive.stiffness_n_m + law.stiffness_n_m
    damping = drive.damping_n_s_m + law.damping_n_s_m
    return stiffness / drive.mass_kg, 0.5 * damping / drive.mass_kg


def _accelerate(
    drive: Drive, law: ContactLaw, state: State, command_m: float
) -> tuple[float, float]:
    """Return the contact force and the acceleration at a state."""
    height_m, velocity_m_s = state
    force_n = 0.0
    if height_m < 0.0:
        depth = -height_m
        damping = law.damping_n_s_m + law.dissipation_s_m * law.stiffness_n_m * depth
        force_n = max(0.0, law.stiffness_n_m * depth - damping * velocity_m_s)
    push = drive.stiffness_n_m * (command_m - height_m) - drive.damping_n_s_m * velocity_m_s
    return force_n, (force_n + push) / drive.mass_kg
