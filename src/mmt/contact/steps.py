"""Contact with a surface, along its normal and in its plane: force laws and stable steps.

The law along the normal is linear-elastic with Kelvin-Voigt and Hunt-Crossley damping (Hunt and
Crossley, "Coefficient of restitution interpreted as damping in vibroimpact", J. Appl. Mech. 42,
1975). The step is the implicit midpoint rule with the discrete gradient of the elastic
energy (Gonzalez, "Time integration and discrete Hamiltonian systems", J. Nonlinear Sci. 6,
1996). In one dimension it needs no iteration: the equation is linear inside and outside
the contact and quadratic where the surface is crossed.

Stability along the normal: unconditional. Without damping the total energy is kept to rounding,
also through impacts; with damping it never rises while the command stands still. The step
sets the accuracy alone, see `substeps`.

In the plane, Coulomb friction has a smooth sign, ``F = -mu N v / sqrt(|v|^2 + v0^2)``: beyond a few
times v0 it is that of the velocity, and near rest a viscous damper, where a true sign would chatter
at any step. The slope is taken at the start of the step and the velocity at its middle, so the
force is a damper of a positive coefficient within each step: it takes energy out at every step,
however stiff.

Cost: about 1 us a step along each axis, in plain Python.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Gt

from mmt.core.bounds import check_fields

STEP_ANGLE: Final = 0.3
"""Largest phase (rad) of the fastest vibration within one sub-step; the midpoint rule is
then slow by less than 1 % of a period."""

SMOOTHING_M_S: Final = 0.004
"""v0: friction has 93 % of its full value at 10 mm/s."""


@dataclass(frozen=True, slots=True)
class ContactLaw:
    """Unilateral contact of a tip with a flat surface at height zero.

    At depth d the force is ``max(0, k d + (c + a k d) d')``; above the surface it is 0.

    Parameters
    ----------
    stiffness_n_m
        Elastic stiffness k, above 0.
    damping_n_s_m
        Kelvin-Voigt damping c, at least 0.
    dissipation_s_m
        Hunt-Crossley dissipation a, at least 0: damping ``a k d`` at depth d, which
        starts from zero at touch and leaves no jump in the force.

    Raises
    ------
    InputError
        A value is out of range or not finite.
    """

    stiffness_n_m: Annotated[float, Gt(0)]
    damping_n_s_m: Annotated[float, Ge(0)] = 0.0
    dissipation_s_m: Annotated[float, Ge(0)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, slots=True)
class Drive:
    """A mass held by a spring and a damper: a tip under impedance control.

    The spring pulls towards the commanded position; the damper acts against the ground,
    so that the drive stays passive while the command stands still.
    """

    mass_kg: Annotated[float, Gt(0)]
    stiffness_n_m: Annotated[float, Ge(0)]
    damping_n_s_m: Annotated[float, Ge(0)]

    def __post_init__(self) -> None:
        check_fields(self)


def substeps(drive: Drive, law: ContactLaw, tick_s: float) -> int:
    """Return the number of sub-steps of a tick that keeps the phase within `STEP_ANGLE` each."""
    fastest = math.sqrt((drive.stiffness_n_m + law.stiffness_n_m) / drive.mass_kg)
    return max(1, math.ceil(fastest * tick_s / STEP_ANGLE))


def step_normal(
    drive: Drive,
    law: ContactLaw,
    state: tuple[float, float],
    command_m: float,
    step_s: float,
) -> tuple[float, float, float]:
    """Advance the tip along the normal by one step.

    Parameters
    ----------
    drive, law
        What moves the tip and what it touches.
    state
        Height (m) and velocity (m/s) at the start; negative heights press into the
        surface.
    command_m
        Commanded height, constant within the step.
    step_s
        Length of the step.

    Returns
    -------
    height_m, velocity_m_s
        State at the end.
    force_n
        Mean contact force over the step, never negative.
    """
    height_m, velocity_m_s = state
    # With s = the step's travel, momentum reads: inertia * s - push = contact force(s).
    inertia = 2.0 * drive.mass_kg / (step_s * step_s) + 0.5 * drive.stiffness_n_m
    inertia += drive.damping_n_s_m / step_s
    push = 2.0 * drive.mass_kg * velocity_m_s / step_s
    push += drive.stiffness_n_m * (command_m - height_m)
    travel, force = _travel(law, height_m, inertia, push, step_s)
    return height_m + travel, 2.0 * travel / step_s - velocity_m_s, force


def _travel(
    law: ContactLaw, height: float, inertia: float, push: float, step_s: float
) -> tuple[float, float]:
    free = push / inertia
    if height >= 0.0 and height + free >= 0.0:
        return free, 0.0
    stiffness = law.stiffness_n_m
    depth = max(-height, -0.5 * (height + free))
    damping = (law.damping_n_s_m + law.dissipation_s_m * stiffness * depth) / step_s
    total = inertia + damping
    if height >= 0.0:
        # Entering: the root that ends below the surface; the other is the way back.
        half = push - stiffness * height
        curve = total + 0.5 * stiffness
        root = math.sqrt(max(half * half - 2.0 * curve * stiffness * height * height, 0.0))
        travel = 0.5 * (half - root) / curve
    else:
        travel = (push - stiffness * height) / (total + 0.5 * stiffness)
        if height + travel > 0.0:
            # Leaving: the spring gives back no more than it holds.
            root = math.sqrt(push * push + 2.0 * total * stiffness * height * height)
            travel = 0.5 * (push + root) / total
    force = inertia * travel - push
    if force < 0.0:
        return free, 0.0
    return travel, force


def friction_slope_n_s_m(
    coefficient: float, normal_force_n: float, speed_m_s: float, smoothing_m_s: float
) -> float:
    """Return friction over speed: ``mu N / sqrt(v^2 + v0^2)``, at least 0."""
    return coefficient * normal_force_n / math.hypot(speed_m_s, smoothing_m_s)


def step_tangential(
    drive: Drive,
    slope_n_s_m: float,
    state: tuple[float, float],
    command_m: float,
    step_s: float,
) -> tuple[float, float, float]:
    """Advance one tangential axis by one step of the implicit midpoint rule.

    Parameters
    ----------
    drive
        What moves the tip.
    slope_n_s_m
        From `friction_slope_n_s_m`, common to both axes.
    state
        Position (m) and velocity (m/s) at the start.
    command_m
        Commanded position, constant within the step.
    step_s
        Length of the step.

    Returns
    -------
    position_m, velocity_m_s
        State at the end.
    force_n
        Mean friction of the surface on the tip over the step.
    """
    position_m, velocity_m_s = state
    inertia = 2.0 * drive.mass_kg / (step_s * step_s) + 0.5 * drive.stiffness_n_m
    inertia += (drive.damping_n_s_m + slope_n_s_m) / step_s
    push = 2.0 * drive.mass_kg * velocity_m_s / step_s
    push += drive.stiffness_n_m * (command_m - position_m)
    travel = push / inertia
    return (
        position_m + travel,
        2.0 * travel / step_s - velocity_m_s,
        -slope_n_s_m * travel / step_s,
    )
