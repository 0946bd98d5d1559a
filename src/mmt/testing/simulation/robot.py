"""The follower's arm: a tip under impedance control, on a surface with friction."""

import math
from dataclasses import dataclass
from typing import Final

from mmt.contact.steps import (
    SMOOTHING_M_S,
    ContactLaw,
    Drive,
    friction_slope_n_s_m,
    step_normal,
    step_tangential,
    substeps,
)
from mmt.core.arrays import Vector
from mmt.scene import Simulated
from mmt.testing.simulation import PERIOD_S, START_MM, TIP_MASS_KG, pole_of

DISSIPATION_S_M: Final = 0.3
"""Hunt-Crossley dissipation of the surface: restitution 0.98 at 0.1 m/s."""

REACH_MM: Final = 1000.0
"""Largest distance of the tip from the centre along each axis; commands are cut to it."""


@dataclass(frozen=True, slots=True)
class TipState:
    """The true state of the tip at the end of a tick."""

    position_mm: Vector
    velocity_mm_s: Vector
    force_n: Vector
    """Mean force of the surface on the tool over the tick."""
    acceleration_m_s2: Vector
    """Mean acceleration of the tip over the tick, texture not included."""


def tip_drive(bandwidth_hz: float) -> tuple[Drive, float]:
    """Return the impedance controller of this bandwidth and its command filter's pole.

    From command to free motion there are three equal real poles: two of the critically
    damped mass on its spring, one that smooths the steps of a sampled command. Together
    they are 3 dB down at `bandwidth_hz`, and nothing overshoots.
    """
    pole_rad_s = pole_of(bandwidth_hz)
    drive = Drive(TIP_MASS_KG, TIP_MASS_KG * pole_rad_s**2, 2.0 * TIP_MASS_KG * pole_rad_s)
    return drive, pole_rad_s


class SimulatedRobot:
    """A tip that follows commands with finite bandwidth and meets a flat surface at z = 0.

    The integration is passive at every stiffness (`mmt.contact`); it takes as many
    sub-steps a tick as the stiffness needs, 2 at 5 N/mm and 3 at 50 N/mm. Cost: 2 us
    a tick and 2 us a sub-step.

    Parameters
    ----------
    settings
        Bandwidth of the arm and stiffness of the surface.
    friction_coefficient
        Coulomb friction with the surface.
    """

    def __init__(self, settings: Simulated, friction_coefficient: float) -> None:
        self._drive, pole_rad_s = tip_drive(settings.robot_bandwidth_hz)
        self._law = ContactLaw(
            settings.surface_stiffness_n_mm * 1000.0, dissipation_s_m=DISSIPATION_S_M
        )
        self.friction_coefficient = friction_coefficient
        """Friction coefficient of the surface; may change while the robot runs."""
        self._count = substeps(self._drive, self._law, PERIOD_S)
        self._step_s = PERIOD_S / self._count
        self._smoothing = -math.expm1(-pole_rad_s * PERIOD_S)
        start = tuple(0.001 * part for part in START_MM)
        self._command = list(start)
        self._position = list(start)
        self._velocity = [0.0, 0.0, 0.0]

    def advance(self, command_mm: Vector) -> TipState:
        """Move for one tick towards the command; return the state at its end."""
        smoothed = self._command
        for axis in range(3):
            wanted_mm = max(-REACH_MM, min(command_mm[axis], REACH_MM))
            smoothed[axis] += self._smoothing * (0.001 * wanted_mm - smoothed[axis])
        before = tuple(self._velocity)
        force = [0.0, 0.0, 0.0]
        for _ in range(self._count):
            self._substep(force)
        x, y, z = self._position
        u, v, w = self._velocity
        return TipState(
            (1000.0 * x, 1000.0 * y, 1000.0 * z),
            (1000.0 * u, 1000.0 * v, 1000.0 * w),
            (force[0], force[1], force[2]),
            ((u - before[0]) / PERIOD_S, (v - before[1]) / PERIOD_S, (w - before[2]) / PERIOD_S),
        )

    def _substep(self, force: list[float]) -> None:
        """Integrate one sub-step and add its share to the tick's mean force."""
        position, velocity, command = self._position, self._velocity, self._command
        step_s = self._step_s
        speed = math.hypot(velocity[0], velocity[1])
        position[2], velocity[2], normal = step_normal(
            self._drive, self._law, (position[2], velocity[2]), command[2], step_s
        )
        slope = friction_slope_n_s_m(self.friction_coefficient, normal, speed, SMOOTHING_M_S)
        for axis in (0, 1):
            position[axis], velocity[axis], friction = step_tangential(
                self._drive, slope, (position[axis], velocity[axis]), command[axis], step_s
            )
            force[axis] += friction / self._count
        force[2] += normal / self._count
