"""Coulomb friction in the tangential plane, with a smooth sign.

``F = -mu N v / sqrt(|v|^2 + v0^2)``: the regularised Coulomb law, which is the sign of the
velocity beyond a few times v0 and a viscous damper near rest, where a true sign would
chatter at any step.

Stability: the slope is taken at the start of the step and the velocity at its middle, so
the force is a damper of a positive coefficient within each step: it takes energy out at
every step, however stiff. Cost: about 1 us a step in plain Python.
"""

import math
from typing import Final

from mmt.contact.normal import Drive

SMOOTHING_M_S: Final = 0.004
"""v0: friction has 93 % of its full value at 10 mm/s."""


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
